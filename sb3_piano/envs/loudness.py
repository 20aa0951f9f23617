"""Observation block of how loud the coming notes should be."""

from __future__ import annotations

from typing import Any

import numpy as np

from sb3_piano.arrays import FloatArray
from sb3_piano.envs.blocks import Block
from sb3_piano.music.constants import NUM_KEYS
from sb3_piano.music.dynamics import LOUDEST


class Loudness(Block):
    """How loud the next strike of each key should be.

    For the option ``observation_blocks``, with the reward term ``dynamics``. The velocity shown in
    a control step is that of the first strike of the key in this step or later.
    """

    name = "loudness"
    meaning = "MIDI velocity of each key's next strike over 127; 0 without one"
    shape = (NUM_KEYS,)

    def prepare(self, roll: Any) -> FloatArray:
        """Return the velocity of each key's next strike in each control step, (T, 88)."""
        velocity: FloatArray = roll.velocity / LOUDEST
        for step in range(len(velocity) - 2, -1, -1):
            velocity[step] = np.where(roll.onset[step], velocity[step], velocity[step + 1])
        return velocity
