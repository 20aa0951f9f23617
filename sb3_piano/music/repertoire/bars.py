"""The bars of a file of the repertoire, as they are written: in units, pitches and fingers."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import TypeAlias

from sb3_piano.exceptions import ScoreError
from sb3_piano.music.hands import Hand, finger_of
from sb3_piano.music.pitch import PITCH_PATTERN, pitch_number
from sb3_piano.music.repertoire.header import parse_number, parse_positive

Voice: TypeAlias = tuple[Hand, int]
"""A hand, and which of its lines in the bar, from 0."""

BAR_WORD = "bar"
"""The word with which the line that begins a bar begins."""

_HANDS: Mapping[str, Hand] = {"R": "right", "L": "left"}
_BAR = re.compile(
    rf"""{BAR_WORD} \s+ (?P<name> [^\s=]+ ) (?: \s* = \s* (?P<same> [^\s=]+ ) )?
    (?P<settings> (?: \s+ (?: length | tempo ) = \S+ )* )""",
    re.VERBOSE,
)
_TOUCHES = rf"(?P<pitches>{PITCH_PATTERN}(?:\+{PITCH_PATTERN})*)/(?P<fingers>[1-5]+)(?P<dot>'?)"
_TOKEN = re.compile(rf"(?:-|{_TOUCHES})(?:\*(?P<length>[^~]+))?(?P<tie>~?)")
_LENGTH = "a length in units above 0, such as 3, 0.5 or 2/3"


@dataclass(frozen=True, kw_only=True)
class Event:
    """A note, a chord or a rest.

    Attributes:
        text: How it is written, for messages.
        length: In units, above 0.
        pitches: MIDI pitches; none is a rest.
        fingers: The finger (0-9) on each.
        dotted: Whether there is a dot: it is let go after half of its length.
        tied: Whether it goes on in the next event of its voice.
    """

    text: str
    length: Fraction
    pitches: tuple[int, ...] = ()
    fingers: tuple[int, ...] = ()
    dotted: bool = False
    tied: bool = False


@dataclass(frozen=True, kw_only=True)
class Bar:
    """A bar.

    Attributes:
        name: What it is called, no two alike.
        length: In units.
        tempo: Quarter notes per minute from here on; None to go on as before.
        voices: The events of each voice, one after the other, as long as the bar together.
        pedals: When the pedal goes down and up, in units from the beginning of the bar.
    """

    name: str
    length: Fraction
    tempo: Fraction | None = None
    voices: Mapping[Voice, Sequence[Event]] = field(default_factory=dict)
    pedals: Sequence[tuple[Fraction, Fraction]] = ()


def parse_bars(lines: Sequence[str], usual_length: Fraction, file: str) -> list[Bar]:
    """Return the bars in their order.

    Args:
        lines: The lines from the first bar on, without comments, each with those that continue it.
        usual_length: Length of a bar that says none, in units.
        file: Name of the file, for messages.

    Raises:
        ScoreError: If a line cannot be read, or a voice does not add up to its bar.
    """
    starts = [index for index, line in enumerate(lines) if line.split()[0] == BAR_WORD]
    bars: dict[str, Bar] = {}
    for start, end in itertools.pairwise([*starts, len(lines)]):
        bar = _parse_bar(lines[start], lines[start + 1 : end], usual_length, bars, file)
        bars[bar.name] = bar
    return list(bars.values())


def _parse_bar(
    first: str, lines: Sequence[str], usual_length: Fraction, bars: Mapping[str, Bar], file: str
) -> Bar:
    match = _BAR.fullmatch(first)
    if match is None:
        raise ScoreError(
            f"{first!r} in {file!r} begins no bar: expected 'bar 5', 'bar 5 = 1', and maybe "
            "'length=2' (in units) or 'tempo=60' (quarter notes per minute)."
        )
    where = f"Bar {match['name']} of {file!r}"
    if match["name"] in bars:
        raise ScoreError(f"{where} is there twice: expected another name.")
    settings = _parse_settings(match["settings"], where)
    if match["same"] is not None:
        bar = _earlier(match["same"], lines, bars, where)
        length = settings.get("length", bar.length)
        bar = replace(bar, name=match["name"], length=length, tempo=settings.get("tempo"))
    else:
        voices, pedals = _parse_lines(lines, where)
        bar = Bar(
            name=match["name"],
            length=settings.get("length", usual_length),
            tempo=settings.get("tempo"),
            voices=voices,
            pedals=pedals,
        )
    _check_length(bar, where)
    return bar


def _parse_settings(text: str, where: str) -> dict[str, Fraction]:
    expected = {"length": _LENGTH, "tempo": "quarter notes per minute, such as 72"}
    settings: dict[str, Fraction] = {}
    for setting in text.split():
        key, _, value = setting.partition("=")
        if key in settings:
            raise ScoreError(f"{where} says {key!r} twice: expected it once.")
        settings[key] = parse_positive(value, expected[key], f"{where}, {key}")
    return settings


def _earlier(name: str, lines: Sequence[str], bars: Mapping[str, Bar], where: str) -> Bar:
    if name not in bars:
        raise ScoreError(f"{where} plays bar {name!r}: expected the name of an earlier bar.")
    if lines:
        raise ScoreError(
            f"{where} plays bar {name!r}, and has lines of its own: expected one of the two."
        )
    return bars[name]


def _parse_lines(
    lines: Sequence[str], where: str
) -> tuple[dict[Voice, list[Event]], list[tuple[Fraction, Fraction]]]:
    voices: dict[Voice, list[Event]] = {}
    pedals: list[tuple[Fraction, Fraction]] = []
    for line in lines:
        kind, colon, rest = line.partition(":")
        if kind == "P" and colon:
            pedals += [_parse_press(token, f"{where}, pedal") for token in rest.split()]
        elif kind in _HANDS and colon:
            hand = _HANDS[kind]
            number = sum(1 for other, _ in voices if other == hand)
            voices[hand, number] = [
                _parse_event(token, hand, f"{where}, {hand} hand") for token in rest.split()
            ]
        else:
            raise ScoreError(
                f"{where} has the line {line!r}: expected 'R:' (right hand), 'L:' (left hand) or "
                "'P:' (pedal), and a space before a line that continues another."
            )
    return voices, pedals


def _parse_press(token: str, where: str) -> tuple[Fraction, Fraction]:
    expected = "when it goes down and when up, in units of the bar, such as 0-5.5"
    down, _, up = token.partition("-")
    press = parse_number(down, expected, where), parse_number(up, expected, where)
    if press[0] >= press[1]:
        raise ScoreError(f"{where}: {token!r} is not valid: expected {expected}.")
    return press


def _parse_event(token: str, hand: Hand, where: str) -> Event:
    match = _TOKEN.fullmatch(token)
    if match is None or (match["tie"] and (match["dot"] or not match["pitches"])):
        raise ScoreError(
            f"{where}: {token!r} is no note: expected one such as F5/4, C5/1', G3+Eb4/52*2, "
            "D5/2*1/2~ or the rest -*3; fingers are 1 to 5, and neither rests nor notes with "
            "dots are tied."
        )
    length = parse_positive(match["length"] or "1", _LENGTH, f"{where}, {token!r}")
    if not match["pitches"]:
        return Event(text=token, length=length)
    names = match["pitches"].split("+")
    if len(names) != len(match["fingers"]):
        raise ScoreError(
            f"{where}: {token!r} has {len(match['fingers'])} fingers: expected one for each of "
            f"its {len(names)} notes."
        )
    return Event(
        text=token,
        length=length,
        pitches=tuple(pitch_number(name) for name in names),
        fingers=tuple(finger_of(hand, int(number)) for number in match["fingers"]),
        dotted=bool(match["dot"]),
        tied=bool(match["tie"]),
    )


def _check_length(bar: Bar, where: str) -> None:
    for (hand, number), events in bar.voices.items():
        length = sum((event.length for event in events), Fraction(0))
        if length != bar.length:
            raise ScoreError(
                f"{where}, {hand} hand, line {number + 1}: its notes and rests add up to "
                f"{length} units: expected {bar.length}."
            )
    last = Fraction(0)
    for down, up in bar.pedals:
        if down < last or up > bar.length:
            raise ScoreError(
                f"{where}, pedal: it is down from {down} to {up}: expected one press after the "
                f"other, up to {bar.length}."
            )
        last = up
