import { InputError, type KeyEvent, type Metrics, type PlayerId, type Session } from "../types";
import { VIEWS, type View } from "../view/cameras";
import type { RollView } from "../view/roll";
import type { SceneView } from "../view/scene";
import type { PianoSound } from "../view/sound";
import { clock, describe, figures, percent } from "./captions";
import { Downloads } from "./downloads";
import type { Elements } from "./elements";
import { Judgement } from "./judgement";
import { MusicianshipRows } from "./musicianship_rows";
import { OWN_FILE, type Chosen, type Library } from "./library";
import { readLink, writeLink } from "./permalink";
import { Playback } from "./playback";
import { PLAYERS, hindrance } from "./players";
import { Scoreboard } from "./scoreboard";
import { Versions } from "./versions";
import type { Visitor } from "./visitor";

/** What makes a session of a piece and a player, and what draws and sounds it. */
export interface Parts {
  readonly elements: Elements;
  readonly library: Library;
  readonly sound: PianoSound;
  readonly roll: RollView;
  makeSession(chosen: Chosen, player: PlayerId): Promise<Session>;
}

/**
 * Time by which a visitor sees notes fall earlier, s: so late on average does a key sound that was struck, as it waits
 * for the next control step (0 to 50 ms) and then goes down (30 ms).
 */
const VISITOR_LEAD = 0.055;
/** Control steps between two updates of the figures and of the captions. */
const FIGURE_STEPS = 4;
const CAPTION_STEPS = 60;
/** Time for which a camera that was moved swings on, s. */
const SETTLING_TIME = 1;
/** Time for which a place is looked for before the page answers again, ms. */
const SEEK_TIME = 40;

/** The page: one piece, one player, what is seen and heard of it, and everything that changes that. */
export class App {
  playback: Playback | null = null;
  view: SceneView | null = null;
  viewName: View = "stage";
  player: PlayerId = "sight-reader";
  visitor: Visitor | null = null;
  /** Is called when there is something to show, once. */
  onFirstSession: ((session: Session) => void) | null = null;
  /** Is called before each control step. */
  beforeStep: () => void = () => undefined;
  /** Pictures drawn so far. */
  frames = 0;
  private chosen: Chosen | null = null;
  private judgement: Judgement | null = null;
  private readonly scoreboard: Scoreboard;
  private readonly downloads: Downloads;
  private readonly musicianship: MusicianshipRows;
  private readonly versions: Versions;
  /** Number of the last search for a place, and whether it goes on playing there. */
  private seeks = 0;
  /** Number of the search that goes on, if there is one: nothing is drawn meanwhile. */
  private seeking: number | null = null;
  private goesOn = false;
  /** Keys that have moved since the beginning. */
  events: KeyEvent[] = [];
  private drawUntil = 0;
  private changed = false;
  private loading: Promise<void> = Promise.resolve();
  /** How many pieces were asked for, and the number of the one that is on. */
  private asked = 0;
  private shown = 0;

  constructor(private readonly parts: Parts) {
    this.scoreboard = new Scoreboard(parts.elements.players, (player) => void this.choosePlayer(player));
    this.downloads = new Downloads(parts.elements, parts.sound, () => this.events, (text) => this.say(text));
    const { musicianship, musicianshipFigures } = parts.elements;
    this.musicianship = new MusicianshipRows(musicianship, musicianshipFigures, () => this.showFigures());
    this.versions = new Versions(parts.elements.versions, (id) => void this.chooseVersion(id));
    this.fillMenu();
  }

  get session(): Session | null {
    return this.playback?.session ?? null;
  }

  /** Follow a permalink; what it leaves out stays as it is, or is the first piece and the sight-reader. */
  async follow(hash: string): Promise<void> {
    const link = readLink(hash);
    if (link.view !== undefined) this.look(link.view, false);
    if (link.tempo !== undefined) this.setTempo(link.tempo);
    const first = this.chosen === null ? this.parts.library.catalogue.pieces[0].id : null;
    const id = link.piece ?? first; // null: what is on, or on its way
    const { file } = link;
    const isOn = file ? file.packed === this.chosen?.file?.packed : id === this.chosen?.piece.id;
    const stays = (id === null && !file) || (this.shown === this.asked && isOn);
    if (stays && (link.player ?? this.player) === this.player) return;
    const find = () => (file ? this.parts.library.linked(file) : this.parts.library.piece(id!));
    await this.report(async () => {
      try {
        await this.load(stays ? null : find, link.player);
      } catch (error) {
        // A link to what is not here any more: the message stays, beside the piece that would be on without it.
        if (this.chosen === null && first !== null) await this.load(() => this.parts.library.piece(first), link.player);
        throw error;
      }
    });
  }

