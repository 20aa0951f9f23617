"""Performance of an episode, step by step: the record from which all music metrics come."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np

from sb3_piano.arrays import BoolArray, FingerArray, FloatArray
from sb3_piano.metrics import Losses, Onsets, Presses, episode_metrics, losses_of, presses_of
from sb3_piano.music import MIN_PITCH, Note, Pedal, PianoRoll, Score
from sb3_piano.music.constants import DEFAULT_VELOCITY
from sb3_piano.music.dynamics import velocity_of


@dataclass(frozen=True, eq=False, kw_only=True)
class Performance:
    """The control steps of an episode so far, beside the roll that should have been played.

    A press is an unbroken run of control steps at whose ends a key sounds; their order is that of
    :attr:`presses`. All times count from the start of the episode.
    """

    roll: PianoRoll
    """The whole piece as it should be played."""
    key_active: BoolArray
    """(t, 88) bool, keys that sounded at the end of each control step."""
    sustain: BoolArray
    """(t,) bool, whether the pedal was down."""
    strike_time: FloatArray
    """(n,) when the key of each of the n presses went down, s; to the length of a physics step."""
    strike_speed: FloatArray
    """(n,) how fast it went down as it began to sound, rad/s; NaN where that is not known."""
    release_time: FloatArray
    """(n,) when it came up again, s; the end of the last step if it did not."""
    press_finger: FingerArray
    """(t, 88) int8, the finger nearest to each sounding key, -1 where a key is silent."""
    title: str = ""
    """Title of the piece."""

    def __len__(self) -> int:
        return len(self.key_active)

    @functools.cached_property
    def presses(self) -> Presses:
        """The presses: which key, its first control step, and the step after its last one."""
        return presses_of(self.key_active)

    def metrics(self) -> dict[str, float]:
        """Return the music metrics by name, over the steps that were played.

        They are :data:`~sb3_piano.metrics.EPISODE_METRICS` without ``normalized_return``, which
        only the environment can tell.
        """
        steps, roll = len(self), self.roll
        first, key = np.divmod(np.flatnonzero(roll.onset), roll.onset.shape[1])
        begun = first < steps
        return episode_metrics(
            target_keys=roll.active[:steps],
            played_keys=self.key_active,
            target_pedal=roll.sustain[:steps],
            played_pedal=self.sustain,
            target_onsets=Onsets(roll.onset_time[begun], key[begun]),
            played_onsets=Onsets(self.strike_time, self.presses.key),
            target_finger=roll.finger[:steps],
            press_finger=self.press_finger,
            control_timestep=roll.control_timestep,
        )

    def losses(self) -> Losses:
        """Return where due frames were lost in the steps played, and where wrong ones come from."""
        steps, roll = len(self), self.roll
        return losses_of(
            roll.active[:steps], self.key_active, roll.finger[:steps], self.press_finger
        )

    def to_score(self, *, by_steps: bool = False) -> Score | None:
        """Return what was played as a score, or ``None`` if no key was ever pressed.

        Times are those of the episode, the initial silence included; a note's finger is the one
        that was nearest when the key went down.

        Args:
            by_steps: Whether notes begin and end with control steps, so that the roll of the score
                is what was played, and are equally loud; otherwise when keys went down and up, and
                as loud as these were struck (see :mod:`sb3_piano.music.dynamics`). The pedal always
                goes by steps.
        """
        presses, step = self.presses, self.roll.control_timestep
        by_time = self.strike_time, self.release_time
        onsets, offsets = (presses.first * step, presses.end * step) if by_steps else by_time
        fingers = self.press_finger[presses.first, presses.key].tolist()
        speeds = np.full(len(fingers), np.nan) if by_steps else self.strike_speed
        velocities = [
            DEFAULT_VELOCITY if math.isnan(speed) else velocity_of(speed)
            for speed in speeds.tolist()
        ]
        notes = [
            Note(
                onset=onset, offset=offset, pitch=MIN_PITCH + key, velocity=velocity, finger=finger
            )
            for key, onset, offset, velocity, finger in zip(
                presses.key.tolist(), onsets, offsets, velocities, fingers, strict=True
            )
        ]
        if not notes:
            return None
        down = presses_of(self.sustain[:, None])
        spans = zip(down.first.tolist(), down.end.tolist(), strict=True)
        pedals = [Pedal(onset=first * step, offset=end * step) for first, end in spans]
        return Score(notes=notes, pedals=pedals, title=self.title)
