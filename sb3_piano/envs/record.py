"""The record of an episode: what sounded and what was earned in each control step."""

from __future__ import annotations

import operator
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from sb3_piano.envs.goal import Goal
from sb3_piano.envs.press_times import press_times
from sb3_piano.envs.reading import Reading
from sb3_piano.envs.rewards import RETURN_KEYS
from sb3_piano.envs.state import EnvState
from sb3_piano.metrics import KeyBoxes, nearest_fingers, normalized_return, presses_of
from sb3_piano.music.constants import NUM_FINGERS, NUM_KEYS
from sb3_piano.performance import Performance
from sb3_piano.simulation import PianoScene

FloatArray = npt.NDArray[np.float64]


class EpisodeRecord:
    """Grows by one control step at a time, up to the length of the roll."""

    def __init__(self, goal: Goal, scene: PianoScene):
        """Begin an empty record.

        Args:
            goal: What should be played.
            scene: Where it is played.
        """
        self._goal = goal
        self._scene = scene
        self._key_active = np.zeros((len(goal), NUM_KEYS), dtype=bool)
        self._sustain = np.zeros(len(goal), dtype=bool)
        self._fingertips = np.zeros((len(goal), NUM_FINGERS, 3))
        self._sounding = np.zeros(NUM_KEYS, dtype=bool)
        self._within: dict[int, npt.NDArray[np.bool_]] = {}  # of steps in which a key changed
        self._returns = [0.0] * len(RETURN_KEYS)  # plain numbers, faster to add than an array
        self.steps = 0
        """Control steps that are over."""

    def add(
        self,
        reading: Reading,
        key_angles: FloatArray,
        pedal_down: bool,
        weighted_terms: Mapping[str, float],
    ) -> None:
        """Note down a control step.

        Args:
            reading: The state at its end.
            key_angles: (p, 88) angle of each key after each physics step of it, rad.
            pedal_down: Whether the pedal is down.
            weighted_terms: The weighted reward terms, in the order of ``RETURN_KEYS``.
        """
        step, sounding = self.steps, reading.sounding
        if sounding.tobytes() != self._sounding.tobytes():  # the fastest way to compare them
            self._within[step] = key_angles >= self._scene.key_sounding_angle
        self._sounding = sounding
        self._key_active[step] = sounding
        self._sustain[step] = pedal_down
        self._fingertips[step] = reading.fingertips
        self._returns = list(map(operator.add, self._returns, weighted_terms.values()))
        self.steps = step + 1

    def performance(self) -> Performance:
        """Return a copy of what was played so far."""
        steps, roll = self.steps, self._goal.roll
        key_active = self._key_active[:steps].copy()
        strikes, releases = press_times(
            presses_of(key_active), self._within, roll.control_timestep, steps
        )
        return Performance(
            roll=roll,
            key_active=key_active,
            sustain=self._sustain[:steps].copy(),
            strike_time=strikes,
            release_time=releases,
            press_finger=nearest_fingers(
                key_active, self._fingertips[:steps], KeyBoxes(*self._scene.key_boxes)
            ),
            title=self._goal.score.title,
        )

    def summary(self) -> dict[str, float]:
        """Return the music metrics and the returns by name, as they stand in the final ``info``."""
        highest = self._goal.highest_return
        return {
            **self.performance().metrics(),
            "normalized_return": normalized_return(sum(self._returns), highest),
            **dict(zip(RETURN_KEYS, self._returns, strict=True)),
        }

    def save(self, *, physics: npt.NDArray[np.float64], finished: bool, pedal: float) -> EnvState:
        """Return a copy of the episode so far, with what the environment adds to it."""
        steps = slice(self.steps)
        return EnvState(
            physics=physics,
            score=self._goal.score,
            finished=finished,
            pedal=pedal,
            key_active=self._key_active[steps].copy(),
            sustain=self._sustain[steps].copy(),
            fingertips=self._fingertips[steps].copy(),
            within=dict(self._within),
            returns=np.array(self._returns),
        )

    def restore(self, state: EnvState) -> None:
        """Take over the steps that another record saved."""
        self.steps = state.step
        self._key_active[: self.steps] = state.key_active
        self._sustain[: self.steps] = state.sustain
        self._fingertips[: self.steps] = state.fingertips
        self._within = dict(state.within)
        self._sounding = self._key_active[self.steps - 1] if self.steps else self._sounding
        self._returns = state.returns.tolist()
