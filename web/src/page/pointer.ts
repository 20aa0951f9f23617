import { Vector3 } from "three";

import type { Session } from "../types";
import type { SceneView } from "../view/scene";

/** Stiffness of the spring between a hand and the pointer, N/m, and the greatest force, N. */
const STIFFNESS = 200;
const STRONGEST = 40;

/** A hand that is being pulled: the body, where it was taken, and where it is pulled to, m in the world. */
interface Pull {
  readonly body: string;
  /** From the body's place to where it was taken; the body turns little while it is held. */
  readonly grip: Vector3;
  target: Vector3;
}

/** The pointer, mouse or finger, on the picture: it presses keys, pulls hands, and else turns the camera. */
export class Pointer {
  private pull: Pull | null = null;
  private key: number | null = null;
  /** The pointer that has taken one of them: of several fingers the first. */
  private taken: number | null = null;

  /**
   * @param session The session that is on.
   * @param onTouch Is called as a key or a hand is taken.
   */
  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly view: SceneView,
    private readonly session: () => Session | null,
    private readonly onTouch: () => void,
  ) {
    // Before the camera's own listeners, which are to know whether they may act.
    canvas.addEventListener("pointerdown", (event) => this.take(event), { capture: true });
    canvas.addEventListener("pointermove", (event) => this.move(event));
    for (const name of ["pointerup", "pointercancel", "lostpointercapture"] as const) {
      canvas.addEventListener(name, (event) => this.letGo(event));
    }
  }

  /** Pull by where the hand is now; to be called before each control step. */
  apply(): void {
    const session = this.session();
    if (this.pull === null || session === null) return;
    const at = bodyPlace(session, this.pull.body).add(this.pull.grip);
    const force = this.pull.target.clone().sub(at).multiplyScalar(STIFFNESS).clampLength(0, STRONGEST);
    session.pull(this.pull.body, force.toArray(), at.toArray());
  }

  private take(event: PointerEvent): void {
    if (this.taken !== null) return;
    const session = this.session();
    const touch = session === null ? null : this.view.touch(event.clientX, event.clientY);
    this.view.orbiting = touch === null;
    if (session === null || touch === null) return;
    this.canvas.setPointerCapture(event.pointerId);
    this.taken = event.pointerId;
    if ("key" in touch.hit) {
      this.key = touch.hit.key;
      session.pushKey(this.key, true);
    } else {
      const { body } = touch.hit;
      this.pull = { body, grip: touch.point.clone().sub(bodyPlace(session, body)), target: touch.point };
    }
    this.onTouch();
  }

  private move(event: PointerEvent): void {
    if (this.taken !== null && event.pointerId !== this.taken) return;
    if (this.pull !== null) {
      this.pull.target = this.view.pointAt(event.clientX, event.clientY, this.pull.target);
    } else if (event.buttons === 0) {
      const over = this.view.touch(event.clientX, event.clientY);
      this.canvas.classList.toggle("on-key", over !== null);
    }
  }

  private letGo(event: PointerEvent): void {
    if (this.taken !== null && event.pointerId !== this.taken) return;
    const session = this.session();
    if (this.key !== null) session?.pushKey(this.key, false);
    if (this.pull !== null) session?.pull(null);
    this.key = null;
    this.pull = null;
    this.taken = null;
    this.view.orbiting = true;
  }
}

function bodyPlace(session: Session, name: string): Vector3 {
  const body = session.state.bodyNames.indexOf(name);
  return new Vector3().fromArray(session.state.bodyPositions, 3 * body);
}
