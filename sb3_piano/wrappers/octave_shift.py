"""Pieces shifted by octaves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym

from sb3_piano.wrappers.pitch_shift import KeyShift

_OCTAVE = 12
"""Semitones."""


class OctaveShift(KeyShift, gym.utils.RecordConstructorArgs):
    """Shift each piece up or down, by whole octaves.

    White keys stay white and black keys black, so that a fingering stays as good as it was. All
    else is as in :class:`~sb3_piano.wrappers.PitchShift`: of a range only those shifts are drawn
    that keep the piece on the keyboard; if none does, the one that is nearest to the range.

    Args:
        env: A piano environment, wrapped or not.
        octaves: The shift, negative for lower; or a pair of the lowest and the highest to draw
            from, both included.

    Raises:
        ConfigError: If ``octaves`` is neither, or ``env`` is no piano.
        ScoreError: If a fixed shift takes a note off the keyboard, here for the environment's own
            pieces, at ``reset`` for others.
    """

    def __init__(self, env: gym.Env[Any, Any], octaves: int | Sequence[int]) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, octaves=octaves)
        super().__init__(env, "octaves", octaves, semitones=_OCTAVE)
