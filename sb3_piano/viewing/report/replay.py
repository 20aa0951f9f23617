"""A performance in three dimensions, as the player in a report shows it without a simulation."""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from importlib.resources.abc import Traversable
from typing import Any

import numpy as np

from sb3_piano.arrays import FloatArray
from sb3_piano.engine import mujoco
from sb3_piano.exceptions import ConfigError
from sb3_piano.performance import Performance
from sb3_piano.simulation import PianoScene
from sb3_piano.viewing.stage_files import stage_files

RESOLUTION = 1e-4
"""Distance between two places that are told apart, m: positions are 16-bit integers."""

SCRIPT = "replay.js"
"""The player among the templates, which ``make replay`` bundles from ``web/src/replay``."""

_QUATERNION_UNIT = 32767


@dataclass(frozen=True, eq=False, kw_only=True)
class Replay:
    """What the player is given, and the player."""

    files: Mapping[str, str]
    """Files by name, each as gzip in base64."""
    script: str
    """Its JavaScript."""


def replay_of(
    scene: PianoScene,
    qpos: FloatArray,
    performance: Performance,
    metrics: Mapping[str, float],
    script: str,
) -> Replay:
    """Return the replay of an episode of t control steps.

    Args:
        scene: Scene in which it was played.
        qpos: (t + 1, nq) joint positions before and after each control step, rad or m.
        performance: What was played.
        metrics: The episode's numbers, ``f1`` among them.
        script: The player, see :func:`player_script`.
    """
    stage, shapes = stage_files(scene)
    model, roll = scene.model, performance.roll
    names = [model.body(body).name for body in range(model.nbody)]
    shown = ("f1", "precision", "recall", "onset_f1")
    facts = {
        "title": performance.title,
        "bodyNames": names,
        "resolution": RESOLUTION,
        "controlTimestep": roll.control_timestep,
        "metrics": {name: metrics[name] for name in shown},
    }
    files = {
        "facts.json": _json(facts),
        "stage.json": _json(stage),
        "stage.bin": shapes,
        "poses.bin": _poses(model, qpos).tobytes(),
        "sounding.bin": performance.key_active.astype(np.uint8).tobytes(),
        "active.bin": roll.active.astype(np.uint8).tobytes(),
        "finger.bin": roll.finger.astype(np.int8).tobytes(),
        "onset.bin": roll.onset.astype(np.uint8).tobytes(),
    }
    return Replay(files={name: _packed(content) for name, content in files.items()}, script=script)


def _script_file() -> Traversable:
    return resources.files("sb3_piano.viewing.report") / "templates" / SCRIPT


def player_script() -> str:
    """Return the player's JavaScript.

    Raises:
        ConfigError: If the package was installed without it.
    """
    file = _script_file()
    if not file.is_file():
        raise ConfigError(
            f"The player for three dimensions, {SCRIPT}, is not in this installation. In a clone, "
            "'make replay' builds it, with Node.js 20; then install the package again."
        )
    # The end of an element may not stand in a script.
    return file.read_text(encoding="utf-8").replace("</script", "<\\/script")


def _poses(model: mujoco.MjModel, qpos: FloatArray) -> Any:
    """Return where each body is in each state, (bodies, t + 1, 7) int16.

    Body by body, so that what stands still packs to nothing.
    """
    data = mujoco.MjData(model)
    poses = np.empty((model.nbody, len(qpos), 7), dtype="<i2")
    for state, positions in enumerate(qpos):
        data.qpos[:] = positions
        mujoco.mj_kinematics(model, data)
        poses[:, state, :3] = np.rint(data.xpos / RESOLUTION)
        poses[:, state, 3:] = np.rint(data.xquat * _QUATERNION_UNIT)
    return poses


def _json(content: Any) -> bytes:
    return json.dumps(content, separators=(",", ":")).encode()


def _packed(content: bytes) -> str:
    return base64.b64encode(gzip.compress(content, mtime=0)).decode("ascii")
