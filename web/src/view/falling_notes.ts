import {
  AdditiveBlending,
  Color,
  DynamicDrawUsage,
  Group,
  InstancedMesh,
  Matrix4,
  PlaneGeometry,
  ShaderMaterial,
} from "three";

import { MISSED_COLOR, PRESSED_COLOR, WRONG_COLOR, fingerColor, linear } from "./colors";
import type { RollNote } from "./roll_notes";

// As in Python's `sb3_piano.viewing`: the panel that the notes come down, m, and how long that takes, s.
const PANEL = -0.0925;
const PANEL_FOOT = 0.045;
const PANEL_TOP = 0.62;
const AHEAD = 2.8;
const SPEED = (PANEL_TOP - PANEL_FOOT) / AHEAD;
const HALF_WIDTH = { white: 0.0098, black: 0.0058 };
const GAP = 0.0015;
/** Radius of the light at the foot of the panel above a key that sounds, m, and how fast it goes, 1/s. */
const GLOW_RADIUS = 0.035;
const GLOW_DECAY = 6;

const BAR_VERTEX = /* glsl */ `
  varying vec2 place;
  varying vec2 halfSize;
  varying vec3 tint;
  varying float height;
  void main() {
    halfSize = 0.5 * vec2(length(instanceMatrix[0].xyz), length(instanceMatrix[1].xyz));
    place = position.xy * 2.0 * halfSize;
    tint = instanceColor;
    vec4 world = modelMatrix * instanceMatrix * vec4(position, 1.0);
    height = world.z;
    gl_Position = projectionMatrix * viewMatrix * world;
  }`;

const BAR_FRAGMENT = /* glsl */ `
  varying vec2 place;
  varying vec2 halfSize;
  varying vec3 tint;
  varying float height;
  uniform float top;
  void main() {
    float radius = min(0.0035, min(halfSize.x, halfSize.y));
    vec2 corner = abs(place) - halfSize + radius;
    float distance = length(max(corner, 0.0)) + min(max(corner.x, corner.y), 0.0) - radius;
    float blur = fwidth(distance) + 1e-6;
    float cover = 1.0 - smoothstep(-blur, 0.0, distance);
    float rim = 1.0 - smoothstep(0.0, 0.0035, -distance);
    float fade = 1.0 - smoothstep(top - 0.2, top - 0.05, height);
    gl_FragColor = vec4(tint * (0.82 + 0.35 * rim), cover * fade);
    #include <colorspace_fragment>
  }`;

const GLOW_VERTEX = /* glsl */ `
  varying vec2 place;
  varying vec3 tint;
  void main() {
    place = position.xy * 2.0;
    tint = instanceColor;
    gl_Position = projectionMatrix * modelViewMatrix * instanceMatrix * vec4(position, 1.0);
  }`;

const GLOW_FRAGMENT = /* glsl */ `
  varying vec2 place;
  varying vec3 tint;
  void main() {
    float light = max(0.0, 1.0 - length(place));
    gl_FragColor = vec4(tint * light * light, 1.0);
    #include <colorspace_fragment>
  }`;

/** Notes that come down the panel onto their keys, and light where keys sound. */
export class FallingNotes {
  readonly group = new Group();
  private readonly glow: InstancedMesh;
  private readonly brightness: Float32Array;
  private readonly glowColor: Color[];
  private bars: InstancedMesh | null = null;
  private notes: readonly RollNote[] = [];
  private timestep = 0;
  private time = 0;

  /**
   * @param keyY (88) places of the keys along the keyboard, m.
   * @param keyIsBlack (88) whether they are black.
   */
  constructor(
    private readonly keyY: readonly number[],
    private readonly keyIsBlack: readonly boolean[],
  ) {
    const material = new ShaderMaterial({
      vertexShader: GLOW_VERTEX,
      fragmentShader: GLOW_FRAGMENT,
      blending: AdditiveBlending,
      transparent: true,
      depthWrite: false,
    });
    this.glow = new InstancedMesh(new PlaneGeometry(1, 1), material, keyY.length);
    this.glow.frustumCulled = false;
    this.glow.renderOrder = 2;
    this.brightness = new Float32Array(keyY.length);
    this.glowColor = keyY.map(() => new Color());
    keyY.forEach((y, key) => {
      this.glow.setMatrixAt(key, onPanel(0.006, y, PANEL_FOOT + 0.004, 2 * GLOW_RADIUS, 2 * GLOW_RADIUS));
      this.glow.setColorAt(key, new Color(0, 0, 0));
    });
    this.group.add(this.glow);
  }

