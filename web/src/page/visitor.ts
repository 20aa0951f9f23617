import type { KeyEvent, Session } from "../types";
import { speedOf } from "../music/dynamics";
import type { PianoSound } from "../view/sound";
import type { VisitorListener } from "./visitor_keys";

/**
 * What a visitor plays on a keyboard: it pushes the simulated keys and sounds at once.
 *
 * Keys are pushed for whole control steps, so one that is tapped between two of them is held for the next; while nothing
 * is played, it is let go at once.
 */
export class Visitor implements VisitorListener {
  /** Keys that are down, and the control step at which they went down. */
  private readonly down = new Map<number, number>();
  private readonly released = new Set<number>();

  /**
   * @param session The session that is on, if the visitor is its player.
   * @param playing Whether it is being played.
   */
  constructor(
    private readonly session: () => Session | null,
    private readonly sound: PianoSound,
    private readonly playing: () => boolean,
  ) {}

  key(key: number, velocity: number): void {
    const session = this.session();
    if (session === null) return;
    const pressed = velocity > 0;
    this.sound.play({ key, down: pressed, time: 0, speed: speedOf(velocity, key) }, 0);
    if (pressed) {
      this.down.set(key, session.stepsPlayed);
      this.released.delete(key);
      session.pushKey(key, true);
    } else if (this.playing() && this.down.get(key) === session.stepsPlayed) {
      this.released.add(key);
    } else {
      this.letGo(session, key);
    }
  }

  pedal(down: boolean): void {
    if (this.session() !== null) this.sound.setPedal(down);
  }

  /** Let go of keys that were tapped, as a control step is over. */
  afterStep(): void {
    const session = this.session();
    if (session === null) return;
    for (const key of this.released) this.letGo(session, key);
    this.released.clear();
  }

  /** Whether a simulated key has already been heard as the visitor struck it. */
  hasSounded(event: KeyEvent): boolean {
    return event.down && this.down.has(event.key);
  }

  private letGo(session: Session, key: number): void {
    session.pushKey(key, false);
    this.down.delete(key);
  }
}
