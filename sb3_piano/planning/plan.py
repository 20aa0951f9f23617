"""From a score to a motion of the hands that plays it.

A roll with its final fingers becomes presses, presses become key frames, key frames the plans of
the hands, and these a plan. Each is a value made by a function; all but the hands' plans are cheap.
"""

from __future__ import annotations

import contextlib
import functools
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from sb3_piano.arrays import FloatArray
from sb3_piano.exceptions import ScoreError
from sb3_piano.music import PianoRoll, Score
from sb3_piano.music.constants import UNKNOWN_FINGER
from sb3_piano.music.fingering import apply_fingering
from sb3_piano.planning.hand import Hand
from sb3_piano.planning.hand_plan import HandPlan, HandPlans, HandTask, plan_hands
from sb3_piano.planning.problems import problems_of
from sb3_piano.planning.settings import PlanSettings
from sb3_piano.reading import KeyPlaces, both_hands, read_piece
from sb3_piano.reading.problems import Problem
from sb3_piano.simulation import PianoScene
from sb3_piano.simulation.scene import SIDES

_DEFAULT_TIMESTEP = 0.05


@dataclass(frozen=True, eq=False, kw_only=True)
class Plan:
    """Motion of the hands of a scene through a piece of T steps; n are the scene's actuators."""

    roll: PianoRoll
    """The piece, with the fingers that play it; without, where a hand lets go of a note."""
    hands: tuple[HandPlan, ...]
    """The plans of the hands that are there, the right one first."""
    arm_line: FloatArray
    """(T + 1,) line between the arms, m."""
    problems: tuple[Problem, ...]
    """Notes that cannot be played as written, in order of time."""
    passes: int = 0
    """Passes of refinement that it went through. From the first one on its motion is one that came
    out in a simulation, and comes out again where everything is as it was there."""

    def __len__(self) -> int:
        return len(self.roll)

    @functools.cached_property
    def positions(self) -> FloatArray:
        """(T + 1, n) where the actuators should be before the first control step and after each.

        In rad, or m for the sliders.
        """
        return np.concatenate([hand.positions for hand in self.hands], axis=1)

    @functools.cached_property
    def commands(self) -> FloatArray:
        """(T, n) what they are told for that, if all goes as planned."""
        return np.concatenate([hand.commands for hand in self.hands], axis=1)

    @functools.cached_property
    def fingertips(self) -> FloatArray:
        """(T + 1, 5 h, 3) where the fingertips of h hands are: centres of their round ends, m."""
        tips = [hand.task.hand.kinematics.fingertips(hand.positions) for hand in self.hands]
        return np.concatenate(tips, axis=1)


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
        piece: A score, which gets the fingers that suit the hands; or a roll with fingers.
        scene: The piano and the hands. One that is alone plays what it has fingers for.
        settings: The plan's settings.
        control_timestep: Length of a control step, s; a whole number of physics steps. A roll
            brings its own.

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
    if settings.passes == 0:
        return made
    from sb3_piano.planning.refinement import Refinement  # here, as it builds on plans

    with contextlib.closing(Refinement(made, scene, settings)) as refinement:
        refinement.run(passes=settings.passes)
        return refinement.plan


class HandTasks(NamedTuple):
    """Tasks of all hands in a piece, which are known before a motion is planned."""

    roll: PianoRoll
    """The piece; without fingers where a hand lets go of a note."""
    of_hands: list[HandTask]
    """The task of each hand of the scene, the right one's first."""
    places: list[FloatArray]
    """Where across the keys each hand would be if it were alone, (T + 1,) m."""
    line: FloatArray
    """Where the line between the arms may begin, (T + 1,) m."""

    @classmethod
    def of(cls, roll: PianoRoll, scene: PianoScene, settings: PlanSettings) -> HandTasks:
        """Read a roll with fingers."""
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
        )
        readings = [read.hands[side] for side in sides]
        hands = [Hand.of(scene, side, keys, n_substeps) for side in sides]
        pairs = zip(hands, readings, strict=True)
        tasks = [HandTask(hand, one.presses, one.frames) for hand, one in pairs]
        return cls(read.roll, tasks, [one.place for one in readings], read.line)

    def plan(self, hands: HandPlans, line: FloatArray, scene: PianoScene, passes: int = 0) -> Plan:
        """Return the plan in which hands move along a line between the arms, (T + 1,) m."""
        problems = problems_of(self.roll, hands, scene)
        return Plan(roll=self.roll, hands=hands, arm_line=line, problems=problems, passes=passes)


def _of_hands(roll: PianoRoll, scene: PianoScene) -> PianoRoll:
    """Return a roll without the fingers of hands that are not there."""
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