  /** Choose a piece of the catalogue. */
  async choosePiece(id: string): Promise<void> {
    await this.report(() => this.load(() => this.parts.library.piece(id)));
  }

  /** Choose another version of the piece that is on, and go on where it is. */
  async chooseVersion(id: string): Promise<void> {
    const [place, plays] = [this.playback?.shown ?? 0, this.playback?.playing ?? false];
    await this.choosePiece(id);
    await this.seek(place);
    if (plays) await this.toggle();
  }

  /** Choose a file; a take is played as it was. */
  async openFile(file: File): Promise<void> {
    const read = async (): Promise<Chosen> => {
      const bytes = new Uint8Array(await file.arrayBuffer());
      this.say(`Reading ${file.name}, finding hands and fingers …`);
      await painted();
      return this.parts.library.file(bytes, file.name);
    };
    await this.report(() => this.load(read));
  }

  /** Choose who plays the piece that is on. */
  async choosePlayer(player: PlayerId): Promise<void> {
    await this.report(() => this.load(null, player));
  }

  /**
   * Find a piece and put it on, at the beginning; with the sight-reader, if this player cannot play it.
   *
   * A piece that comes, or fails to, when another one was asked for meanwhile is passed over. One is put on after the
   * other, as all sessions are played on one simulated piano.
   *
   * @param find Null for the piece that is on.
   * @param player By default whoever is on by then.
   */
  async load(find: (() => Chosen | Promise<Chosen>) | null, player?: PlayerId): Promise<void> {
    const number = find === null ? this.asked : ++this.asked;
    const isLate = (): boolean => number !== this.asked;
    try {
      const found = find === null ? null : await find();
      const next = this.loading.then(async () => {
        const chosen = found ?? this.chosen;
        if (isLate() || chosen === null) return;
        await this.put(chosen, player ?? (found?.take ? "recorded" : this.player));
        if (found !== null) this.shown = number;
      });
      this.loading = next.catch(() => undefined);
      await next;
    } catch (error) {
      if (!isLate()) throw error;
    }
  }

  /** Play, or pause. */
  async toggle(): Promise<void> {
    const playback = this.playback;
    if (playback === null) return;
    this.endSeek();
    if (playback.playing) {
      this.pause();
      this.say(`Paused at ${clock(playback.shown)}. ${figures(playback.session.metrics())}. ${describe(playback.session)}`);
      return;
    }
    if (playback.session.finished) this.restart();
    // The sound may need a moment to load; the piece does not wait for it.
    void this.parts.sound.start();
    playback.playing = true;
    this.showPlaying();
    this.say(`${PLAYERS[this.player].name}: playing.`);
  }

  pause(): void {
    if (this.playback !== null) this.playback.playing = false;
    this.parts.sound.stop();
    this.showPlaying();
  }

  restart(): void {
    this.endSeek();
    this.parts.sound.stop();
    this.playback?.restart();
    this.beginJudgement();
    this.showFigures();
    this.say("At the beginning.");
  }

  /** Play control steps without regard to real time. */
  advance(steps: number): void {
    if (this.playback === null) return;
    this.endSeek();
    this.pause();
    this.playback.advance(steps);
    this.showFigures();
    this.say(`${describe(this.playback.session)} ${figures(this.playback.session.metrics())}.`);
  }

  /**
   * Go to a time, s. Hands that are simulated play until there, without pictures and sound; from the beginning, if it
   * lies behind.
   */
  async seek(time: number): Promise<void> {
    const playback = this.playback;
    if (playback === null) return;
    const { session } = playback;
    const { steps, controlTimestep } = session.piece.roll;
    const target = Math.min(steps, Math.max(0, Math.round(time / controlTimestep)));
    const goesOn = playback.playing || this.goesOn;
    this.pause();
    if (target < session.stepsPlayed) this.restart();
    const number = ++this.seeks;
    this.goesOn = goesOn;
    this.seeking = number;
    try {
      while (session.stepsPlayed < target && !session.finished) {
        const end = performance.now() + SEEK_TIME;
        while (performance.now() < end && session.stepsPlayed < target && !session.finished) playback.advance(1);
        this.showPlace(playback.shown);
        this.say(`Going to ${clock(target * controlTimestep)} …`);
        await new Promise((resolve) => setTimeout(resolve));
        if (number !== this.seeks || playback !== this.playback) return;
      }
    } catch (error) {
      this.complain(error);
    }
    this.goesOn = false;
    this.seeking = null;
    this.showFigures();
    this.say(`At ${clock(playback.shown)}. ${figures(session.metrics())}.`);
    if (goesOn && !session.finished) await this.toggle();
    else this.showPlaying();
  }

  /** Whatever else is asked for ends a search. */
  private endSeek(): void {
    this.seeks++;
    this.goesOn = false;
  }

