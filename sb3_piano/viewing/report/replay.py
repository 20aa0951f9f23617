"""Data for a replay in three dimensions, which a report shows without a simulation."""

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
"""Resolution of positions, m: they are 16-bit integers."""

SCRIPT = "replay.js"
"""The replay's script among the templates; ``make replay`` bundles ``web/src/replay``."""

_QUATERNION_UNIT = 32767


@dataclass(frozen=True, eq=False, kw_only=True)
class Replay:
    """The replay's script and its files."""

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
    """Make the replay of an episode of t control steps.

    Args:
        scene: Scene of the performance.
        qpos: (t + 1, nq) joint positions before and after each control step, rad or m.
        performance: The performance.
        metrics: The episode's numbers, ``f1`` among them.
        script: The replay's script, see :func:`player_script`.
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
    """Return the replay's JavaScript.

    Raises:
        ConfigError: If this installation lacks it.
    """
    file = _script_file()
    if not file.is_file():
        raise ConfigError(
            f"The player for three dimensions, {SCRIPT}, is not in this installation. In a clone, "
            "'make replay' builds it, with Node.js 20; then install the package again."
        )
    # A script must not contain the end tag of its element.
    return file.read_text(encoding="utf-8").replace("</script", "<\\/script")


def _poses(model: mujoco.MjModel, qpos: FloatArray) -> Any:
    """Compute the pose of each body in each state, (bodies, t + 1, 7) int16.

    Bodies come first, as the constant poses of resting ones then compress well.
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
