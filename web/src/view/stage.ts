import {
  BoxGeometry,
  BufferAttribute,
  BufferGeometry,
  CapsuleGeometry,
  CylinderGeometry,
  Matrix4,
  PlaneGeometry,
  Quaternion,
  SphereGeometry,
  Vector3,
} from "three";
import { mergeGeometries } from "three/examples/jsm/utils/BufferGeometryUtils.js";

import type { Assets } from "../types";
import { fingerColor, linear, type Rgb } from "./colors";

/** A shape to draw, in the frame of its body; sizes are MuJoCo's, quaternions w x y z, colours sRGB. */
export interface StageGeom {
  readonly body: string;
  readonly type: "plane" | "sphere" | "capsule" | "ellipsoid" | "cylinder" | "box" | "mesh";
  readonly size: readonly number[];
  readonly pos: readonly number[];
  readonly quat: readonly number[];
  readonly rgba: readonly number[];
  /** Which of the meshes, for type mesh. */
  readonly mesh: number | null;
  /** Of a fingertip its finger, from 0, the thumb. */
  readonly finger: number | null;
}

/** Corners, (n, 3) m, and triangles, (m, 3) indices, one after the other. */
export interface StageMesh {
  readonly vertices: Float32Array;
  readonly faces: Uint16Array;
}

/** Everything that is drawn and does not come from the piece. */
export interface Stage {
  readonly geoms: readonly StageGeom[];
  readonly meshes: readonly StageMesh[];
}

/** Where the numbers of an array are in stage.bin: offset in bytes, and how many there are. */
type Span = readonly [number, number];

/** Load the assets stage.json and stage.bin, which Python's `sb3_piano.viewing.stage_files` writes. */
export async function loadStage(assets: Assets): Promise<Stage> {
  const [{ geoms, meshes }, bytes] = await Promise.all([
    assets.json<{ geoms: StageGeom[]; meshes: { vertices: Span; faces: Span }[] }>("stage.json"),
    assets.bytes("stage.bin"),
  ]);
  // A copy, as the bytes need not begin where a float32 may.
  const buffer = bytes.slice().buffer;
  return {
    geoms,
    meshes: meshes.map(({ vertices, faces }) => ({
      vertices: new Float32Array(buffer, ...vertices),
      faces: new Uint16Array(buffer, ...faces),
    })),
  };
}

const KEY_BODY = /_key_(\d+)$/;

/** Number of the key whose body it is, or null. */
export function keyOf(body: string): number | null {
  const found = KEY_BODY.exec(body);
  return found === null ? null : Number(found[1]);
}

/** The shapes of a body as one geometry with colours at its corners; fingertips have their finger's. */
export function bodyGeometry(stage: Stage, geoms: readonly StageGeom[]): BufferGeometry {
  return mergeGeometries(geoms.map((geom) => coloredGeometry(stage, geom)));
}

function coloredGeometry(stage: Stage, geom: StageGeom): BufferGeometry {
  const geometry = shapeOf(stage, geom);
  geometry.deleteAttribute("uv");
  const [w, x, y, z] = geom.quat as [number, number, number, number];
  const place = new Vector3().fromArray(geom.pos);
  geometry.applyMatrix4(new Matrix4().compose(place, new Quaternion(x, y, z, w), new Vector3(1, 1, 1)));
  const rgb = geom.finger === null ? (geom.rgba.slice(0, 3) as unknown as Rgb) : fingerColor(geom.finger);
  const color = linear(rgb);
  const count = geometry.getAttribute("position").count;
  const colors = new Float32Array(count * 3);
  for (let i = 0; i < count; i++) color.toArray(colors, 3 * i);
  geometry.setAttribute("color", new BufferAttribute(colors, 3));
  return geometry;
}

function shapeOf(stage: Stage, geom: StageGeom): BufferGeometry {
  const [a, b, c] = geom.size as [number, number, number];
  switch (geom.type) {
    case "box":
      return new BoxGeometry(2 * a, 2 * b, 2 * c);
    case "plane":
      return new PlaneGeometry(2 * a, 2 * b);
    case "sphere":
      return new SphereGeometry(a, 16, 10);
    case "ellipsoid":
      return new SphereGeometry(1, 16, 10).scale(a, b, c);
    // MuJoCo's stand along z, three.js's along y.
    case "capsule":
      return new CapsuleGeometry(a, 2 * b, 5, 14).rotateX(Math.PI / 2);
    case "cylinder":
      return new CylinderGeometry(a, a, 2 * b, 20).rotateX(Math.PI / 2);
    case "mesh":
      return meshGeometry(stage.meshes[geom.mesh!]!);
  }
}

function meshGeometry(mesh: StageMesh): BufferGeometry {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(mesh.vertices.slice(), 3));
  geometry.setIndex(new BufferAttribute(mesh.faces, 1));
  geometry.computeVertexNormals();
  return geometry;
}