  setTempo(tempo: number): void {
    const { elements } = this.parts;
    elements.tempo.value = String(tempo);
    elements.tempoText.value = `${Number(tempo.toFixed(2))}×`;
    if (this.playback !== null) this.playback.tempo = tempo;
    this.updateLink();
  }

  /** Disturb whoever plays; see `Session`. */
  setDisturbance(noise: number, latency: number): void {
    if (this.session === null) return;
    this.session.noise = noise;
    this.session.latency = latency;
  }

  look(view: View, moving: boolean): void {
    this.viewName = view;
    const index = VIEWS.indexOf(view);
    this.parts.elements.views.querySelectorAll("input")[index].checked = true;
    this.view?.look(view, moving);
    this.updateLink();
    this.wake(moving);
  }

  /** Draw anew, once, or for as long as the camera moves. */
  wake(cameraMoves = false): void {
    this.changed = true;
    if (cameraMoves) this.drawUntil = performance.now() + 1000 * SETTLING_TIME;
  }

  /** Go on by some real time, s, and draw what has changed. */
  frame(elapsed: number): void {
    const playback = this.playback;
    if (playback === null || this.seeking === this.seeks) return;
    const played = playback.playing;
    try {
      playback.tick(elapsed);
    } catch (error) {
      this.pause();
      this.complain(error);
      return;
    }
    if (played && !playback.playing) this.finish();
    if (played || this.changed || performance.now() < this.drawUntil) this.draw(elapsed);
  }

  /** Fit the piano roll to its place on the page, in CSS pixels. */
  resizeRoll(width: number, height: number, pixelRatio: number): void {
    this.parts.roll.resize(width, height, pixelRatio);
  }

  /** Draw what is on show. */
  draw(elapsed: number): void {
    const { playback, judgement } = this;
    this.changed = false;
    if (playback === null || judgement === null) return;
    const lead = this.player === "you" ? VISITOR_LEAD : 0;
    const { roll, score } = playback.session.piece;
    const moment = playback.moment();
    this.view?.draw({ ...moment, time: moment.time + lead }, elapsed);
    this.parts.roll.show({
      notes: judgement.notes,
      fates: judgement.fates(playback.shown),
      presses: judgement.presses(playback.shown),
      controlTimestep: roll.controlTimestep,
      duration: score.duration,
    });
    this.parts.roll.draw(playback.shown + lead);
    const { seek } = this.parts.elements;
    const length = String(roll.steps * roll.controlTimestep);
    if (seek.max !== length) seek.max = length;
    if (!seek.matches(":active")) this.showPlace(playback.shown);
    this.frames++;
  }

  /** Show a place of the progress bar, s, which may be dragged there. */
  showPlace(time: number): void {
    const { seek, clock: output } = this.parts.elements;
    const text = `${clock(time)} of ${clock(Number(seek.max))}`;
    output.value = text.replace(" of ", " / ");
    seek.value = String(time);
    if (seek.getAttribute("aria-valuetext") !== text) seek.setAttribute("aria-valuetext", text);
    seek.style.setProperty("--played", `${(100 * time) / Math.max(Number(seek.max), 1e-9)}%`);
  }

  /** Say something to all, also to those who do not see the picture. */
  say(text: string): void {
    this.parts.elements.caption.textContent = text;
  }

  /** Do something that bad input may stop, and then say why. */
  async report(work: () => Promise<void>): Promise<void> {
    this.parts.elements.message.hidden = true;
    try {
      await work();
    } catch (error) {
      this.complain(error);
      this.say("");
      this.restoreMenus();
      if (!(error instanceof InputError)) throw error;
    }
  }

  private complain(error: unknown): void {
    const { message } = this.parts.elements;
    message.textContent = error instanceof Error ? error.message : String(error);
    message.hidden = false;
  }

  private async put(chosen: Chosen, player: PlayerId): Promise<void> {
    const able = hindrance(player, chosen) === null ? player : "sight-reader";
    this.pause();
    const session = await this.parts.makeSession(chosen, able);
    // Two files of a visitor's have the same identifier.
    const another = chosen !== this.chosen && (chosen.entry === null || chosen.piece.id !== this.chosen?.piece.id);
    if (another) this.scoreboard.showPiece(chosen);
    this.chosen = chosen;
    this.player = able;
    this.setSession(session);
    this.showHead(chosen);
    this.updateLink();
    this.downloads.show(chosen, this.session);
  }

