"""The simulated scene for MuJoCo elsewhere: its XML, and indices of its state."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from sb3_piano.envs.actions import hand_action_unit
from sb3_piano.simulation import PianoScene, compile_scene
from sb3_piano.simulation.compiling import attach_parts, scene_parts
from sb3_piano.simulation.exact_xml import exact_xml


def scene_xml(scene: PianoScene) -> str:
    """Return a scene as MJCF that compiles to the identical model.

    MuJoCo 3.14 can read it: textures are left out, and so is the ``input`` of servos, which has its
    default value.
    """
    spec = attach_parts(scene_parts(**scene.options))
    for texture in list(spec.textures):
        spec.delete(texture)
    spec.compile()
    return exact_xml(spec).replace(' input="pos"', "")


def scene_facts(scene: PianoScene, n_substeps: int) -> dict[str, Any]:
    """Return addresses, indices and constants of a scene with hands whose 88 keys all move.

    The names are those of ``SceneFacts`` in ``web/src/simulation/facts.ts``.

    Args:
        scene: The scene.
        n_substeps: Physics steps in a control step.
    """
    model = scene.model
    key_body = model.geom_bodyid[scene.key_geom]
    return {
        "substeps": n_substeps,
        "bodyNames": [model.body(i).name for i in range(model.nbody)],
        "keyQpos": scene.key_qpos.tolist(),
        "keyDof": model.jnt_dofadr[model.body_jntadr[key_body]].tolist(),
        "keyMaxAngle": scene.key_max_angle.tolist(),
        "keySoundingAngle": scene.key_sounding_angle.tolist(),
        "ctrlLow": scene.ctrl_low.tolist(),
        "ctrlHigh": scene.ctrl_high.tolist(),
        "handActionUnit": hand_action_unit(scene).tolist(),
        "handQpos": scene.hand_qpos.tolist(),
        "reducedHandQpos": _reduced_hand_qpos(scene),
        "actuatorOfJoint": _nonzero(scene.actuator_of_joint),
        "hands": [
            {"qpos": qpos.tolist(), "dof": model.jnt_dofadr[joints].tolist()}
            for qpos, joints in zip(scene.joint_qpos, scene.joints, strict=True)
        ],
        "fingertipGeom": scene.fingertip_geom.tolist(),
        "counts": {name: int(getattr(model, name)) for name in _COUNTS},
    }


_COUNTS = ("nq", "nv", "nu", "nbody", "ngeom")


def _reduced_hand_qpos(scene: PianoScene) -> list[int]:
    """Return the addresses of the hands' joints that a scene with reduced actions has, too."""
    reduced = compile_scene(**{**scene.options, "reduced_action_space": True})
    names = itertools.chain(*reduced.joint_names)
    return [int(scene.model.joint(name).qposadr[0]) for name in names]


def _nonzero(matrix: np.ndarray[Any, np.dtype[np.float64]]) -> list[list[list[float]]]:
    """Return column and value of the non-zero entries of each row."""
    return [[[int(c), float(row[c])] for c in np.flatnonzero(row)] for row in matrix]
