"""Record of an episode, step by step, from which all music metrics are computed."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np

from sb3_piano.arrays import BoolArray, FingerArray, FloatArray
from sb3_piano.exceptions import RunError
from sb3_piano.metrics import (
    Losses,
    Onsets,
    Presses,
    episode_metrics,
    losses_of,
    presses_of,
)
from sb3_piano.metrics.musicianship import MUSICIANSHIP, musicianship
from sb3_piano.music import MIN_PITCH, Note, Pedal, PianoRoll, Score
from sb3_piano.music.constants import DEFAULT_VELOCITY
from sb3_piano.music.dynamics import velocity_of
from sb3_piano.music.roll import floor_steps


@dataclass(frozen=True, eq=False, kw_only=True)
class Performance:
    """The control steps of an episode so far, and the roll that was due.

    A press is an unbroken run of control steps at whose ends a key sounds; :attr:`presses` gives
    their order. All times count from the start of the episode.
    """

    roll: PianoRoll
    """The roll of the whole piece."""
    key_active: BoolArray
    """(t, 88) bool, keys that sounded at the end of each control step."""
    sustain: BoolArray
    """(t,) bool, whether the pedal was down."""
    strike_time: FloatArray
    """(n,) when the key of each of the n presses went down, s; to the length of a physics step."""
    strike_speed: FloatArray
    """(n,) speed of the key as it began to sound, rad/s; NaN where unknown."""
    release_time: FloatArray
    """(n,) when it came up again, s; the end of the last step if it did not."""
    press_finger: FingerArray
    """(t, 88) int8, the finger nearest to each sounding key, -1 where a key is silent."""
    title: str = ""
    """Title of the piece."""
    score: Score | None = None
    """The piece of which the roll is made, with its fingers; ``None`` in older takes."""

    def __len__(self) -> int:
        return len(self.key_active)

    @functools.cached_property
    def presses(self) -> Presses:
        """The presses: key, first control step, and the step after the last one."""
        return presses_of(self.key_active)

    def metrics(self) -> dict[str, float]:
        """Compute the music metrics by name, over the steps that were played.

        They are :data:`~sb3_piano.metrics.EPISODE_METRICS` without ``normalized_return``, which
        needs the environment's reward.
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

    def musicianship(self, score: Score | None = None) -> dict[str, float]:
        """Compute the numbers of :func:`~sb3_piano.metrics.musicianship`, over the steps played.

        Args:
            score: The piece, for a take that was recorded without it.

        Raises:
            RunError: If the piece is neither known nor given.
        """
        score, step = score or self.score, self.roll.control_timestep
        if score is None:
            raise RunError(
                "This performance was recorded without its score: expected the score as argument."
            )
        lead = (len(self.roll) - 1 - int(floor_steps(score.duration, step))) * step
        end = len(self) * step - lead
        if end <= score.notes[0].onset:
            return dict.fromkeys(MUSICIANSHIP, math.nan)
        due = score.excerpt(0, end).warp(lambda time: time + lead)
        return musicianship(due, self.to_score())

    def losses(self) -> Losses:
        """Classify each due frame and each wrong frame of the steps played."""
        steps, roll = len(self), self.roll
        return losses_of(
            roll.active[:steps], self.key_active, roll.finger[:steps], self.press_finger
        )

    def to_score(self, *, by_steps: bool = False) -> Score | None:
        """Convert the performance to a score, or ``None`` if no key was pressed.

        Times are those of the episode, including the initial silence; a note's finger is the one
        that was nearest when the key went down.

        Args:
            by_steps: If true, notes begin and end with control steps and are equally loud, so that
                the score's roll is the performance. Otherwise notes begin and end when keys went
                down and up, with the loudness of their strikes
                (:mod:`sb3_piano.music.dynamics`). The pedal always follows control steps.
        """
        presses, step = self.presses, self.roll.control_timestep
        by_time = self.strike_time, self.release_time
        onsets, offsets = (presses.first * step, presses.end * step) if by_steps else by_time
        fingers = self.press_finger[presses.first, presses.key].tolist()
        speeds = np.full(len(fingers), np.nan) if by_steps else self.strike_speed
        velocities = [
            DEFAULT_VELOCITY if math.isnan(speed) else velocity_of(speed, key)
            for speed, key in zip(speeds.tolist(), presses.key.tolist(), strict=True)
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
