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

BoolArray = npt.NDArray[np.bool_]
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
        # Lists of what each step has, which grow faster than rows of an array are filled.
        self._key_active: list[BoolArray] = []
        self._sustain: list[bool] = []
        self._fingertips: list[FloatArray] = []
        self._sounding = bytes(NUM_KEYS)  # the fastest way to compare them
        self._within: dict[int, BoolArray] = {}  # of steps in which a key changed
        self._returns = [0.0] * len(RETURN_KEYS)  # plain numbers, faster to add than an array

    @property
    def steps(self) -> int:
        """Control steps that are over."""
        return len(self._sustain)

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
        sounding = reading.sounding.tobytes()
        if sounding != self._sounding:
            self._within[self.steps] = key_angles >= self._scene.key_sounding_angle
            self._sounding = sounding
        self._key_active.append(reading.sounding)
        self._sustain.append(pedal_down)
        self._fingertips.append(reading.fingertips)
        self._returns = list(map(operator.add, self._returns, weighted_terms.values()))

    def performance(self) -> Performance:
        """Return a copy of what was played so far."""
        roll, (key_active, sustain, fingertips) = self._goal.roll, self._arrays()
        strikes, releases = press_times(
            presses_of(key_active), self._within, roll.control_timestep, self.steps
        )
        return Performance(
            roll=roll,
            key_active=key_active,
            sustain=sustain,
            strike_time=strikes,
            release_time=releases,
            press_finger=nearest_fingers(key_active, fingertips, KeyBoxes(*self._scene.key_boxes)),
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
        key_active, sustain, fingertips = self._arrays()
        return EnvState(
            physics=physics,
            score=self._goal.score,
            finished=finished,
            pedal=pedal,
            key_active=key_active,
            sustain=sustain,
            fingertips=fingertips,
            within=dict(self._within),
            returns=np.array(self._returns),
        )

    def restore(self, state: EnvState) -> None:
        """Take over the steps that another record saved."""
        self._key_active = list(state.key_active.copy())
        self._sustain = state.sustain.tolist()
        self._fingertips = list(state.fingertips.copy())
        self._within = dict(state.within)
        if self._key_active:
            self._sounding = self._key_active[-1].tobytes()
        self._returns = state.returns.tolist()

    def _arrays(self) -> tuple[BoolArray, BoolArray, FloatArray]:
        """Return which keys sounded (t, 88), the pedal (t,) and the fingertips (t, 10, 3)."""
        steps = self.steps
        return (
            np.array(self._key_active, dtype=bool).reshape(steps, NUM_KEYS),
            np.array(self._sustain, dtype=bool),
            np.array(self._fingertips, dtype=float).reshape(steps, NUM_FINGERS, 3),
        )
