"""Metronome marks, and swing: equally written eighth notes played long and short."""

from __future__ import annotations

import bisect
import re
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from operator import itemgetter
from xml.etree.ElementTree import Element

from sb3_piano.music.formats.musicxml.notes import note_value, read_number
from sb3_piano.music.text_file import read_whole


def metronome_tempo(mark: Element) -> tuple[Fraction, bool] | None:
    """Return the quarter notes a minute of a metronome mark, or a factor of the tempo.

    A factor, with ``True``, comes from a metric modulation such as quarter = dotted quarter: the
    new note at the right lasts as long as the former one at the left. For 80-88, the first counts.
    """
    values = _values(mark)
    number = re.search(r"\d+([.,]\d+)?", mark.findtext("per-minute") or "")
    if number is not None:
        return (read_number(number[0]) * values[0], False) if values[0] else None
    return (values[1] / values[0], True) if len(values) == 2 and all(values) else None


def _values(mark: Element) -> list[Fraction]:
    """Return the quarter notes of the notes on both sides of a mark."""
    values, last = [Fraction(0)], Fraction(0)
    for child in mark:
        if child.tag == "metronome-relation" or (child.tag == "beat-unit" and values[-1]):
            values.append(Fraction(0))
        if child.tag == "beat-unit":
            last = note_value(child.text)
        elif child.tag == "beat-unit-dot":
            last /= 2
        elif child.tag == "beat-unit-tied":
            last = note_value(child.findtext("beat-unit"), len(child.findall("beat-unit-dot")))
        elif child.tag == "metronome-note":
            tuplet = child.find("metronome-tuplet")
            dots = len(child.findall("metronome-dot"))
            last = note_value(child.findtext("metronome-type"), dots, tuplet)
        else:
            continue
        values[-1] += last
    return values


_EVEN = Fraction(1, 2)


@dataclass
class Swings:
    """Places of swing, and the swung note values; times are in quarter notes.

    Attributes:
        signs: By start: the quarter notes of a pair of notes, and the share of the first.
        bars: Start of each measure, and the origin from which its pairs are counted.
    """

    signs: dict[Fraction, tuple[Fraction, Fraction]] = field(default_factory=dict)
    bars: list[tuple[Fraction, Fraction]] = field(default_factory=list)

    def add(self, at: Fraction, sign: Element) -> None:
        """Add a sign, which may end the swing."""
        first, second = (read_whole(sign.findtext(tag) or "1") or 1 for tag in ("first", "second"))
        pair = 2 * (note_value(sign.findtext("swing-type")) or _EVEN)
        self.signs[at] = pair, Fraction(first, first + second)

    @cached_property
    def _corners(self) -> list[Fraction]:
        return sorted(self.signs)

    def played(self, at: Fraction) -> Fraction:
        """Return the played time of a written time, once all signs are known."""
        index = bisect.bisect_right(self._corners, at) - 1
        pair, share = self.signs[self._corners[index]] if index >= 0 else (Fraction(1), _EVEN)
        if share == _EVEN:
            return at
        bar = bisect.bisect_right(self.bars, at, key=itemgetter(0)) - 1
        place = (at - self.bars[bar][1]) / pair % 1
        if place.denominator & (place.denominator - 1):
            return at  # triplets are not swung
        moved = 2 * place * share if place <= _EVEN else 1 - 2 * (1 - place) * (1 - share)
        return at + (moved - place) * pair
