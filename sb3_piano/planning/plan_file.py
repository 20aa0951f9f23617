"""Files of plans, so that a refined plan need not be computed again."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import sb3_piano
from sb3_piano.array_files import read_arrays
from sb3_piano.arrays import Arrays
from sb3_piano.engine import mujoco
from sb3_piano.exceptions import ConfigError, one_line
from sb3_piano.files import write_atomically
from sb3_piano.hands import DEFAULT_HAND, find_hand
from sb3_piano.music import PianoRoll
from sb3_piano.planning.hand_plan import HandPlan, HandTask
from sb3_piano.planning.plan import HandTasks, Plan
from sb3_piano.planning.settings import PlanSettings
from sb3_piano.settings import Index, checked
from sb3_piano.simulation import PianoScene

FORMAT = 1
"""Version of the files."""

_MOST_OF_HEADER, _MOST_OF_STEP = 2**20, 2**14
"""Most bytes of a file's header, and of the numbers of a control step (two hands: about 6000)."""

_OF_HAND = ("weightless", "positions", "commands", "gains")
_EXPECTED = "expected a file that 'sb3-piano plan PIECE --refine MINUTES' wrote"


def roll_digest(roll: PianoRoll) -> str:
    """Compute the SHA-256 of a roll: its keys, times, pedal and fingers."""
    digest = hashlib.sha256(repr((roll.control_timestep, roll.early_releases)).encode())
    for array in (roll.active, roll.finger, roll.onset, roll.onset_time, roll.sustain):
        digest.update(array.tobytes())
    return digest.hexdigest()


def save_plan(
    path: str | os.PathLike[str],
    plan: Plan,
    roll: PianoRoll,
    scene: PianoScene,
    settings: PlanSettings,
    **notes: float,
) -> None:
    """Write a plan to a file, replacing an existing one.

    Args:
        path: The file, which should end in ``.npz``.
        plan: The plan.
        roll: The roll of the plan, with fingers.
        scene: The piano and the hands of the plan.
        settings: The settings of the plan.
        **notes: Further numbers about the plan, such as ``f1``.
    """
    header = {
        "format": FORMAT,
        "roll": roll_digest(roll),
        "scene": _described(scene),
        "passes": plan.passes,
        "settings": dataclasses.asdict(settings),
        "versions": {"sb3_piano": sb3_piano.__version__, "mujoco": mujoco.__version__},
        "notes": notes,
    }
    arrays = {
        f"{name}_{i}": getattr(h, name) for i, h in enumerate(plan.hands) for name in _OF_HAND
    }
    text = np.frombuffer(json.dumps(header).encode(), dtype=np.uint8)
    write: Any = np.savez_compressed  # its stub mistakes array names for options
    write_atomically(
        Path(path), lambda file: write(file, header=text, arm_line=plan.arm_line, **arrays)
    )


def settings_of_plan(path: str | os.PathLike[str]) -> PlanSettings:
    """Read the settings of a file's plan.

    Raises:
        ConfigError: If the file cannot be read.
    """
    try:
        header = read_arrays(path, ["header"])["header"]
        return PlanSettings(**json.loads(header.tobytes())["settings"])
    except Exception as error:  # a damaged file fails in any way
        raise ConfigError(f"'{path}' cannot be read ({one_line(error)}): {_EXPECTED}.") from error


def load_plan(path: str | os.PathLike[str], roll: PianoRoll, scene: PianoScene) -> Plan:
    """Load the plan of a file.

    Args:
        path: The file.
        roll: The piano roll to play, with fingers.
        scene: The piano and the hands to play it with.

    Raises:
        ConfigError: If the file cannot be read, or has a plan of another piece or for another
            scene.
    """
    try:
        most = _MOST_OF_HEADER + len(roll) * _MOST_OF_STEP
        content = read_arrays(path, ["header"], most)
        header = json.loads(content["header"].tobytes())
        if header["format"] != FORMAT:
            raise ValueError(f"its format is {header['format']}, not {FORMAT}")
        _check(header, roll, scene)
        content = read_arrays(path, most=most)
        settings = PlanSettings(**header["settings"])
        tasks = HandTasks.of(roll, scene, settings)
        line = _numbers(content, "arm_line", len(roll) + 1)
        hands = tuple(_hand_plan(content, i, task) for i, task in enumerate(tasks.of_hands))
        return tasks.plan(hands, line, scene, checked("passes", header["passes"], Index))
    except _MisfitError as error:
        raise ConfigError(f"The plan '{path}' {error}") from None
    except Exception as error:  # a damaged file fails in any way
        raise ConfigError(f"'{path}' cannot be read ({one_line(error)}): {_EXPECTED}.") from error


def _hand_plan(content: Arrays, index: int, task: HandTask) -> HandPlan:
    """Read the plan of a hand with n actuators in T steps."""
    steps, n = task.frames.target.shape[0] - 1, len(task.hand.rest)
    shapes = [(steps + 1, n), (steps + 1, n), (steps, n), (steps, n, n)]
    numbers = {
        name: _numbers(content, f"{name}_{index}", *shape)
        for name, shape in zip(_OF_HAND, shapes, strict=True)
    }
    return HandPlan(task=task, **numbers)


def _numbers(content: Arrays, name: str, *shape: int) -> Any:
    array = content[name]
    if array.shape != shape or array.dtype.kind != "f" or not np.isfinite(array).all():
        raise ValueError(f"{name} is {array.dtype} {array.shape}: expected finite numbers {shape}")
    return array


class _MisfitError(Exception):
    """The plan is of another piece, or for another scene."""


def _check(header: Mapping[str, Any], roll: PianoRoll, scene: PianoScene) -> None:
    if header["roll"] != roll_digest(roll):
        raise _MisfitError(
            "is of another piece, or of other fingers, times or control steps: expected a plan of "
            "what is played here. 'sb3-piano plan PIECE --refine MINUTES' makes one."
        )
    here = _described(scene)
    # Files of earlier versions do not name the hand, nor the joints of its forearms.
    default = {"hand": DEFAULT_HAND, "forearm_dofs": list(find_hand().forearm_dofs())}
    made = {**default, **header["scene"]}
    other = [n for n in here if made.get(n) != here[n]]
    if other:
        told = ", ".join(f"{n} {made.get(n)!r}, here {here[n]!r}" for n in other)
        raise _MisfitError(
            f"is for another scene ({told}): expected it in a scene as it was made for."
        )


def _described(scene: PianoScene) -> dict[str, Any]:
    """Return the options that a scene was compiled with, in JSON's types."""
    plain: dict[str, Any] = json.loads(json.dumps(dict(scene.options), default=str))
    return plain
