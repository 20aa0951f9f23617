"""Refinement of a plan: it is played in a simulation, and what goes wrong is tried otherwise.

Collisions, friction and the keys' own dynamics are in no plan. A round of refinement (a rehearsal)
adjusts touch or timing of some presses that went wrong, a few control steps apart from each other,
plans again from there, plays the piece, and keeps each change after which its own surroundings
sound better. It is a random search, but one in which all parts of a piece are searched at once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import mujoco
import numpy as np

from sb3_piano.arrays import BoolArray, FloatArray
from sb3_piano.envs.actions import ActionMap
from sb3_piano.metrics.frames import count_frames
from sb3_piano.music import PianoRoll
from sb3_piano.planning.hand_plan import HandPlans, replan_hands
from sb3_piano.planning.settings import PlanSettings
from sb3_piano.planning.tracker import corrected
from sb3_piano.reading.presses import TimedPress
from sb3_piano.simulation import PianoScene, Simulation

Timed = list[list[TimedPress]]

# What is heard so many control steps before and after a note belongs to it.
_MARGIN = 3
# From so many states earlier on the hands may move otherwise.
_LEAD = 3
_SEED = 0
# After so many rounds what was kept of them is played on its own.
_TRIALS_IN_A_ROW = 4


def refine_hands(
    hands: HandPlans, line: FloatArray, roll: PianoRoll, scene: PianoScene, settings: PlanSettings
) -> HandPlans:
    """Return the plans of the hands that sounded best in simulation; ``line`` is (T + 1,) m."""
    rng = np.random.default_rng(_SEED)
    timed: Timed = [list(hand.task.presses) for hand in hands]

    def replanned(
        before: HandPlans, presses: Timed, free: BoolArray
    ) -> tuple[HandPlans, FloatArray]:
        made = replan_hands(before, presses, line, free, settings, roll.control_timestep)
        return made, _errors(made, roll, scene, settings)

    best, errors = hands, _errors(hands, roll, scene, settings)
    least = errors.sum()
    rounds = settings.rehearsals
    for number in range(1, rounds + 1):
        changed, trials = _vary(timed, errors, rng)
        if not trials:
            break
        tried, new_errors = replanned(hands, changed, _around(trials, len(roll)))
        rejected = []
        for trial in trials:
            if new_errors[trial.steps].sum() < errors[trial.steps].sum() - 1e-9:
                timed[trial.hand][trial.number] = changed[trial.hand][trial.number]
            else:
                rejected.append(trial)
        old = _around(rejected, len(roll))
        errors = np.where(old[1:], errors, new_errors)
        hands = _mixed(hands, tried, old)
        if number % _TRIALS_IN_A_ROW == 0 or number == rounds:
            # All that was kept, and nothing else.
            hands, errors = replanned(hands, timed, _around([], len(roll)))
            if errors.sum() < least:
                least, best = errors.sum(), hands
    return best


def _mixed(before: HandPlans, after: HandPlans, old: BoolArray) -> HandPlans:
    """Return new plans whose ways are those from before in some states."""
    return tuple(
        replace(new, weightless=np.where(old[:, None], was.weightless, new.weightless))
        for was, new in zip(before, after, strict=True)
    )


class _Trial(NamedTuple):
    """A press with another adjustment or timing."""

    hand: int
    number: int
    steps: slice
    """The control steps that belong to it."""


def _around(trials: Sequence[_Trial], n_steps: int) -> BoolArray:
    """Return which states may differ because of some trials, (T + 1,) bool."""
    states = np.zeros(n_steps + 1, dtype=bool)
    for trial in trials:
        states[max(trial.steps.start - _LEAD, 1) : trial.steps.stop + 1] = True
    return states


def _errors(
    hands: HandPlans, roll: PianoRoll, scene: PianoScene, settings: PlanSettings
) -> FloatArray:
    """Play, and return what each control step lacks to an F1 of 1, (T,)."""
    counts = count_frames(roll.active, _heard(hands, roll, scene, settings.feedback))
    sounds = counts.played + counts.due
    return np.where(sounds > 0, 1 - 2 * counts.hit / np.maximum(sounds, 1), 0.0)


def _heard(hands: HandPlans, roll: PianoRoll, scene: PianoScene, feedback: float) -> BoolArray:
    """Play, and return which keys sound after each control step, (T, 88)."""
    # To the last bit what a pianist in the environment does: many passages are chaotic.
    positions = np.concatenate([hand.positions for hand in hands], axis=1)
    commands = np.concatenate([hand.commands for hand in hands], axis=1)
    n_substeps = round(roll.control_timestep / scene.model.opt.timestep)
    actions, simulation = ActionMap(scene), Simulation(scene, n_substeps)
    data = simulation.data
    mujoco.mj_step1(scene.model, data)
    sounding = np.zeros_like(roll.active)
    for step in range(len(sounding)):
        observed = scene.actuator_positions(data.qpos[scene.hand_qpos].astype(np.float32))
        gains = [hand.gains[step] for hand in hands]
        told = corrected(commands[step], observed - positions[step], gains, feedback)
        told = np.clip(told, scene.ctrl_low, scene.ctrl_high)
        controls, _ = actions.controls(actions.action(told, pedal_down=False))
        if not simulation.advance(controls):
            break  # the physics became unstable: nothing more is heard
        sounding[step] = scene.key_angle(data) >= scene.key_sounding_angle
    return sounding


def _vary(timed: Timed, errors: FloatArray, rng: np.random.Generator) -> tuple[Timed, list[_Trial]]:
    """Change some of the presses around which something went wrong.

    Returns:
        All presses, and those that were changed.
    """
    changed: Timed = [list(presses) for presses in timed]
    candidates = [
        (hand, index) for hand, presses in enumerate(timed) for index in range(len(presses))
    ]
    taken = np.zeros(len(errors), dtype=bool)
    trials = []
    for which in rng.permutation(len(candidates)).tolist():
        hand, index = candidates[which]
        press = timed[hand][index].press
        # The control step that leads to state s is s - 1.
        start = max(press.first - 1 - _MARGIN, 0)
        stop = min(press.last + _MARGIN, len(errors))
        lead = max(start - _LEAD - 1, 0)
        if errors[start:stop].sum() <= 0 or taken[lead:stop].any():
            continue
        taken[lead:stop] = True
        ways = _adjustments(timed[hand][index])
        changed[hand][index] = ways[int(rng.integers(len(ways)))](rng)
        trials.append(_Trial(hand, index, slice(start, stop)))
    return changed, trials


def _adjustments(one: TimedPress) -> Sequence[Callable[[np.random.Generator], TimedPress]]:
    """Return the ways to change a press at random."""
    press, adjustment = one.press, one.adjustment

    def adjusted(**changes: float) -> TimedPress:
        return replace(one, adjustment=replace(adjustment, **changes))

    ways: list[Callable[[np.random.Generator], TimedPress]] = [
        lambda rng: adjusted(
            ready=float(np.clip(adjustment.ready + rng.normal(0, 0.2), -1.0, 0.6))
        ),
        lambda rng: adjusted(firmness=float(adjustment.firmness * np.exp(rng.normal(0, 0.4)))),
        lambda rng: adjusted(
            along=float(np.clip(adjustment.along + rng.normal(0, 0.004), -0.02, 0.02))
        ),
        lambda rng: adjusted(
            across=float(np.clip(adjustment.across + rng.normal(0, 0.0025), -0.006, 0.006))
        ),
    ]
    if one.first > press.first:
        ways += [lambda rng: replace(one, first=one.first - 1)] * 2
    if one.last < press.last:
        ways += [lambda rng: replace(one, last=one.last + 1)] * 2
    if one.first < one.last:
        ways += [
            lambda rng: replace(one, first=one.first + 1),
            lambda rng: replace(one, last=one.last - 1),
        ]
    return ways
