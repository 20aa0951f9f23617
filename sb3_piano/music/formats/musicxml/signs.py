"""Collect the repeats and jumps of a MusicXML file, declared or only printed."""

from __future__ import annotations

import re
from collections import defaultdict
from dataclasses import dataclass, field
from fractions import Fraction
from xml.etree.ElementTree import Element

from sb3_piano.music.text_file import read_whole

MOST_TIMES = 20
"""Limit of repetitions: damaged numbers would fill the memory."""

KINDS = ("dacapo", "dalsegno", "segno", "tocoda", "coda", "fine")
"""The attributes of a ``sound`` for jumps and their targets."""

_WORDS = {
    "dacapo": r"(^|\b)d\. ?c\b|^dc\b|\bda ?capo\b",
    "dalsegno": r"(^|\b)d\. ?s\b|^ds\b|\b(d\.|dal) ?segno\b",
    "tocoda": r"^(to|al|alla|zur|à la) ?(the )?coda\b",
    "coda": r"^coda\W*$",
    "segno": r"^segno\W*$",
    "fine": r"^(fine?|ende)\W*$",
}
"""Printed text for each kind."""

_SYMBOLS = str.maketrans(
    {
        "\U0001d10b": " segno",
        "\ue047": " segno",
        "\U0001d10c": " coda",
        "\ue048": " coda",
        "\u2295": " coda",
    }
)
_ROMAN = ("", "i", "ii", "iii", "iv", "v", "vi", "vii", "viii", "ix", "x")
_NUMBER = r"(\d+|[ivx]+\b)"


@dataclass(eq=False)
class Ending:
    """An ending: the turns in which it is played, its start and its stop."""

    numbers: set[int]
    start: Fraction
    stop: Fraction | None = None


@dataclass
class Signs:
    """Repeats and jumps in any part, by their quarter note.

    Attributes:
        at: Kinds, each with its name: forward and backward (repeats; the name is the number of
            times), and the kinds of a ``sound``.
        endings: The endings, by their start.
        bars: Number, start and end of each measure.
    """

    at: dict[Fraction, set[tuple[str, str]]] = field(default_factory=lambda: defaultdict(set))
    endings: dict[Fraction, Ending] = field(default_factory=dict)
    bars: list[tuple[str, Fraction, Fraction]] = field(default_factory=list)
    _printed: list[tuple[Fraction, str, Fraction, Fraction]] = field(default_factory=list)
    _of_measure: list[tuple[Fraction, str, str | None]] = field(default_factory=list)
    _open: Ending | None = None

    @property
    def end(self) -> Fraction:
        """End of the last measure."""
        return self.bars[-1][2] if self.bars else Fraction(0)

    def add_repeat(self, at: Fraction, direction: str, times: str) -> None:
        """Add a repeat sign."""
        self.at[at].add((direction, times))

    def add_sound(self, at: Fraction, sound: Element) -> None:
        """Add the jumps that an element declares in its attributes."""
        for kind in KINDS:
            name = sound.get(kind)
            if name is not None and name != "no":
                self._of_measure.append((at, kind, name))

    def add_printed(self, at: Fraction, element: Element) -> None:
        """Add the signs and words of a direction, or the signs at a bar line."""
        words = [
            " ".join((each.text or "").translate(_SYMBOLS).split()) for each in _words(element)
        ]
        found = _kinds(" ".join(words)) or [kind for each in words for kind in _kinds(each)]
        if not found:
            found = [sign for sign in ("segno", "coda") if element.find(f".//{sign}") is not None]
        self._of_measure += [(at, kind, None) for kind in found]

    def begin_ending(self, at: Fraction, numbers: str) -> None:
        """Start an ending."""
        self._open = self.endings.setdefault(at, Ending(_ending_numbers(numbers), at))

    def end_ending(self, at: Fraction) -> None:
        """Stop the open ending."""
        if self._open is not None:
            self._open.stop = at
        self._open = None

    def end_measure(self, number: str, start: Fraction, end: Fraction) -> None:
        """Add a measure, and place its signs."""
        for at, kind, name in self._of_measure:
            if name is None:
                self._printed.append((at, kind, start, end))
            else:
                self.at[_place(at, kind, start, end)].add((kind, name))
        self._of_measure.clear()
        self.bars.append((number, start, end))

    def finish(self) -> None:
        """Use printed signs of kinds that are declared nowhere."""
        declared = {kind for signs in self.at.values() for kind, _ in signs}
        codas = sorted({at for at, kind, _, _ in self._printed if kind == "coda"})
        is_said = any(kind == "tocoda" for _, kind, _, _ in self._printed)
        for at, kind, start, end in self._printed:
            if kind == "coda" and not is_said and at == codas[0] != codas[-1]:
                kind = "tocoda"  # of several coda signs the first leads to the others
            if kind not in declared:
                self.at[_place(at, kind, start, end)].add((kind, ""))

    def times(self, at: Fraction) -> int:
        """Return how often a repeat that ends at a place is played, by its sign."""
        given = (name for sign, name in self.at.get(at, ()) if sign == "backward")
        return max((min(read_whole(name) or 2, MOST_TIMES) for name in given), default=2)

    def has(self, at: Fraction, kind: str) -> bool:
        """Return whether a place has a sign of a kind."""
        return any(sign == kind for sign, _ in self.at.get(at, ()))


def _place(at: Fraction, kind: str, start: Fraction, end: Fraction) -> Fraction:
    """Return the place of a sign's effect: a jump acts at the end of its measure.

    Fine and To Coda act at their own place, unless it is the measure's start.
    """
    is_late = kind in ("dacapo", "dalsegno") or (kind in ("fine", "tocoda") and at == start)
    return end if is_late else at


def _words(element: Element) -> list[Element]:
    return element.findall("direction-type/words") + element.findall("direction-type/symbol")


def _kinds(text: str) -> list[str]:
    return [kind for kind, words in _WORDS.items() if re.search(words, text, re.I)][:1]


def _ending_numbers(text: str) -> set[int]:
    """Parse the numbers of an ending such as ``"1, 2"``, ``"1-3"`` or ``"II."``."""
    numbers: set[int] = set()
    for first, last in re.findall(
        rf"\b{_NUMBER}(?:\.?\s*[-\u2013\u2014]\s*{_NUMBER})?", text.lower()
    ):
        low, high = _whole(first), _whole(last or first)
        numbers.update(range(low, min(high, MOST_TIMES) + 1))
    return numbers


def _whole(text: str) -> int:
    return _ROMAN.index(text) if text in _ROMAN else read_whole(text) or 0
