import {
  BoxGeometry,
  Color,
  Group,
  InstancedMesh,
  Mesh,
  MeshLambertMaterial,
  MeshStandardMaterial,
  Object3D,
} from "three";
import { RoundedBoxGeometry } from "three/examples/jsm/geometries/RoundedBoxGeometry.js";

import { KEY_IS_BLACK } from "../music/constants";
import { NUM_KEYS } from "../types";
import { linear, type Rgb } from "./colors";
import { placeBetween, type Pose } from "./pose";
import { bodyGeometry, keyOf, type Stage, type StageGeom } from "./stage";

/** What a ray from the camera meets first. */
export type Hit = { readonly key: number } | { readonly body: string };

/** Furniture, keys and hands as three.js objects: one for what stands still, two for the keys, one for each link. */
export class StageObjects {
  readonly group = new Group();
  /** Bodies by number that have a mesh of their own. */
  private readonly links: { readonly mesh: Mesh; readonly body: number }[] = [];
  private readonly keys: KeyMeshes;

  /**
   * @param bodyNames Names of the bodies, in the order of poses.
   * @param plain Draw with cheaper shapes.
   */
  constructor(stage: Stage, bodyNames: readonly string[], plain: boolean) {
    const byBody = new Map<string, StageGeom[]>();
    for (const geom of stage.geoms) byBody.set(geom.body, [...(byBody.get(geom.body) ?? []), geom]);
    const fixed: StageGeom[] = [];
    const keyGeoms: { geom: StageGeom; body: number }[] = [];
    const skin = newMaterial(0.55, plain);
    skin.vertexColors = true;
    for (const [name, geoms] of byBody) {
      const body = bodyNames.indexOf(name);
      const key = keyOf(name);
      if (key !== null) keyGeoms[key] = { geom: geoms[0], body };
      else if (body <= 0 || name === "piano/") fixed.push(...geoms);
      else this.addLink(new Mesh(bodyGeometry(stage, geoms), skin), body, name);
    }
    const lacquer = newMaterial(0.28, plain);
    lacquer.vertexColors = true;
    const furniture = new Mesh(bodyGeometry(stage, fixed), lacquer);
    furniture.receiveShadow = true;
    this.keys = new KeyMeshes(keyGeoms, plain);
    this.group.add(furniture, ...this.keys.meshes);
  }

  /** Put everything where it is between two poses. */
  place(from: Pose, to: Pose, share: number): void {
    for (const { mesh, body } of this.links) placeBetween(mesh, body, from, to, share);
    this.keys.place(from, to, share);
  }

  /** Color a key, or give it back its own colour. */
  paint(key: number, rgb: Rgb | null): void {
    this.keys.paint(key, rgb);
  }

  /** What an intersection with one of the objects belongs to; null for what stands still. */
  hitOf(object: Object3D, instance: number | undefined): Hit | null {
    if (instance !== undefined) {
      const key = this.keys.keyAt(object, instance);
      return key === null ? null : { key };
    }
    return object.name === "" ? null : { body: object.name };
  }

  private addLink(mesh: Mesh, body: number, name: string): void {
    mesh.name = name;
    mesh.castShadow = true;
    mesh.receiveShadow = true;
    this.links.push({ mesh, body });
    this.group.add(mesh);
  }
}

/** The 88 keys, white and black ones as instances of one box each. */
class KeyMeshes {
  readonly meshes: readonly InstancedMesh[];
  private readonly keysOf: readonly (readonly number[])[];
  private readonly own: readonly Color[];
  private readonly slot = new Int32Array(NUM_KEYS);

  constructor(
    private readonly keys: readonly { geom: StageGeom; body: number }[],
    plain: boolean,
  ) {
    const numbers = keys.map((_, key) => key);
    this.keysOf = [false, true].map((black) => numbers.filter((key) => KEY_IS_BLACK[key] === black));
    this.own = keys.map(({ geom }) => linear(geom.rgba.slice(0, 3) as unknown as Rgb));
    this.meshes = this.keysOf.map((those, black) => this.instances(those, black === 1, plain));
  }

  place(from: Pose, to: Pose, share: number): void {
    this.meshes.forEach((mesh, kind) => {
      this.keysOf[kind].forEach((key, slot) => {
        placeBetween(scratch, this.keys[key].body, from, to, share);
        scratch.updateMatrix();
        mesh.setMatrixAt(slot, scratch.matrix);
      });
      mesh.instanceMatrix.needsUpdate = true;
    });
  }

  paint(key: number, rgb: Rgb | null): void {
    const mesh = this.meshes[KEY_IS_BLACK[key] ? 1 : 0];
    mesh.setColorAt(this.slot[key], rgb === null ? this.own[key] : linear(rgb, scratchColor));
    mesh.instanceColor!.needsUpdate = true;
  }

  keyAt(object: Object3D, instance: number): number | null {
    const kind = this.meshes.indexOf(object as InstancedMesh);
    return kind < 0 ? null : this.keysOf[kind][instance];
  }

  private instances(those: readonly number[], black: boolean, plain: boolean): InstancedMesh {
    const { size } = this.keys[those[0]].geom;
    const [x, y, z] = size.map((half) => 2 * half);
    // A small gap, so that neighbours are told apart from any side.
    const width = y - 0.0004;
    const box = plain ? new BoxGeometry(x, width, z) : new RoundedBoxGeometry(x, width, z, 1, 0.0012);
    const mesh = new InstancedMesh(box, newMaterial(black ? 0.3 : 0.38, plain), those.length);
    mesh.castShadow = black;
    mesh.receiveShadow = true;
    mesh.frustumCulled = false;
    those.forEach((key, slot) => {
      this.slot[key] = slot;
      mesh.setColorAt(slot, this.own[key]);
    });
    return mesh;
  }
}

/** A surface; without a graphics processor that of `plain` takes a fifth of the time. */
function newMaterial(roughness: number, plain: boolean): MeshLambertMaterial | MeshStandardMaterial {
  return plain ? new MeshLambertMaterial() : new MeshStandardMaterial({ roughness });
}

const scratch = new Object3D();
const scratchColor = new Color();
