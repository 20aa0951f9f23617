"""Planning of the hands' motion through a piece, stretch by stretch."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from sb3_piano.arrays import Float32Array, FloatArray
from sb3_piano.music.constants import THUMB
from sb3_piano.music.fingering.leaps import TimedPress
from sb3_piano.planning.hand import Hand
from sb3_piano.planning.hand_cost import HandCost
from sb3_piano.planning.least_squares import HandProblem, Smoothness
from sb3_piano.planning.settings import PlanSettings
from sb3_piano.planning.side_by_side import (
    Exchange,
    in_two_processes,
    may_start_processes,
    run_interleaved,
)
from sb3_piano.planning.tracking_control import TrackingControl
from sb3_piano.reading.key_frames import KeyFrames
from sb3_piano.reading.piece import bounds_of

_MANY_STRETCHES = 4  # least number for which a second process saves more time than its start takes
_UP = 2
_GIVING_WAY = 3.0  # motion of the line between the arms, per distance beyond it


@dataclass(frozen=True, eq=False)
class HandTask:
    """Task of one hand."""

    hand: Hand
    presses: tuple[TimedPress, ...]
    """The planned presses."""
    frames: KeyFrames
    """Targets of the fingertips in all T + 1 states."""


@dataclass(frozen=True, eq=False, kw_only=True)
class HandPlan:
    """Motion of one hand with n actuators through T control steps, in rad, or m for sliders."""

    task: HandTask
    """Task of the hand."""
    weightless: FloatArray
    """(T + 1, n) planned positions of the actuators without inertia."""
    positions: FloatArray
    """(T + 1, n) planned positions."""
    commands: FloatArray
    """(T, n) commands for these positions."""
    gains: Float32Array
    """(T, n, n) feedback gains: decrease of the commands per unit of positions beyond the plan."""


HandPlans = tuple[HandPlan, ...]
"""Plans of the hands of a scene, the right one first."""


def plan_hands(
    tasks: Sequence[HandTask],
    wanted: Sequence[FloatArray],
    line: FloatArray,
    settings: PlanSettings,
    control_timestep: float,
) -> tuple[HandPlans, FloatArray]:
    """Plan the motions of the hands, the right one first, and the line between the arms.

    ``wanted`` are the places of each hand by itself across the keys, ``line`` is the initial line
    between the arms, all (T + 1,) m.
    """
    stretches = tuple(_stretches(len(line), settings, control_timestep))
    pairs = zip(tasks, wanted, strict=True)
    parts = [_Part(task, places, line, stretches, settings) for task, places in pairs]
    if len(parts) == 2 and len(stretches) >= _MANY_STRETCHES and may_start_processes():
        found = in_two_processes(_planned, parts[0], parts[1])
    else:
        found = run_interleaved(_planned, parts)
    (_, line), *_ = found
    # A plan from another process has a copy of its task.
    plans = (replace(plan, task=task) for (plan, _), task in zip(found, tasks, strict=True))
    return tuple(plans), line


class _Part(NamedTuple):
    """Input of one hand's planning; see :func:`plan_hands`."""

    task: HandTask
    wanted: FloatArray
    line: FloatArray
    stretches: tuple[tuple[int, int, int], ...]
    settings: PlanSettings


def _planned(part: _Part) -> Exchange[FloatArray, tuple[HandPlan, FloatArray]]:
    """Plan a hand in lock step with the others.

    Each hand yields the distance of its arm beyond its bound, (s,) m, and receives those of all.
    """
    task, settings, line = part.task, part.settings, part.line.copy()
    motion, hand = _Motion(task, settings), task.hand.kinematics.hand
    apart = settings.arms_apart
    if apart is None:
        apart = task.hand.kinematics.spec.forearm.apart
    for start, stop, keep in part.stretches:
        here = line[start:stop]
        bound = bounds_of(here, apart)[hand]
        guess = _guess(task.hand, part.wanted[start:stop], bound)
        problem = motion.problem(start, stop, bound, guess)
        for turn in range(settings.rounds):
            if turn > 0:
                beyond = yield problem.cost.bound_violation(problem.positions)
                if len(beyond) > 1:
                    # The arm farther beyond the line gets more room.
                    here = here - _GIVING_WAY * (beyond[0] - beyond[1])
                    problem.rebound(bounds_of(here, apart)[hand])
            problem.improve(settings.iterations)
        line[start:keep] = here[: keep - start]
        motion.extend(problem, keep)
    return motion.plan(), line


