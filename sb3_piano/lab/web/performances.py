"""Takes and plans of a piece as files for the web page."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import safetensors.numpy

from sb3_piano.envs import PianoEnv, PianoEnvConfig
from sb3_piano.exceptions import ConfigError
from sb3_piano.hands import DEFAULT_HAND, find_hand
from sb3_piano.music import Score
from sb3_piano.planning import Plan, PlanSettings, Tracker
from sb3_piano.planning.hand_plan import HandPlan
from sb3_piano.players import PlayerSpec, TreeSettings, rollout
from sb3_piano.players.hand_model import SIGHT_READER
from sb3_piano.players.planned import Trackers, action_of
from sb3_piano.take import SUFFIX, Motion, Take
from sb3_piano.training.playing.player import PLANNED_IN, OpenPlayer
from sb3_piano.training.playing.takes import FILE_NAME, take_of

# Gains make up most of a plan; rounded to 1/254 of the largest they take a quarter of the space.
_GAIN_STEPS = 127

# Numbers of a take's motion are rounded to multiples of 1/8192, 0.1 mm or 0.1 mrad: it is read from
# the file, not simulated, and takes a third of the space.
_MOTION_STEPS = 2**13

_FOLDERS = re.compile(r"[^=:,]*[/\\]")  # in the text of a player

_FOREARM = find_hand(DEFAULT_HAND).forearm_dofs()
"""Joints of the forearms that the page shows."""


def sight_read(score: Score, tree: TreeSettings | None = None) -> Take:
    """Play a piece with the sight-reader in the page's environment.

    Args:
        score: The piece.
        tree: Settings of a tree search.

    Raises:
        ScoreError: If the score cannot be played.
    """
    spec = PlayerSpec(name=SIGHT_READER, tree=tree)
    with contextlib.closing(PianoEnv(score, **PLANNED_IN)) as env:
        return replace(next(rollout(spec.make(env), env)), player=str(spec))


def follow_plan(score: Score) -> tuple[Take, Plan, Score]:
    """Play a piece by its plan; return the take, the plan rounded as in its file, and the fingers.

    The plan is followed as on the page, by its feedback alone.

    Raises:
        ScoreError: If the score cannot be played.
    """
    with contextlib.closing(PianoEnv(score, **PLANNED_IN)) as env:
        env.reset(seed=0)
        settings = PlanSettings()
        plan = rounded(Trackers(settings).of(env).plan)
        follower = _Follower(env, Tracker(plan, env.scene, settings.feedback))
        return replace(next(rollout(follower, env)), player="planned"), plan, env.score


@dataclass(frozen=True)
class _Follower:
    """Player that follows a plan by its feedback alone."""

    piano: PianoEnv
    tracker: Tracker

    def predict(self, observation: Any, *arguments: Any, **named: Any) -> tuple[Any, Any]:
        """Return the action that follows the plan."""
        del observation, arguments, named  # it has the same positions with less precision
        step = self.piano.steps_played
        controls = self.tracker.controls(step, self.piano.data.actuator_length)
        return action_of(self.piano, controls, self.tracker, step), None


def rounded(plan: Plan) -> Plan:
    """Return a plan with its numbers rounded as by :func:`plan_file`."""
    return replace(plan, hands=tuple(_rounded_hand(hand) for hand in plan.hands))


def plan_file(plan: Plan) -> bytes:
    """Return a rounded plan of T steps as a safetensors file.

    It has ``commands``, (T, nu) float32; ``positions``, (T, nu) float32, the actuators' targets
    before each step; ``gains``, (T, h, n, n) int8, the change of each of the h hands' commands per
    deviation of its actuators, in units of ``gain_unit``, (h, n) float32, one per column; and in
    the metadata ``feedback``, the factor of the gains.
    """
    units = [_gain_unit(hand) for hand in plan.hands]
    gains = [np.rint(h.gains / u).astype(np.int8) for h, u in zip(plan.hands, units, strict=True)]
    tensors = {
        "commands": plan.commands.astype(np.float32),
        "positions": plan.positions[:-1].astype(np.float32),
        "gains": np.stack(gains, axis=1),
        "gain_unit": np.stack(units),
    }
    return safetensors.numpy.save(tensors, {"feedback": str(PlanSettings().feedback)})


def take_of_run(run: str | os.PathLike[str]) -> Take:
    """Let a run play once; return the take.

    Raises:
        ConfigError: If the page cannot show its hands, or ``run`` is no folder.
        RunError: If there is no run, or its environment is no piano.
    """
    with OpenPlayer.open(str(run)) as player:
        return _shown(take_of(player), f"Run '{run}'")


def read_takes(paths: Sequence[str | os.PathLike[str]]) -> list[Take]:
    """Read takes for the page from files and folders: of ``play``, or with nothing but takes.

    Raises:
        ConfigError: If a file is no take, the page cannot show its hands, or a folder has none.
    """
    takes = []
    for path in map(Path, paths):
        played = path / f"{FILE_NAME}{SUFFIX}"
        files = sorted(path.glob(f"*{SUFFIX}")) if path.is_dir() else [path]
        files = [played] if played.is_file() else files
        if not files:
            raise ConfigError(f"'{path}' has no take: expected files such as {FILE_NAME}{SUFFIX}.")
        takes += [_shown(Take.read(file), f"'{file}'") for file in files]
    return takes


def write_small(take: Take, path: Path) -> None:
    """Write a take whose motion is rounded to 0.1 mm and 0.1 mrad, and no folder is named."""
    motion = take.motion
    assert motion is not None, "a piano's take has a motion"
    names = ("actions", "qpos", "fingertips")
    rounded: dict[str, Any] = {name: _few_digits(getattr(motion, name)) for name in names}
    small = Motion(hand_qpos=motion.hand_qpos, **rounded)
    replace(take, motion=small, player=_FOLDERS.sub("", take.player)).write(path)


def _few_digits(array: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
    rounded: npt.NDArray[np.float32] = (np.rint(array * _MOTION_STEPS) / _MOTION_STEPS).astype("f4")
    return rounded


def _shown(take: Take, name: str) -> Take:
    """Return a take if the page can show it.

    Raises:
        ConfigError: If it has other hands or other control steps.
    """
    options, step = take.scene_options, take.piano.roll.control_timestep
    if options["hand"] != DEFAULT_HAND or tuple(options["forearm_dofs"]) != _FOREARM:
        problem = (
            f"its hand is {options['hand']!r}, with the forearm's joints {options['forearm_dofs']}"
        )
    elif step != PianoEnvConfig.control_timestep:
        problem = f"its control steps last {step} s"
    else:
        return take
    raise ConfigError(
        f"{name} cannot be shown on the page: {problem}. Expected {DEFAULT_HAND!r}, {_FOREARM} and "
        f"{PianoEnvConfig.control_timestep} s."
    )


def _rounded_hand(hand: HandPlan) -> HandPlan:
    unit = _gain_unit(hand)
    return replace(
        hand,
        positions=hand.positions.astype(np.float32).astype(float),
        commands=hand.commands.astype(np.float32).astype(float),
        gains=np.rint(hand.gains / unit) * unit,
    )


def _gain_unit(hand: HandPlan) -> npt.NDArray[np.float32]:
    """Return the unit of each column of a hand's gains, (n,)."""
    largest = np.abs(hand.gains).max(axis=(0, 1))
    unit: npt.NDArray[np.float32] = np.where(largest > 0, largest / _GAIN_STEPS, 1.0)
    return unit.astype(np.float32)