  private setSession(session: Session): void {
    const { elements, sound } = this.parts;
    this.onFirstSession?.(session);
    this.onFirstSession = null;
    sound.setPedal(false); // a visitor without a MIDI keyboard could not lift it
    this.playback = new Playback(session, {
      before: () => this.beforeStep(),
      after: (events, delay) => {
        this.judgement?.add(events);
        this.events.push(...events);
        for (const event of events) {
          const heard = this.player === "you" && this.visitor?.hasSounded(event);
          if (this.playback?.playing && !heard) sound.play(event, delay(event));
        }
        if (this.player !== "you") sound.setPedal(session.piece.roll.sustain[session.stepsPlayed - 1] === 1);
        this.visitor?.afterStep();
        if (session.stepsPlayed % FIGURE_STEPS === 0) this.showFigures();
        if (session.stepsPlayed % CAPTION_STEPS === 0 && this.playback?.playing) this.say(describe(session));
      },
    });
    this.playback.tempo = Number(elements.tempo.value);
    this.setDisturbance(Number(elements.noise.value), Number(elements.latency.value));
    this.beginJudgement();
    this.view?.showPiece(session.piece);
    this.showFigures();
    this.showPlaying();
  }

  private beginJudgement(): void {
    this.events = [];
    if (this.session !== null) this.judgement = new Judgement(this.session.piece.roll);
    this.wake();
  }

  private finish(): void {
    this.showPlaying();
    this.showFigures();
    if (this.session !== null) this.say(`The end. ${figures(this.session.metrics())}.`);
  }

  private showHead(chosen: Chosen): void {
    const { piece, entry, take } = chosen;
    const { elements } = this.parts;
    const title = titleOf(chosen);
    elements.title.textContent = title;
    elements.subtitle.textContent = [entry?.composer, PLAYERS[this.player].name].filter(Boolean).join(" · ");
    document.title = `${title} · sb3-piano`;
    elements.warnings.replaceChildren(
      ...piece.warnings.map((text) => Object.assign(document.createElement("li"), { textContent: text })),
    );
    elements.warnings.hidden = piece.warnings.length === 0;
    elements.visitor.hidden = this.player !== "you";
    const own = entry === null && take === null;
    elements.playersNote.textContent = own ? "Plans and recordings come with the pieces of the list only." : "";
    this.restoreMenus();
    this.say(`${title}: ${piece.score.notes.length} notes, ${clock(piece.score.duration)}.`);
  }

  private showFigures(): void {
    const { elements } = this.parts;
    const session = this.session;
    const metrics: Metrics | null = session === null || session.stepsPlayed === 0 ? null : session.metrics();
    elements.right.textContent = metrics === null ? "–" : percent(metrics.onset_recall);
    this.downloads.enable(metrics !== null);
    elements.f1.textContent = metrics === null ? "–" : metrics.f1.toFixed(3);
    elements.onsetF1.textContent = metrics === null ? "–" : metrics.onset_f1.toFixed(3);
    if (metrics !== null) this.scoreboard.record(this.player, metrics);
    this.musicianship.show(metrics === null ? null : session, this.events);
    this.wake();
  }

  private showPlaying(): void {
    const { elements } = this.parts;
    const playing = this.playback?.playing ?? false;
    const begun = this.session !== null && this.session.stepsPlayed > 0;
    elements.play.classList.toggle("playing", playing);
    elements.play.ariaLabel = playing ? "Pause" : "Play";
    elements.begin.hidden = playing || begun;
    elements.begin.disabled = this.session === null;
    elements.beginText.textContent = "Play";
  }

  private fillMenu(): void {
    const { piece } = this.parts.elements;
    const options = this.parts.library.catalogue.pieces.map(
      ({ id, title, composer }) => new Option(composer === "" ? title : `${title} · ${composer}`, id),
    );
    piece.replaceChildren(...options);
  }

  /** Let the menus show what is on. */
  private restoreMenus(): void {
    const { piece } = this.parts.elements;
    piece.querySelector(`option[value="${OWN_FILE}"]`)?.remove();
    if (this.chosen === null) return;
    const own = this.chosen.entry === null;
    if (own) piece.prepend(new Option(titleOf(this.chosen), OWN_FILE));
    const whole = this.parts.library.whole(this.chosen.piece.id);
    piece.value = whole?.id ?? OWN_FILE;
    this.versions.show(whole, this.chosen.piece.id);
    this.scoreboard.choose(this.player);
  }

  private updateLink(): void {
    if (this.chosen === null) return;
    const id = this.chosen.piece.id;
    const link = writeLink({
      piece: id === OWN_FILE ? undefined : id,
      file: this.chosen.file ?? undefined,
      player: this.player,
      tempo: Number(this.parts.elements.tempo.value),
      view: this.viewName,
    });
    history.replaceState(null, "", link);
  }
}

function titleOf({ piece, entry }: Chosen): string {
  return entry?.title ?? (piece.score.title || "Untitled");
}

/** Wait until the browser has shown what was written. */
function painted(): Promise<void> {
  return new Promise((resolve) => requestAnimationFrame(() => setTimeout(resolve)));
}
