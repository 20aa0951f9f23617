"""Plans: motions of the hands that play a score.

A roll with its final fingers becomes presses, presses become key frames, key frames become the
hands' plans, and these become a plan. Only the hands' plans take long to compute.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from sb3_piano.arrays import FloatArray
from sb3_piano.exceptions import ScoreError
from sb3_piano.music import PianoRoll, Score
from sb3_piano.music.constants import UNKNOWN_FINGER
from sb3_piano.music.fingering import apply_fingering
from sb3_piano.music.fingering.problems import Problem
from sb3_piano.planning.hand import Hand
from sb3_piano.planning.hand_plan import HandPlan, HandPlans, HandTask, plan_hands
from sb3_piano.planning.problems import problems_of
from sb3_piano.planning.settings import PlanSettings
from sb3_piano.reading import KeyPlaces, both_hands, read_piece
from sb3_piano.simulation import PianoScene
from sb3_piano.simulation.scene import SIDES

_DEFAULT_TIMESTEP = 0.05


@dataclass(frozen=True, eq=False, kw_only=True)
class Plan:
    """Motion of a scene's hands, with n actuators in all, through a piece of T control steps."""

    roll: PianoRoll
    """The piece with its fingers; notes released early have no finger after the release."""
    hands: tuple[HandPlan, ...]
    """Plans of the hands in the scene, the right one first."""
    arm_line: FloatArray
    """(T + 1,) line between the arms, m."""
    problems: tuple[Problem, ...]
    """Notes that cannot be played as written, in order of time."""
    passes: int = 0
    """Number of passes of refinement. After one or more, its motion is that of a simulation, and is
    exactly reproducible under the same conditions."""

    def __len__(self) -> int:
        return len(self.roll)

    @functools.cached_property
    def positions(self) -> FloatArray:
        """(T + 1, n) planned actuator positions before the first control step and after each.

        In rad, or m for the sliders.
        """
        return np.concatenate([hand.positions for hand in self.hands], axis=1)

    @functools.cached_property
    def commands(self) -> FloatArray:
        """(T, n) commands for these positions, without corrections."""
        return np.concatenate([hand.commands for hand in self.hands], axis=1)

    @functools.cached_property
    def fingertips(self) -> FloatArray:
        """(T + 1, 5 h, 3) fingertips of h hands, as centres of their round ends, m."""
        tips = [hand.task.hand.kinematics.fingertips(hand.positions) for hand in self.hands]
        return np.concatenate(tips, axis=1)


def plan(
    piece: Score | PianoRoll,
    scene: PianoScene,
    settings: PlanSettings | None = None,
    *,
    control_timestep: float = _DEFAULT_TIMESTEP,
) -> Plan:
    """Plan the hands' motion through a piece, from the first note to the last one.

    The hands start with all joints at 0, as in the environment. Time and memory grow with the
    length of the piece. Pieces longer than :attr:`PlanSettings.window` are planned in stretches,
    each with a view of the next one's beginning.

    Notes that cannot be played as written are planned as nearly as possible, and listed in
    ``problems``.

    Args:
        piece: A score, which gets fingers that suit the hands; or a roll with fingers.
        scene: The piano and the hands. A single hand plays the notes with its fingers.
        settings: The plan's settings.
        control_timestep: Length of a control step of a score, s; a whole number of physics steps. A
            roll has its own.

    Raises:
        ScoreError: If no note of a roll has a finger, or no fingers can be found for a score.
    """
    settings = settings or PlanSettings()
    if isinstance(piece, Score):
        score = apply_fingering(piece, "robot", control_timestep, robot=scene.hand)
        piece = PianoRoll.from_score(score, control_timestep)
    piece = _of_hands(piece, scene)
    _check_fingers(piece)
    tasks = HandTasks.of(piece, scene, settings)
    hands, line = plan_hands(
        tasks.of_hands, tasks.places, tasks.line, settings, piece.control_timestep
    )
    made = tasks.plan(hands, line, scene)
    passes = settings.passes + settings.dynamics
    if passes == 0:
        return made
    from sb3_piano.planning.refinement import Refinement  # imports this module

    refinement = Refinement(made, scene, settings)
    refinement.run(passes=passes)
    return refinement.plan


class HandTasks(NamedTuple):
    """Tasks of all hands in a piece, before a motion is planned."""

    roll: PianoRoll
    """The piece; notes released early have no finger after the release."""
    of_hands: list[HandTask]
    """Task of each hand of the scene, the right one first."""
    places: list[FloatArray]
    """Places of each hand by itself across the keys, (T + 1,) m."""
    line: FloatArray
    """Initial line between the arms, (T + 1,) m."""

    @classmethod
    def of(cls, roll: PianoRoll, scene: PianoScene, settings: PlanSettings) -> HandTasks:
        """Read the tasks from a roll with fingers."""
        keys = KeyPlaces.of(scene)
        n_substeps = round(roll.control_timestep / scene.model.opt.timestep)
        sides = [SIDES.index(name) for name in scene.sides]
        read = read_piece(
            roll,
            both_hands(scene),
            keys,
            hover=settings.hover,
            arms_apart=settings.arms_apart,
            hold_depth=settings.hold_depth,
            stretch=settings.stretch,
            hurry=settings.hurry,
            leave_early=settings.leave_early,
            dynamics=settings.dynamics > 0,
        )
        readings = [read.hands[side] for side in sides]
        hands = [Hand.of(scene, side, keys, n_substeps) for side in sides]
        pairs = zip(hands, readings, strict=True)
        tasks = [HandTask(hand, one.presses, one.frames) for hand, one in pairs]
        return cls(read.roll, tasks, [one.place for one in readings], read.line)

    def plan(self, hands: HandPlans, line: FloatArray, scene: PianoScene, passes: int = 0) -> Plan:
        """Make the plan of the hands' plans and their line between the arms, (T + 1,) m."""
        problems = problems_of(self.roll, hands, scene)
        return Plan(roll=self.roll, hands=hands, arm_line=line, problems=problems, passes=passes)


def _of_hands(roll: PianoRoll, scene: PianoScene) -> PianoRoll:
    """Remove the fingers of absent hands from a roll."""
    there = np.isin(roll.finger, scene.fingers)
    if there[roll.active].all():
        return roll
    return replace(roll, finger=np.where(there, roll.finger, UNKNOWN_FINGER))


def _check_fingers(roll: PianoRoll) -> None:
    if roll.active.any() and (roll.finger[roll.active] == UNKNOWN_FINGER).all():
        raise ScoreError(
            "No note of the roll has a finger: expected fingers to plan with. Plan the score "
            "itself, or give it fingers with sb3_piano.music.fingering.apply_fingering."
        )
