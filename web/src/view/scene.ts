import {
  AmbientLight,
  DirectionalLight,
  MathUtils,
  NeutralToneMapping,
  PCFShadowMap,
  PMREMGenerator,
  Raycaster,
  Scene,
  SpotLight,
  Vector2,
  Vector3,
  WebGLRenderer,
  type PerspectiveCamera,
} from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { RoomEnvironment } from "three/examples/jsm/environments/RoomEnvironment.js";

import { KEY_IS_BLACK } from "../music/constants";
import { NUM_KEYS, type Piece, type SceneState } from "../types";
import { newCamera, placeOf, type Place, type Stretch, type View } from "./cameras";
import { PRESSED_COLOR, WRONG_COLOR, fingerColor } from "./colors";
import { FallingNotes } from "./falling_notes";
import type { Pose } from "./pose";
import type { Quality } from "./quality";
import { notesOf } from "./roll_notes";
import { keyOf, type Stage } from "./stage";
import { StageObjects, type Hit } from "./stage_objects";
import { ALL_KEYS, Stretches } from "./stretches";

/** A moment between two control steps, as it is drawn. */
export interface Moment {
  /** s since the start of the episode. */
  readonly time: number;
  readonly from: Pose;
  readonly to: Pose;
  /** How far the way from one pose to the other is gone, 0 to 1. */
  readonly share: number;
  /** (88) 1 where a key sounds. */
  readonly sounding: Uint8Array;
}

/** What the pointer is on, and where, m. */
export interface Touch {
  readonly hit: Hit;
  readonly point: Vector3;
}

/** Time constant with which a view that goes along with the music does so, s. */
const FOLLOWING_TIME = 0.6;
/** Time that the camera takes from one view to another, s. */
const TRAVEL_TIME = 0.7;
/** Mean time between pictures from which on fewer pixels are drawn, s, and the share of the last in that mean. */
const SLOWEST = 0.06;
const INTERVAL_SHARE = 0.1;
/** A longer one is a pause of the browser, or of whoever looks elsewhere, and no slow picture, s. */
const LONGEST_INTERVAL = 0.1;
/** Fewest pixels in a CSS pixel's width. */
const COARSEST = 0.6;

/** The picture: piano, hands and falling notes, from cameras that one can move. */
export class SceneView {
  private readonly renderer: WebGLRenderer;
  private readonly scene = new Scene();
  private readonly camera: PerspectiveCamera = newCamera();
  private readonly orbit: OrbitControls;
  private readonly objects: StageObjects;
  private readonly falling: FallingNotes;
  private readonly keyY: readonly number[];
  private readonly raycaster = new Raycaster();
  private readonly plain: boolean;
  private finest = 1;
  private pixelRatio = 2;
  private interval = 0;
  private view: View = "stage";
  private time = 0;
  private stretch: Stretch = ALL_KEYS;
  private stretches: Stretches | null = null;
  /** Whether the camera is where the view has it; not after the visitor has moved it. */
  private placed = true;
  private piece: Piece | null = null;
  private travel: { from: Vector3; look: Vector3; gone: number } | null = null;

  /**
   * @param state The scene at rest.
   * @throws Error If the browser has no WebGL 2.
   */
  constructor(
    private readonly canvas: HTMLCanvasElement,
    stage: Stage,
    state: SceneState,
    quality: Quality,
  ) {
    this.plain = quality === "plain";
    const { plain } = this;
    this.renderer = new WebGLRenderer({ canvas, antialias: !plain, alpha: true });
    this.renderer.toneMapping = NeutralToneMapping;
    this.renderer.shadowMap.enabled = !plain;
    this.renderer.shadowMap.type = PCFShadowMap;
    this.objects = new StageObjects(stage, state.bodyNames, plain);
    this.keyY = keyPlaces(state);
    this.falling = new FallingNotes(this.keyY, KEY_IS_BLACK);
    this.scene.add(this.objects.group, this.falling.group);
    this.light();
    this.orbit = new OrbitControls(this.camera, canvas);
    this.orbit.enableDamping = true;
    this.orbit.minDistance = 0.4;
    this.orbit.maxDistance = 12;
    this.orbit.maxPolarAngle = MathUtils.degToRad(88);
    this.orbit.addEventListener("start", () => {
      this.travel = null;
      this.placed = false;
    });
  }

  /** Show the notes of another piece, and the part of the keyboard that it needs. */
  showPiece(piece: Piece): void {
    this.piece = piece;
    const notes = notesOf(piece.roll);
    this.falling.show(notes, piece.roll.controlTimestep);
    this.stretches = new Stretches(notes, this.keyY, piece.roll.controlTimestep);
    this.stretch = this.stretches.at(this.view, 0);
    this.look(this.view, false);
  }

  /** Look from a view, at once or by moving there. */
  look(view: View, moving: boolean): void {
    if (view !== this.view) this.stretch = this.stretches?.at(view, this.time) ?? ALL_KEYS;
    this.view = view;
    this.falling.group.visible = view === "stage";
    this.travel = null;
    this.placed = true;
    if (moving) {
      this.travel = { from: this.camera.position.clone(), look: this.orbit.target.clone(), gone: 0 };
    } else {
      this.put(placeOf(view, this.stretch, this.camera.aspect));
      this.orbit.update();
    }
  }

  /** Whether dragging turns the camera. */
  set orbiting(on: boolean) {
    this.orbit.enabled = on;
  }

  /** Fit the picture to its place on the page, in CSS pixels. */
  resize(width: number, height: number, pixelRatio: number): void {
    this.finest = Math.min(this.plain ? 1 : 2, pixelRatio);
    this.renderer.setPixelRatio(Math.min(this.finest, this.pixelRatio));
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.look(this.view, false);
  }

