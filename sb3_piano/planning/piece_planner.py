"""The plan of both hands, made stretch by stretch, and made again."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from sb3_piano.music import PianoRoll
from sb3_piano.planning.arms import bounds_of, dividing_line, wanted_places
from sb3_piano.planning.hand_plan import HandPlanner
from sb3_piano.planning.key_places import KeyPlaces
from sb3_piano.planning.leaps import TimedPress
from sb3_piano.planning.settings import PlanSettings
from sb3_piano.simulation import PianoScene

FloatArray = npt.NDArray[np.float64]


class PiecePlanner:
    """Plans the stretches of a piece one after the other.

    Args:
        roll: The piece, all notes with fingers.
        scene: The piano and the hands.
        settings: The plan's constants.
    """

    def __init__(self, roll: PianoRoll, scene: PianoScene, settings: PlanSettings):
        self._roll, self._settings = roll, settings
        n_substeps = round(roll.control_timestep / scene.model.opt.timestep)
        keys = KeyPlaces.of(scene)
        right, left = (
            HandPlanner(roll, scene, hand, keys, settings, n_substeps) for hand in (0, 1)
        )
        self.hands = (right, left)
        """The right and the left hand, with what is planned for them so far."""
        wanted = [
            wanted_places(hand.frames, hand.kinematics.sign, hand.posture, keys)
            for hand in self.hands
        ]
        self._wanted = [place for place, _ in wanted]
        self._line = dividing_line(self._wanted, [busy for _, busy in wanted], settings)

    def plan(self) -> None:
        """Plan the whole piece."""
        for start, stop, keep in self._stretches():
            line = self._line[start:stop]
            problems = [
                hand.begin(start, stop, bound, wanted[start:stop])
                for hand, bound, wanted in zip(
                    self.hands, bounds_of(line, self._settings), self._wanted, strict=True
                )
            ]
            for turn in range(int(self._settings.rounds)):
                if turn > 0:
                    # Who is pressed harder against the line gets more room.
                    right, left = (one.cost.bound_violation(one.positions) for one in problems)
                    line = line - (right - left)
                    bounds = bounds_of(line, self._settings)
                    for problem, bound in zip(problems, bounds, strict=True):
                        problem.rebound(bound)
                for problem in problems:
                    problem.improve(int(self._settings.iterations))
            self._line[start:keep] = line[: keep - start]
            for hand, problem in zip(self.hands, problems, strict=True):
                hand.finish(problem, start, keep)

    def replan(self, timed: Sequence[list[TimedPress]], free: npt.NDArray[np.bool_]) -> None:
        """Change when and how some keys are pressed, and adapt the last plan to that.

        Args:
            timed: The presses of the right and the left hand.
            free: (T + 1,) bool, the states in which the hands may move otherwise than before.
        """
        for hand, presses in zip(self.hands, timed, strict=True):
            hand.take(presses)
        for start, stop, keep in self._stretches():
            bounds = bounds_of(self._line[start:stop], self._settings)
            for hand, bound in zip(self.hands, bounds, strict=True):
                problem = hand.begin(start, stop, bound, None)
                if free[start:stop].any():
                    problem.improve(int(self._settings.iterations), free[start:stop])
                hand.finish(problem, start, keep)

    def _stretches(self) -> Iterator[tuple[int, int, int]]:
        """Yield the first state of each stretch, the one after its last, and after those kept."""
        timestep, last = self._roll.control_timestep, len(self._roll) + 1
        window = max(round(self._settings.window / timestep), 1)
        overlap = max(round(self._settings.overlap / timestep), 1)
        start = 1
        while start < last:
            keep = start + window
            if keep + overlap >= last:  # what little would remain is done at once
                keep = last
            yield start, min(keep + overlap, last), keep
            start = keep
