"""What a file of the repertoire says about its piece before the first bar."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from fractions import Fraction
from typing import Any, TypeVar

from sb3_piano.exceptions import ScoreError, near_names
from sb3_piano.music.constants import DEFAULT_VELOCITY
from sb3_piano.music.hands import HANDS, Hand

_NUMBER = re.compile(r"\d{1,9}(?:\.\d{1,9}|/\d{1,9})?")
_Value = TypeVar("_Value")

_SETTING = re.compile(r"(?P<key>[a-z]+):\s*(?P<value>.*)")


@dataclass(frozen=True, kw_only=True)
class Header:
    """The header of a file of the repertoire.

    Attributes:
        title: What people call the piece.
        composer: Who wrote it.
        source: Which print the notes follow, why it is free, and what they were checked against.
        fingering: Whose the fingers are: ``"ours"``, or an edition's.
        tempo: Quarter notes per minute with which the piece begins, above 0.
        meter: Length of a bar, as a part of a whole note, above 0.
        unit: Length of a note that says none, as a part of a whole note, above 0.
        simplified: What differs from the print; empty if nothing.
        release: How long before its end each hand lets go of a note, s, at least 0.
        velocity: How hard each hand strikes, 1-127.
    """

    title: str
    composer: str
    source: str
    fingering: str
    tempo: Fraction
    meter: Fraction
    unit: Fraction
    simplified: str = ""
    release: Mapping[Hand, Fraction] = field(default_factory=lambda: _each_hand(Fraction(0)))
    velocity: Mapping[Hand, int] = field(default_factory=lambda: _each_hand(DEFAULT_VELOCITY))

    @property
    def bar_length(self) -> Fraction:
        """Length of a bar that says none, in units."""
        return self.meter / self.unit


def parse_header(lines: Iterable[str], file: str) -> Header:
    """Return what the lines before the first bar say.

    Args:
        lines: The lines, without comments, each with the lines that continue it.
        file: Name of the file, for messages.

    Raises:
        ScoreError: If a key is unknown, missing or there twice, or a value makes no sense.
    """
    known = [field.name for field in fields(Header)]
    values: dict[str, Any] = {}
    for line in lines:
        match = _SETTING.fullmatch(line)
        if match is None or match["key"] not in known:
            key = line if match is None else match["key"]
            raise ScoreError(
                f"{file!r} begins with {line!r}.{near_names(key, known)} Expected 'key: value' "
                f"with one of the keys {', '.join(known)}, or 'bar' and its name."
            )
        if match["key"] in values:
            raise ScoreError(f"{file!r} says {match['key']!r} twice: expected it once.")
        if not match["value"]:
            raise ScoreError(f"{file!r} has no text after '{match['key']}:': expected a value.")
        values[match["key"]] = _value(match["key"], match["value"], file)
    required = [key for key in known if key not in ("simplified", "release", "velocity")]
    missing = [key for key in required if key not in values]
    if missing:
        raise ScoreError(
            f"{file!r} does not say its {', '.join(missing)}: expected a line such as "
            f"'{missing[0]}: ...' before the first bar."
        )
    return Header(**values)


def parse_number(text: str, expected: str, where: str) -> Fraction:
    """Return a number such as ``3``, ``0.5`` or ``2/3``, exactly.

    Args:
        text: The number.
        expected: What it should be, for the message.
        where: Where it stands, for the message.

    Raises:
        ScoreError: If `text` is no such number.
    """
    match = _NUMBER.fullmatch(text)
    if match is None or text.endswith("/0"):
        raise ScoreError(f"{where}: {text!r} is not valid: expected {expected}.")
    return Fraction(text)


def parse_positive(text: str, expected: str, where: str) -> Fraction:
    """Return a number as :func:`parse_number` does, above 0.

    Raises:
        ScoreError: If `text` is no such number.
    """
    number = parse_number(text, expected, where)
    if number == 0:
        raise ScoreError(f"{where}: {text!r} is not valid: expected {expected}.")
    return number


def _value(key: str, text: str, file: str) -> object:
    where = f"{file!r}, {key}"
    if key == "tempo":
        return parse_positive(text, "quarter notes per minute, such as 72", where)
    if key == "meter":
        return parse_positive(text, "a meter, such as 3/4", where)
    if key == "unit":
        return parse_positive(text, "a part of a whole note, such as 1/8", where)
    if key == "release":
        return {**_each_hand(Fraction(0)), **_by_hand(text, "'right 0.05 left 0.1'", where)}
    if key == "velocity":
        velocities = _by_hand(text, "'right 85 left 70', each from 1 to 127", where)
        if not all(velocity in range(1, 128) for velocity in velocities.values()):
            raise ScoreError(
                f"{where}: {text!r} is not valid: expected whole numbers from 1 to 127."
            )
        chosen = {hand: int(velocity) for hand, velocity in velocities.items()}
        return {**_each_hand(DEFAULT_VELOCITY), **chosen}
    return text


def _each_hand(value: _Value) -> dict[Hand, _Value]:
    return dict.fromkeys(HANDS, value)


def _by_hand(text: str, expected: str, where: str) -> dict[Hand, Fraction]:
    """Return the numbers of a text such as ``right 85 left 70``; either hand may be left out."""
    words = text.split()
    names, numbers = words[::2], words[1::2]
    hands: list[Hand] = [hand for hand in HANDS if hand in names]
    if len(names) != len(numbers) or len(hands) != len(names):
        raise ScoreError(f"{where}: {text!r} is not valid: expected {expected}.")
    by_name = dict(zip(names, numbers, strict=True))
    return {hand: parse_number(by_name[hand], expected, where) for hand in hands}