  /** Draw a moment, `elapsed` s after the last one. */
  draw(moment: Moment, elapsed: number): void {
    this.time = moment.time;
    this.saveTime(elapsed);
    this.objects.place(moment.from, moment.to, moment.share);
    const due = this.paintKeys(moment);
    this.falling.update(moment.time, elapsed, moment.sounding, due);
    this.follow(elapsed);
    this.moveCamera(elapsed);
    this.orbit.update();
    this.renderer.render(this.scene, this.camera);
  }

  /** What of the keys and the hands is at a point of the picture, in CSS pixels of the page; null if nothing is. */
  touch(x: number, y: number): Touch | null {
    this.aim(x, y);
    for (const found of this.raycaster.intersectObject(this.objects.group)) {
      const hit = this.objects.hitOf(found.object, found.instanceId);
      return hit === null ? null : { hit, point: found.point };
    }
    return null;
  }

  /** Point of the world at a point of the page, as far away from the camera as another point is. */
  pointAt(x: number, y: number, near: Vector3): Vector3 {
    this.aim(x, y);
    const ahead = this.camera.getWorldDirection(new Vector3());
    const { origin, direction } = this.raycaster.ray;
    const depth = near.clone().sub(origin).dot(ahead) / direction.dot(ahead);
    return origin.clone().addScaledVector(direction, depth);
  }

  /** Draw fewer pixels if pictures come too slowly: that is less of a loss than motion that stutters. */
  private saveTime(elapsed: number): void {
    this.interval += (Math.min(elapsed, LONGEST_INTERVAL) - this.interval) * INTERVAL_SHARE;
    const ratio = this.renderer.getPixelRatio();
    if (this.interval < SLOWEST || ratio <= COARSEST) return;
    this.pixelRatio = Math.max(COARSEST, ratio * 0.8);
    this.renderer.setPixelRatio(Math.min(this.finest, this.pixelRatio));
    this.interval = 0;
  }

  private aim(x: number, y: number): void {
    const box = this.canvas.getBoundingClientRect();
    const at = new Vector2((2 * (x - box.left)) / box.width - 1, 1 - (2 * (y - box.top)) / box.height);
    this.raycaster.setFromCamera(at, this.camera);
  }

  /** Colour keys by the finger of the note that is due, green if right and red if wrong; return what is due. */
  private paintKeys(moment: Moment): Uint8Array {
    const due = new Uint8Array(NUM_KEYS);
    const roll = this.piece?.roll;
    if (roll === undefined) return due;
    // A hair is added, so that 3 x 0.05 s is the third step.
    const step = Math.floor(moment.time / roll.controlTimestep + 1e-6);
    const row = step < roll.steps ? step * NUM_KEYS : -1;
    for (let key = 0; key < NUM_KEYS; key++) {
      if (row >= 0) due[key] = roll.active[row + key];
      const right = due[key] ? PRESSED_COLOR : WRONG_COLOR;
      const asked = due[key] ? fingerColor(roll.finger[row + key]) : null;
      this.objects.paint(key, moment.sounding[key] ? right : asked);
    }
    return due;
  }

  /** Go along with the music, if the view does. */
  private follow(elapsed: number): void {
    if (this.stretches === null || !this.placed) return;
    const ahead = this.stretches.at(this.view, this.time);
    const share = 1 - Math.exp(-elapsed / FOLLOWING_TIME);
    this.stretch = {
      middle: MathUtils.lerp(this.stretch.middle, ahead.middle, share),
      width: MathUtils.lerp(this.stretch.width, ahead.width, share),
    };
    if (this.travel === null) this.put(placeOf(this.view, this.stretch, this.camera.aspect));
  }

  private put({ position, target }: Place): void {
    this.camera.position.copy(position);
    this.orbit.target.copy(target);
  }

  private moveCamera(elapsed: number): void {
    if (this.travel === null) return;
    const travel = this.travel;
    travel.gone = Math.min(1, travel.gone + elapsed / TRAVEL_TIME);
    const share = MathUtils.smootherstep(travel.gone, 0, 1);
    const place = placeOf(this.view, this.stretch, this.camera.aspect);
    this.camera.position.lerpVectors(travel.from, place.position, share);
    this.orbit.target.lerpVectors(travel.look, place.target, share);
    if (travel.gone === 1) this.travel = null;
  }

  private light(): void {
    const lamp = new SpotLight(0xfff1dc, 8.5, 0, MathUtils.degToRad(32), 0.8);
    lamp.position.set(0.8, -0.35, 1.5);
    lamp.target.position.set(0, 0, 0);
    lamp.castShadow = !this.plain;
    lamp.shadow.mapSize.set(1024, 1024);
    lamp.shadow.bias = -0.0004;
    lamp.shadow.normalBias = 0.002;
    lamp.shadow.radius = 4;
    const fill = new DirectionalLight(0x9fb4dd, 0.5);
    fill.position.set(0.6, 0.9, 1.2);
    this.scene.add(lamp, lamp.target, fill);
    if (this.plain) {
      this.scene.add(new AmbientLight(0xdfe6ff, 0.75));
      return;
    }
    const generator = new PMREMGenerator(this.renderer);
    this.scene.environment = generator.fromScene(new RoomEnvironment(), 0.03).texture;
    this.scene.environmentIntensity = 0.28;
    generator.dispose();
  }
}

/** (88) places of the keys along the keyboard, m. */
function keyPlaces(state: SceneState): number[] {
  const places: number[] = [];
  state.bodyNames.forEach((name, body) => {
    const key = keyOf(name);
    if (key !== null) places[key] = state.bodyPositions[3 * body + 1];
  });
  return places;
}
