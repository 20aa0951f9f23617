"""Export the stage, the scene of videos, for drawing without MuJoCo."""

from __future__ import annotations

from typing import Any

import numpy as np

from sb3_piano.engine import mujoco
from sb3_piano.simulation import PianoScene
from sb3_piano.viewing.stage import staged

_MESH = int(mujoco.mjtGeom.mjGEOM_MESH)


def stage_files(scene: PianoScene) -> tuple[dict[str, Any], bytes]:
    """Return the shapes to draw, and the binary data of their meshes.

    Returns:
        ``geoms``: visible geoms, each with the name of its body, type, size, pos, quat (MuJoCo's, w
        first), rgba, for a mesh its index, and for a fingertip its finger, from 0, the thumb.
        ``meshes``: for each of them the location of its ``vertices`` and ``faces`` in the bytes,
        [offset in bytes, count of numbers].

        The bytes: float32 vertices, (n, 3) m, and uint16 faces, (m, 3) indices of vertices.
    """
    stage = staged(scene)
    model = stage.model
    seen = [g for g in range(model.ngeom) if _rgba(model, g)[3] > 0]
    shown = sorted({int(model.geom_dataid[g]) for g in seen if model.geom_type[g] == _MESH})
    meshes, parts, size = [], [], 0
    for mesh in shown:
        entry = {}
        for name, numbers in zip(("vertices", "faces"), _mesh(model, mesh), strict=True):
            entry[name] = [size, numbers.size]
            content = numbers.tobytes()
            padded = content + bytes(-len(content) % 4)  # aligns every array for float32
            parts.append(padded)
            size += len(padded)
        meshes.append(entry)
    tip_bodies = model.geom_bodyid[stage.fingertip_geom].tolist()
    count = len(scene.hand.fingers)
    finger = {body: tip % count for tip, body in enumerate(tip_bodies)}
    geoms = [_geom(model, g, shown, finger) for g in seen]
    return {"geoms": geoms, "meshes": meshes}, b"".join(parts)


def _geom(
    model: mujoco.MjModel, geom: int, shown: list[int], finger: dict[int, int]
) -> dict[str, Any]:
    kind = mujoco.mjtGeom(model.geom_type[geom])
    return {
        "body": model.body(int(model.geom_bodyid[geom])).name,
        "type": kind.name.removeprefix("mjGEOM_").lower(),
        "size": _short(model.geom_size[geom]),
        "pos": _short(model.geom_pos[geom]),
        "quat": _short(model.geom_quat[geom]),
        "rgba": _short(_rgba(model, geom)),
        "mesh": shown.index(int(model.geom_dataid[geom])) if kind == _MESH else None,
        "finger": finger.get(int(model.geom_bodyid[geom])),
    }


def _rgba(model: mujoco.MjModel, geom: int) -> Any:
    material = int(model.geom_matid[geom])
    return model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]


def _mesh(model: mujoco.MjModel, mesh: int) -> tuple[Any, Any]:
    """Return the vertices of a mesh's hull, float32, and its triangles, uint16."""
    first, count = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    faces = model.mesh_face[first : first + count]
    used, numbered = np.unique(faces, return_inverse=True)  # inner vertices have no triangle
    vertices = model.mesh_vert[int(model.mesh_vertadr[mesh]) + used]
    return vertices.astype("<f4"), numbered.reshape(faces.shape).astype("<u2")


def _short(numbers: Any) -> list[float]:
    return [round(float(number), 6) for number in numbers]
