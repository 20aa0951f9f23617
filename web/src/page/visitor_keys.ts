import { MIN_PITCH, NUM_KEYS } from "../types";

/** Keys of a computer keyboard by where they are, and their distance in semitones from the upper octave's C. */
const CODES = new Map<string, number>([
  ...["KeyQ", "Digit2", "KeyW", "Digit3", "KeyE", "KeyR", "Digit5", "KeyT", "Digit6", "KeyY", "Digit7", "KeyU"]
    .concat(["KeyI", "Digit9", "KeyO", "Digit0", "KeyP"])
    .map((code, i): [string, number] => [code, i]),
  ...["KeyZ", "KeyS", "KeyX", "KeyD", "KeyC", "KeyV", "KeyG", "KeyB", "KeyH", "KeyN", "KeyJ", "KeyM"].map(
    (code, i): [string, number] => [code, i - 12],
  ),
]);

const OCTAVE = 12;
const LOWEST_C = 36;
const HIGHEST_C = 84;
/** Velocity of a computer's keys, which do not tell how hard they are struck. */
const COMPUTER_VELOCITY = 80;

const NOTE_ON = 0x90;
const NOTE_OFF = 0x80;
const CONTROL_CHANGE = 0xb0;
const SUSTAIN = 64;

/** What a visitor plays. */
export interface VisitorListener {
  /** A key, 0-87, went down with a MIDI velocity, or up (0). */
  key(key: number, velocity: number): void;
  pedal(down: boolean): void;
}

/** A computer keyboard as a piano of two octaves and a half. */
export class ComputerKeys {
  /** MIDI pitch of the upper octave's C. */
  upperC = 60;
  private readonly down = new Map<string, number>();

  constructor(private readonly listener: VisitorListener) {}

  /** Take up a key that went down; return whether it is one of the piano's. */
  press(event: KeyboardEvent): boolean {
    if (event.ctrlKey || event.metaKey || event.altKey) return false;
    const shift = { BracketLeft: -OCTAVE, BracketRight: OCTAVE }[event.code];
    if (shift !== undefined) {
      this.upperC = Math.min(HIGHEST_C, Math.max(LOWEST_C, this.upperC + shift));
      return true;
    }
    const distance = CODES.get(event.code);
    if (distance === undefined) return false;
    const key = this.upperC + distance - MIN_PITCH;
    if (event.repeat || this.down.has(event.code) || key < 0 || key >= NUM_KEYS) return true;
    this.down.set(event.code, key);
    this.listener.key(key, COMPUTER_VELOCITY);
    return true;
  }

  /** Take up a key that came up. */
  release(event: KeyboardEvent): void {
    const key = this.down.get(event.code);
    if (key === undefined) return;
    this.down.delete(event.code);
    this.listener.key(key, 0);
  }

  /** Let go of everything, as the page loses the keyboard. */
  releaseAll(): void {
    for (const key of this.down.values()) this.listener.key(key, 0);
    this.down.clear();
  }
}

/**
 * Listen to all MIDI keyboards that are or will be connected.
 *
 * @param onInputs Is told their names, now and whenever they change.
 * @throws Error If the browser has no Web MIDI or the visitor refuses.
 */
export async function listenToMidi(
  listener: VisitorListener,
  onInputs: (names: readonly string[]) => void,
): Promise<void> {
  if (!("requestMIDIAccess" in navigator)) {
    throw new Error("This browser does not speak MIDI; Chromium and Firefox do. The computer's keys work here, too.");
  }
  const access = await navigator.requestMIDIAccess().catch((error: Error) => {
    const refused = error.name === "NotAllowedError" || error.name === "SecurityError";
    throw new Error(
      refused
        ? "The browser may not use MIDI devices. Allow it in the site's settings, and try again."
        : `The browser cannot use MIDI devices here: ${error.message} The computer's keys work, too.`,
    );
  });
  const attach = (): void => {
    const inputs = [...access.inputs.values()].filter((input) => input.state === "connected");
    for (const input of inputs) input.onmidimessage = (message) => hear(message.data, listener);
    onInputs(inputs.map((input) => input.name ?? "MIDI keyboard"));
  };
  access.onstatechange = attach;
  attach();
}

/** Take up a MIDI message of any channel. */
export function hear(data: Uint8Array | null, listener: VisitorListener): void {
  if (data === null || data.length < 3) return;
  const [status, first, second] = data;
  const kind = status & 0xf0;
  const key = first - MIN_PITCH;
  if (kind === CONTROL_CHANGE && first === SUSTAIN) listener.pedal(second >= 64);
  if (key < 0 || key >= NUM_KEYS) return;
  if (kind === NOTE_ON) listener.key(key, second);
  if (kind === NOTE_OFF) listener.key(key, 0);
}
