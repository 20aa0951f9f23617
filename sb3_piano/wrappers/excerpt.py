"""Wrapper that plays a part of each piece, fixed or drawn."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import gymnasium as gym
import numpy as np
from annotated_types import Ge, Gt, MultipleOf

from sb3_piano.exceptions import ConfigError, ScoreError
from sb3_piano.music import Score
from sb3_piano.settings import Number, Unit, checked
from sb3_piano.wrappers.score_wrapper import ScoreChange, possible_scores

Span = tuple[float, float]
"""Beginning and end of a part, s."""

_WHOLE: Span = (0.0, math.inf)

_SAME_TIME = 1e-6
"""Times that differ by less, in s, count as equal."""


class Excerpt(ScoreChange, gym.utils.RecordConstructorArgs):
    """Play a part of each piece: the notes that begin in it.

    With ``start="random"`` a part is drawn for each episode, never a silent one and never shorter
    than necessary. In seconds, it begins with a note: all onsets are equally likely, as far as the
    part then lies within the piece; if there are later onsets, the last part of the piece is one
    more. In bars, it begins with a bar that has an onset, by the same rule.

    A piece no longer than the part is played whole. If less than ``length`` is left after
    ``start``, the rest is played.

    Bars are counted from 0. The last bar has the last onset and lasts until the end of the piece.
    Notes before the first bar line, an upbeat, make a bar of their own.

    Args:
        env: A piano environment, wrapped or not.
        start: Where the part begins, in the unit from the beginning of the piece, at least 0; or
            "random".
        length: How long it is, in the unit, above 0.
        unit: "seconds"; or "bars", of which both numbers are whole ones, for pieces that know
            theirs: those of MIDI and MusicXML files and the studies.

    Raises:
        ConfigError: If an argument is not valid, or ``env`` is no piano.
        ScoreError: If no note is struck in the part, or the bars of a piece are not known, here for
            the environment's own pieces, at ``reset`` for others.
    """

    cuts = True

    def __init__(
        self,
        env: gym.Env[Any, Any],
        *,
        start: float | str = 0.0,
        length: float = 4.0,
        unit: str = "seconds",
    ) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, start=start, length=length, unit=unit)
        super().__init__(env)
        checked("unit", unit, Literal["seconds", "bars"])
        number: Any = Number if unit == "seconds" else Annotated[Number, MultipleOf(1)]
        size = checked("length", length, Annotated[number, Gt(0), Unit(unit)])
        if isinstance(start, str) and start != "random":
            raise ConfigError(f"start is {start!r}: expected a number of {unit} or 'random'.")
        kind = Annotated[number, Ge(0), Unit(unit)]
        self._start = None if start == "random" else checked("start", start, kind)
        self._part: _Seconds | _Bars = _Seconds(size) if unit == "seconds" else _Bars(int(size))
        self.draws_times = self._start is None
        possible_scores(self)  # raises if a piece has no such part

    def draw(self, score: Score, random: np.random.Generator) -> Span:
        """Return the beginning and the end of the part of this episode, s."""
        if self._start is not None:
            return self._part.span(score, self._start)
        starts = self._part.starts(score)
        return self._part.span(score, starts[random.integers(len(starts))])

    def extreme_values(self, score: Score) -> list[Span]:
        """Return the part, or the whole piece if the part is drawn."""
        if self._start is not None:
            return [self._part.span(score, self._start)]
        self._part.starts(score)  # raises if the piece has no bars
        return [_WHOLE]

    def changed(self, score: Score, value: Span) -> Score:
        """Return the part of the score."""
        return score if value == _WHOLE else score.excerpt(*value)


@dataclass(frozen=True)
class _Seconds:
    """Parts with a length in s: possible beginnings, and the ends of a part, s."""

    length: float

    def starts(self, score: Score) -> list[float]:
        last = max(score.duration - self.length, 0.0)
        return sorted({min(note.onset, last) for note in score.notes})

    def span(self, score: Score, start: float) -> Span:
        end = start + self.length
        if start == 0 and end >= score.duration:
            return _WHOLE
        return _at_onset(score, start), _at_onset(score, end)


@dataclass(frozen=True)
class _Bars:
    """Parts with a length in bars: possible beginnings, and the ends of a part, s."""

    length: int

    def starts(self, score: Score) -> list[int]:
        lines = _bar_lines(score)
        last = max(len(lines) - self.length, 0)
        return sorted({min(bisect_right(lines, note.onset) - 1, last) for note in score.notes})

    def span(self, score: Score, start: float) -> Span:
        lines = [*_bar_lines(score), math.inf]
        first, count = int(start), len(lines) - 1
        if first >= count:
            raise ScoreError(
                f"Cannot cut {score.title!r} from bar {first}: expected one of its bars, 0 to "
                f"{count - 1}."
            )
        if first == 0 and self.length >= count:
            return _WHOLE
        return lines[first], lines[min(first + self.length, count)]


def _bar_lines(score: Score) -> list[float]:
    """Return the beginning of each bar, s, up to the bar of the last onset."""
    if not score.bars:
        raise ScoreError(
            f"The bars of {score.title!r} are not known: expected a piece from a MIDI or "
            "MusicXML file, or an excerpt in seconds."
        )
    upbeat = [0.0] if score.notes[0].onset < score.bars[0] else []
    return upbeat + [line for line in score.bars if line <= score.notes[-1].onset]


def _at_onset(score: Score, time: float) -> float:
    """Return the exact onset at a time that may have a rounding error."""
    nearest = min((note.onset for note in score.notes), key=lambda onset: abs(onset - time))
    return nearest if abs(nearest - time) < _SAME_TIME else time