  /** Show other notes, in order of their first steps. */
  show(notes: readonly RollNote[], timestep: number): void {
    this.bars?.removeFromParent();
    this.bars?.dispose();
    this.notes = notes;
    this.timestep = timestep;
    const material = new ShaderMaterial({
      vertexShader: BAR_VERTEX,
      fragmentShader: BAR_FRAGMENT,
      uniforms: { top: { value: PANEL_TOP } },
      transparent: true,
      depthWrite: false,
    });
    this.bars = new InstancedMesh(new PlaneGeometry(1, 1), material, Math.max(1, mostAtOnce(notes, timestep)));
    this.bars.instanceMatrix.setUsage(DynamicDrawUsage);
    this.bars.frustumCulled = false;
    this.bars.renderOrder = 1;
    this.bars.setColorAt(0, new Color());
    this.group.add(this.bars);
    this.brightness.fill(0);
  }

  /**
   * Move everything to a time.
   *
   * @param time s since the start of the episode.
   * @param elapsed s since the last call, by which light has faded.
   * @param sounding (88) which keys sound.
   * @param due (88) which should.
   */
  update(time: number, elapsed: number, sounding: Uint8Array, due: Uint8Array): void {
    this.moveBars(time, sounding);
    // Light fades also with time that was played without being shown.
    this.fadeGlow(Math.max(elapsed, Math.abs(time - this.time)), sounding, due);
    this.time = time;
  }

  private moveBars(time: number, sounding: Uint8Array): void {
    const bars = this.bars;
    if (bars === null) return;
    let count = 0;
    for (const note of this.notes) {
      const first = note.first * this.timestep - time;
      const end = note.end * this.timestep - time;
      if (first >= AHEAD) break;
      if (end <= 0) continue;
      const low = Math.max(first, 0) * SPEED;
      const high = Math.min(end, AHEAD) * SPEED;
      const half = this.keyIsBlack[note.key] ? HALF_WIDTH.black : HALF_WIDTH.white;
      const height = Math.max(high - low - 2 * GAP, GAP);
      const middle = PANEL_FOOT + (low + high) / 2;
      bars.setMatrixAt(count, onPanel(0.004, this.keyY[note.key]!, middle, 2 * half, height));
      const begun = first < 0;
      const color = begun ? (sounding[note.key] ? PRESSED_COLOR : MISSED_COLOR) : fingerColor(note.finger);
      bars.setColorAt(count, linear(color, scratch));
      count++;
    }
    bars.count = count;
    bars.instanceMatrix.needsUpdate = true;
    bars.instanceColor!.needsUpdate = true;
  }

  private fadeGlow(elapsed: number, sounding: Uint8Array, due: Uint8Array): void {
    for (let key = 0; key < sounding.length; key++) {
      if (sounding[key]) {
        // Bright as it begins, then as long as it sounds at half the light.
        const rest = 0.5;
        const now = this.brightness[key]!;
        this.brightness[key] = now === 0 ? 1 : Math.max(rest, now - elapsed * GLOW_DECAY * 0.25);
        linear(due[key] ? PRESSED_COLOR : WRONG_COLOR, this.glowColor[key]!);
      } else {
        this.brightness[key] = Math.max(0, this.brightness[key]! - elapsed * GLOW_DECAY);
      }
      this.glow.setColorAt(key, scratch.copy(this.glowColor[key]!).multiplyScalar(this.brightness[key]!));
    }
    this.glow.instanceColor!.needsUpdate = true;
  }
}

const scratch = new Color();
const matrix = new Matrix4();

/** A unit square as a rectangle on the panel, with its face to the player; `lift` m before it. */
function onPanel(lift: number, y: number, z: number, width: number, height: number): Matrix4 {
  // Columns: the square's x goes along the keyboard, its y upwards, its face towards the player.
  return matrix.set(0, 0, 1, PANEL + lift, width, 0, 0, y, 0, height, 0, z, 0, 0, 0, 1);
}

/** The largest number of notes that are on the panel at once. */
function mostAtOnce(notes: readonly RollNote[], timestep: number): number {
  const ahead = AHEAD / timestep;
  const ends = notes.map((note) => note.end).sort((a, b) => a - b);
  let most = 0;
  let gone = 0;
  notes.forEach((note, i) => {
    while (ends[gone]! <= note.first - ahead) gone++;
    most = Math.max(most, i + 1 - gone);
  });
  return most;
}