class _Motion:
    """The motion of a hand up to some state."""

    def __init__(self, task: HandTask, settings: PlanSettings):
        self.task, self._settings = task, settings
        size = task.hand.kinematics.size
        self._stop = 1
        self._weightless = [np.zeros((1, size))]
        self._states = [np.zeros((1, 2 * size))]
        self._commands: list[FloatArray] = []
        self._gains: list[Float32Array] = []

    def problem(self, start: int, stop: int, bound: FloatArray, guess: FloatArray) -> HandProblem:
        """Make the least-squares problem of the next states, ``start`` to ``stop - 1``.

        The arm must stay beyond ``bound``, (s,) m; ``guess``, (s, n), are the initial positions.
        """
        hand, frames = self.task.hand, self.task.frames.between(start, stop)
        cost = HandCost(hand.kinematics, hand.arm, frames, bound)
        # Before the first state the hand has the same positions.
        before = np.concatenate([self._weightless[0], *self._weightless[-2:]])[-2:]
        return HandProblem(cost, Smoothness(hand.kinematics, before, stop - start), hand, guess)

    def extend(self, problem: HandProblem, keep: int) -> None:
        """Append the states of a solved stretch up to ``keep``, with the hand's inertia."""
        task, planned, count = self.task, problem.positions, keep - self._stop
        forces = _key_forces(task, planned, self._stop, self._settings)
        control = TrackingControl(
            problem.cost,
            task.hand.dynamics,
            planned,
            forces,
            self._states[-1][-1],
            self._settings.dynamic_iterations,
        ).solve()
        self._weightless.append(planned[:count])
        self._states.append(control.states[:count].copy())
        self._commands.append(control.commands[:count].copy())
        self._gains.append(control.gains[:count].astype(np.float32))
        self._stop = keep

    def plan(self) -> HandPlan:
        """Return the plan up to this state."""
        size = self.task.hand.kinematics.size
        return HandPlan(
            task=self.task,
            weightless=np.concatenate(self._weightless),
            positions=np.concatenate(self._states)[:, :size],
            commands=np.concatenate(self._commands),
            gains=np.concatenate(self._gains),
        )


def _guess(hand: Hand, wanted: FloatArray, bound: FloatArray) -> FloatArray:
    """Make an initial guess: the resting posture at the hand's places, (s, n)."""
    kinematics = hand.kinematics
    guess = np.tile(hand.rest, (len(wanted), 1))
    place = kinematics.sign * np.maximum(kinematics.sign * wanted, kinematics.sign * bound)
    slider, along = (place - kinematics.middle) / kinematics.slope, kinematics.along
    guess[:, along] = np.clip(slider, kinematics.low[along], kinematics.high[along])
    return guess


def _key_forces(
    task: HandTask, positions: FloatArray, start: int, settings: PlanSettings
) -> FloatArray:
    """Compute the forces of held keys on the actuators, (s, n), from state ``start`` on."""
    keys = task.hand.keys
    tips, jacobian = task.hand.kinematics.fingertips_and_jacobian(positions)
    forces = np.zeros_like(positions)
    for one in task.presses:
        key, finger = one.press.key, one.press.finger
        first, stop = max(one.first - start, 0), min(one.last + 1 - start, len(positions))
        if first >= stop:
            continue
        firmness = settings.press_force_thumb if finger == THUMB else settings.press_force
        torque = keys.holding_torque[key]
        lever = tips[first:stop, finger, 0] - keys.hinge[key]
        force = firmness * torque / lever
        forces[first:stop] += force[:, None] * jacobian[first:stop, finger, _UP]
    return forces


def _stretches(
    n_states: int, settings: PlanSettings, control_timestep: float
) -> Iterator[tuple[int, int, int]]:
    """Yield each stretch: its first state, its end, and the end of its kept states."""
    window = max(round(settings.window / control_timestep), 1)
    overlap = max(round(settings.overlap / control_timestep), 1)
    start = 1
    while start < n_states:
        keep = start + window
        if keep + overlap >= n_states:  # a short remainder is included
            keep = n_states
        yield start, min(keep + overlap, n_states), keep
        start = keep
