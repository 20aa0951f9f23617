"""Notes of a piece that a plan does not play as written."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sb3_piano.music import PianoRoll
from sb3_piano.music.constants import FINGERS_PER_HAND
from sb3_piano.music.fingering.problems import Problem, problem_of, unheld
from sb3_piano.planning.hand_plan import HandPlan
from sb3_piano.simulation import PianoScene

# Least error at which a note is out of reach, m: a white key is 23.5 mm wide, a fingertip 13 mm.
_TOLERANCE = 0.006


def problems_of(
    roll: PianoRoll, hands: Sequence[HandPlan], scene: PianoScene
) -> tuple[Problem, ...]:
    """Find the notes that are not played as written, in order of time, one problem for each."""
    found = unheld(roll)
    told = {(problem.pitch, problem.time) for problem in found}
    of_hands = [
        problem
        for plan in hands
        for problem in _unplayed(plan, roll.control_timestep, scene.moving_keys)
    ]
    found += [one for one in of_hands if (one.pitch, one.time) not in told]
    return tuple(sorted(found, key=lambda problem: problem.time))


def _unplayed(plan: HandPlan, timestep: float, moving: slice) -> list[Problem]:
    """Find a hand's notes on rigid keys, then other notes that no finger reaches."""
    rigid, unreached = [], []
    frames, side = plan.task.frames, plan.task.hand.kinematics.hand
    tips = plan.task.hand.kinematics.fingertips(plan.weightless)
    for one in plan.task.presses:
        press, states = one.press, slice(one.first, one.last + 1)
        note = press.key, press.first - 1, side * FINGERS_PER_HAND + press.finger
        if not moving.start <= press.key < moving.stop:
            rigid.append(problem_of(timestep, *note, "its key is rigid in this scene"))
            continue
        off = tips[states, press.finger, 1:] - frames.target[states, press.finger, 1:]
        error = float(np.abs(off).max(initial=0.0))
        if error > _TOLERANCE:
            reason = f"out of reach by {1000 * error:.0f} mm"
            unreached.append(problem_of(timestep, *note, reason, error))
    return rigid + unreached
