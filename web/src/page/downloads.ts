import { writeMidi } from "../music/midi_writing";
import { runsOf } from "../music/runs";
import { NUM_KEYS, type KeyEvent, type Pedal, type Session } from "../types";
import type { PianoSound } from "../view/sound";
import { wavOf } from "../view/wav";
import type { Elements } from "./elements";
import type { Chosen } from "./library";

/** What visitors may keep: what was played as a MIDI file and as sound, and a link to the page as it is. */
export class Downloads {
  private session: Session | null = null;
  private name = "performance";
  private isBusy = false;

  constructor(
    private readonly elements: Elements,
    private readonly sound: PianoSound,
    private readonly events: () => readonly KeyEvent[],
    private readonly say: (text: string) => void,
  ) {
    elements.saveMidi.addEventListener("click", () => this.saveMidi());
    elements.saveWav.addEventListener("click", () => void this.saveWav());
    elements.copyLink.addEventListener("click", () => void this.copyLink());
  }

  /** Take up a piece and who plays it. */
  show({ piece, entry, file }: Chosen, session: Session | null): void {
    this.session = session;
    const title = entry?.title ?? (piece.score.title || "performance");
    this.name = `${title} - ${session?.player ?? ""}`.replace(/[^\p{L}\p{N} -]+/gu, "").trim();
    const isTooLarge = file !== null && file.packed === null;
    this.elements.copyLink.disabled = isTooLarge;
    this.elements.linkNote.textContent = isTooLarge ? "This file is too large for a link: send the file itself." : "";
  }

  /** Offer files once something was played. */
  enable(isPlayed: boolean): void {
    this.elements.saveMidi.disabled = !isPlayed;
    this.elements.saveWav.disabled = !isPlayed || this.isBusy;
  }

  private saveMidi(): void {
    const { pedals, seconds } = this.played();
    save(writeMidi(this.events(), pedals, seconds), "audio/midi", `${this.name}.mid`);
  }

  private async saveWav(): Promise<void> {
    const { pedals, seconds } = this.played();
    this.isBusy = true;
    this.enable(true);
    this.say("Making the sound …");
    try {
      save(wavOf(await this.sound.render(this.events(), pedals, seconds)), "audio/wav", `${this.name}.wav`);
      this.say(`${this.name}.wav is saved.`);
    } finally {
      this.isBusy = false;
      this.enable(true);
    }
  }

  private async copyLink(): Promise<void> {
    try {
      await navigator.clipboard.writeText(location.href);
      this.elements.linkNote.textContent = "The link is copied.";
    } catch {
      this.elements.linkNote.textContent = "Copy the link from the address bar.";
    }
  }

  /** Presses of the pedal so far, s, and the time that was played. */
  private played(): { pedals: Pedal[]; seconds: number } {
    if (this.session === null) return { pedals: [], seconds: 0 };
    const { piece, stepsPlayed, player } = this.session;
    const { sustain, controlTimestep } = piece.roll;
    const rows = new Uint8Array(stepsPlayed * NUM_KEYS);
    for (let step = 0; step < stepsPlayed; step++) rows[step * NUM_KEYS] = player === "you" ? 0 : sustain[step];
    const pedals = runsOf(rows, stepsPlayed).map(({ first, end }) => ({
      onset: first * controlTimestep,
      offset: end * controlTimestep,
    }));
    return { pedals, seconds: stepsPlayed * controlTimestep };
  }
}

function save(bytes: Uint8Array, type: string, name: string): void {
  const address = URL.createObjectURL(new Blob([bytes.slice()], { type }));
  const link = Object.assign(document.createElement("a"), { href: address, download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(address), 10_000);
}
