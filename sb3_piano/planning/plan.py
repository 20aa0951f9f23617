"""From a score to a motion of two hands that plays it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sb3_piano.exceptions import ScoreError
from sb3_piano.music import PianoRoll, Score
from sb3_piano.music.constants import UNKNOWN_FINGER
from sb3_piano.music.fingering import finger_score
from sb3_piano.planning.fingers import fit_fingers
from sb3_piano.planning.key_places import KeyPlaces
from sb3_piano.planning.piece_planner import PiecePlanner
from sb3_piano.planning.problems import Problem, fingerless, not_held
from sb3_piano.planning.rehearsal import rehearse
from sb3_piano.planning.settings import PlanSettings
from sb3_piano.simulation import PianoScene

FloatArray = npt.NDArray[np.float64]

_DEFAULT_TIMESTEP = 0.05


@dataclass(frozen=True, eq=False, kw_only=True)
class Plan:
    """Motion of two hands through a piece of T control steps; n are the scene's actuators."""

    roll: PianoRoll
    """The piece, with the fingers that play it; without, where a hand lets go of a note."""
    positions: FloatArray
    """(T + 1, n) where the actuators should be before the first control step and after each one,
    rad, or m for the sliders."""
    commands: FloatArray
    """(T, n) what they are told for that, if all goes as planned."""
    gains: tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]
    """For the right and the left hand: (T, n / 2, n / 2), by how much less commands are per unit of
    positions that are ahead of the plan."""
    fingertips: FloatArray
    """(T + 1, 10, 3) where the fingertips then are: centres of their round ends, m."""
    problems: tuple[Problem, ...]
    """Notes that cannot be played as written, in order of time."""

    def __len__(self) -> int:
        return len(self.commands)


def plan(
    piece: Score | PianoRoll,
    scene: PianoScene,
    settings: PlanSettings | None = None,
    *,
    control_timestep: float = _DEFAULT_TIMESTEP,
) -> Plan:
    """Plan how to play a piece, from the first note to the last one.

    The hands start with all joints at 0, as the environment's do. Time and memory grow with the
    length of the piece; beyond :attr:`PlanSettings.window` it is planned in stretches, each of
    which sees the beginning of the next one.

    Notes that cannot be played as written are planned as well as can be, and listed in
    ``problems``.

    Args:
        piece: A score, whose notes without fingers get some; or a roll with fingers.
        scene: The piano and the hands.
        settings: The plan's constants.
        control_timestep: Length of a control step, s; a whole number of physics steps. A roll
            brings its own.

    Raises:
        ScoreError: If no note of a roll has a finger, or no fingers can be found for a score.
    """
    settings = settings or PlanSettings()
    if isinstance(piece, Score):
        piece = PianoRoll.from_score(finger_score(piece), control_timestep)
    _check_fingers(piece)
    fitted = fit_fingers(piece, KeyPlaces.of(scene), settings)
    planner = PiecePlanner(fitted.roll, scene, settings)
    planner.plan()
    if settings.rehearsals > 0:
        rehearse(planner, fitted.roll, scene, settings)
    problems = fingerless(piece)
    for hand, gone in enumerate(fitted.early_releases):
        problems += not_held(gone, hand, piece.control_timestep)
    return _collect(planner, fitted.roll, problems)


def _collect(planner: PiecePlanner, roll: PianoRoll, problems: list[Problem]) -> Plan:
    right, left = planner.hands
    told = {(problem.pitch, problem.time) for problem in problems}
    of_hands = [*right.problems(), *left.problems()]
    problems += [one for one in of_hands if (one.pitch, one.time) not in told]
    return Plan(
        roll=roll,
        positions=np.concatenate([right.positions, left.positions], axis=1),
        commands=np.concatenate([right.commands, left.commands], axis=1),
        gains=(right.gains, left.gains),
        fingertips=np.concatenate([right.fingertips(), left.fingertips()], axis=1),
        problems=tuple(sorted(problems, key=lambda problem: problem.time)),
    )


def _check_fingers(roll: PianoRoll) -> None:
    if roll.active.any() and (roll.finger[roll.active] == UNKNOWN_FINGER).all():
        raise ScoreError(
            "No note of the roll has a finger: expected fingers to plan with. Plan the score "
            "itself, or give it fingers with sb3_piano.music.fingering.finger_score."
        )
