"""Performances and plans of a piece as arrays for the web page."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import safetensors.numpy

from sb3_piano.envs import PianoEnv
from sb3_piano.music import Score
from sb3_piano.planning import Plan, PlanSettings, Tracker
from sb3_piano.planning.hand_plan import HandPlan
from sb3_piano.players import Player, PlayerSpec, TreeSettings, rollout
from sb3_piano.players.hand_model import SIGHT_READER
from sb3_piano.players.planned import Trackers, action_of
from sb3_piano.training.playing.player import PLANNED_IN

# Gains make up most of a plan; rounded to 1/254 of the largest they take a quarter of the space.
_GAIN_STEPS = 127

# A difference of one bit may grow to a centimetre within two seconds of a piece with many contacts.
_STATE_EVERY = 10


@dataclass(frozen=True, kw_only=True)
class WebPerformance:
    """A player's performance of a piece."""

    score: Score
    """The piece, with the fingers that play it."""
    actions: npt.NDArray[np.float32]
    """(T, nu) actions of T control steps, in [-1, 1], without the pedal."""
    states: npt.NDArray[np.float32]
    """(T / 10, nq + nv) joint positions and velocities before each tenth step, the first included;
    rad and rad/s, m and m/s."""
    metrics: Mapping[str, float]
    """The music metrics, by their names in ``info``."""


def sight_read(score: Score, tree: TreeSettings | None = None) -> WebPerformance:
    """Play a piece with the sight-reader in the page's environment.

    Args:
        score: The piece.
        tree: Settings of a tree search.

    Raises:
        ScoreError: If the score cannot be played.
    """
    spec = PlayerSpec(name=SIGHT_READER, tree=tree)
    with contextlib.closing(PianoEnv(score, **PLANNED_IN)) as env:
        return _performance(spec.make(env), env)


def follow_plan(score: Score) -> tuple[WebPerformance, Plan]:
    """Play a piece by its plan; return the performance and the plan, rounded as in its file.

    The plan is followed as on the page, by its feedback alone.

    Raises:
        ScoreError: If the score cannot be played.
    """
    with contextlib.closing(PianoEnv(score, **PLANNED_IN)) as env:
        env.reset(seed=0)
        settings = PlanSettings()
        plan = rounded(Trackers(settings).of(env).plan)
        return _performance(_Follower(env, Tracker(plan, env.scene, settings.feedback)), env), plan


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


def recording_file(performance: WebPerformance) -> bytes:
    """Return a performance as a safetensors file: its ``actions`` and ``states``."""
    tensors = {"actions": performance.actions, "states": performance.states}
    return safetensors.numpy.save(tensors, {"state_every": str(_STATE_EVERY)})


def _performance(player: Player, piano: PianoEnv) -> WebPerformance:
    states = []

    def note_state(_: object = None) -> None:
        if piano.steps_played % _STATE_EVERY == 0 and piano.steps_played < len(piano.roll):
            states.append(np.concatenate([piano.data.qpos, piano.data.qvel]))

    played = rollout(player, piano, on_step=note_state)
    note_state()
    recording = next(played)
    assert recording.motion is not None, "a piano's episode has a motion"
    return WebPerformance(
        score=piano.score,
        actions=recording.motion.actions[:, :-1].copy(),
        states=np.array(states, dtype=np.float32),
        metrics=recording.metrics,
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
