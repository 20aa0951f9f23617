"""Reading a piece that is written in ABC, with one voice or more for each hand.

What is read of ABC 2.1 is what piano music in one tempo and meter needs: the fields ``M``, ``L``,
``Q`` (``1/4=60``), ``K`` (a major or minor key) and those of text; lines that begin with ``[V:R]``
or ``[V:L2]``, for voices of the right and left hand; notes, chords, rests, ties, triplets, bar
lines, and ``!ped!`` and ``!ped-up!`` for the pedal. An accidental holds for its octave up to the
bar line.

Source: The abc music standard 2.1, https://abcnotation.com/wiki/abc:standard:v2.1
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

from sb3_piano.exceptions import ScoreError
from sb3_piano.music.hands import Hand
from sb3_piano.music.note import Note, Pedal
from sb3_piano.music.pitch import SEMITONES
from sb3_piano.music.score import Score
from sb3_piano.music.text_file import read_text

LIFT = Fraction(1, 20)
"""Time between letting go of a key, or of the pedal, and what follows, in s."""

_SHARPS = "FCGDAEB"
_KEY = re.compile(r"([A-G])([#b]?)(m?)")
_VOICE = re.compile(r"\[V:([RL]\d?)\]")
_NOTE = r"(?:\^\^|__|[=_^])?[A-Ga-g][,']*"
_LENGTH = r"\d*(?:/\d*)?"
_TOKEN = re.compile(
    rf"\s*(?:(?P<bar>\|\]?)|!(?P<pedal>ped|ped-up)!|(?P<triplet>\(3)"
    rf"|(?:[zx]|\[(?P<chord>(?:{_NOTE}-?)+)\]|(?P<note>{_NOTE}))(?P<length>{_LENGTH})(?P<tie>-?))"
)
_HEAD = re.compile(r"(\^\^|__|[=_^]?)([A-Ga-g])([,']*)(-?)")
_ALTERATIONS = {"^^": 2, "^": 1, "=": 0, "_": -1, "__": -2}


@dataclass
class _Voice:
    """What has been read of a voice; times are in whole notes."""

    hand: Hand
    time: Fraction = Fraction(0)
    bars: list[Fraction] = field(default_factory=lambda: [Fraction(0)])
    strikes: list[tuple[Fraction, Fraction, int]] = field(default_factory=list)
    """Onset, offset and pitch of each note."""
    tied: dict[int, Fraction] = field(default_factory=dict)
    """Onsets of the notes that go on, by pitch."""
    unmet: bool = False
    """Whether a tie has just led to no note."""
    altered: dict[tuple[str, int], int] = field(default_factory=dict)
    """Accidentals of the bar, by letter and octave."""
    in_triplet: int = 0
    """How many notes of a triplet are still to come."""


def read_header(path: Path) -> Mapping[str, str]:
    """Return the fields before the notes by their letter; repeated ones are joined by a space."""
    return _split(path)[0]


def read_abc(path: Path, title: str) -> Score:
    """Return the score of a file.

    Raises:
        ScoreError: If something is in it that is not read, or its bars do not add up.
    """
    header, lines = _split(path)
    beat, _, tempo = header["Q"].partition("=")
    seconds = 60 / (Fraction(beat) * int(tempo))  # of a whole note
    unit, signature = Fraction(header["L"]), _signature(header["K"])
    voices: dict[str, _Voice] = {}
    pedals: list[tuple[Fraction, str]] = []
    for line in lines:
        match = _VOICE.match(line)
        if match is None:
            raise ScoreError(f"'{path}': line {line!r} has no voice, such as [V:R] or [V:L2].")
        voice = voices.setdefault(match[1], _Voice("right" if match[1][0] == "R" else "left"))
        pedals += _read_line(voice, line[match.end() :].strip(), unit, signature, path)
    bars = _common_bars(voices, Fraction(header["M"]), path)
    return Score(
        notes=_notes(voices.values(), seconds),
        pedals=_presses(pedals, bars[-1], seconds),
        title=title,
        bars=[float(bar * seconds) for bar in bars[:-1]],
    )


def _split(path: Path) -> tuple[dict[str, str], list[str]]:
    """Return the fields by their letter, and the lines with notes."""
    whole = (line.partition("%")[0].strip() for line in read_text(path, "ABC file").splitlines())
    lines = [line for line in whole if line]
    header: dict[str, str] = {}
    for line in itertools.takewhile(lambda line: line[1] == ":", lines):
        text = line[2:].strip()
        header[line[0]] = f"{header[line[0]]} {text}" if line[0] in header else text
    return header, [line for line in lines if line[1] != ":"]


def _signature(key: str) -> Mapping[str, int]:
    """Return the alterations of a key by letter: of ``"Gm"`` those of B and E."""
    match = _KEY.fullmatch(key)
    if match is None:
        raise ScoreError(f"Key {key!r} is not valid: expected one such as C, F#m or Bb.")
    tonic, accidental, minor = match.groups()
    sharps = _SHARPS.index(tonic) - 1 + 7 * {"": 0, "#": 1, "b": -1}[accidental] - 3 * bool(minor)
    if sharps < 0:
        return dict.fromkeys(_SHARPS[sharps:], -1)
    return dict.fromkeys(_SHARPS[:sharps], 1)


def _read_line(
    voice: _Voice, text: str, unit: Fraction, signature: Mapping[str, int], path: Path
) -> Iterator[tuple[Fraction, str]]:
    """Add the notes of a line to a voice, and yield its marks of the pedal."""
    place = 0
    while place < len(text):
        match = _TOKEN.match(text, place)
        if match is None:
            rest = text[place:].strip()
            raise ScoreError(f"'{path}': {rest!r} is not read: expected notes or a bar line.")
        place = match.end()
        if match["bar"]:
            voice.bars.append(voice.time)
            voice.altered.clear()
        elif match["pedal"]:
            yield voice.time, match["pedal"]
        elif match["triplet"]:
            voice.in_triplet = 3
        else:
            _play(voice, match, unit, signature)
            if voice.unmet:
                raise ScoreError(
                    f"'{path}': a tie before {text[place:]!r} has no note to go on with: expected "
                    "one of the same pitch."
                )


def _play(
    voice: _Voice, match: re.Match[str], unit: Fraction, signature: Mapping[str, int]
) -> None:
    """Add a note, a chord or a rest at the end of a voice."""
    over, slash, under = match["length"].partition("/")
    duration = unit * Fraction(int(over or 1), int(under or 2) if slash else 1)
    if voice.in_triplet:
        voice.in_triplet -= 1
        duration *= Fraction(2, 3)
    end = voice.time + duration
    going_on: dict[int, Fraction] = {}
    for accidental, letter, octaves, tie in _HEAD.findall(match["chord"] or match["note"] or ""):
        pitch = _pitch(voice, accidental, letter, octaves, signature)
        onset = voice.tied.pop(pitch, voice.time)
        if tie or match["tie"]:
            going_on[pitch] = onset
        else:
            voice.strikes.append((onset, end, pitch))
    voice.unmet, voice.tied, voice.time = bool(voice.tied), going_on, end


def _pitch(
    voice: _Voice, accidental: str, letter: str, octaves: str, signature: Mapping[str, int]
) -> int:
    octave = 5 + letter.islower() + octaves.count("'") - octaves.count(",")
    name = letter.upper()
    if accidental:
        voice.altered[name, octave] = _ALTERATIONS[accidental]
    alteration = voice.altered.get((name, octave), signature.get(name, 0))
    return 12 * octave + SEMITONES[name] + alteration


def _common_bars(voices: Mapping[str, _Voice], meter: Fraction, path: Path) -> list[Fraction]:
    """Return where the full bars begin, and where the last one ends, in whole notes.

    Raises:
        ScoreError: If the voices do not agree, or a bar but an upbeat or the last has another
            length than the meter.
    """
    bars = next(iter(voices.values())).bars
    for name, voice in voices.items():
        for number, (expected, found) in enumerate(itertools.zip_longest(bars, voice.bars)):
            if expected != found:
                raise ScoreError(
                    f"'{path}': bar line {number} of voice {name} is at {found} whole notes, that "
                    f"of the first voice at {expected}: expected the same."
                )
        if voice.tied or voice.time != bars[-1]:
            raise ScoreError(f"'{path}': voice {name} does not end with a whole bar and no tie.")
    if bars[1] < meter:  # an upbeat, which has no line where it begins
        bars = bars[1:]
    if any(end - start != meter for start, end in itertools.pairwise(bars[:-1])):
        raise ScoreError(f"'{path}': bars begin at {list(map(str, bars))}: expected each {meter}.")
    return bars


def _notes(voices: Iterable[_Voice], seconds: Fraction) -> Iterator[Note]:
    """Yield the notes; a key is let go before the next note, and in time to be struck again."""
    strikes = sorted(
        (onset * seconds, offset * seconds, pitch, voice.hand)
        for voice in voices
        for onset, offset, pitch in voice.strikes
    )
    struck_next: dict[int, Fraction] = {}
    for onset, offset, pitch, hand in reversed(strikes):
        if struck_next.get(pitch) == onset:
            continue  # two voices meet on a key: the longer note is there already
        end = min(offset, struck_next.get(pitch, offset))
        struck_next[pitch] = onset
        let_go = max(end - LIFT, (onset + end) / 2)
        yield Note(onset=float(onset), offset=float(let_go), pitch=pitch, hand=hand)


def _presses(
    marks: Iterable[tuple[Fraction, str]], end: Fraction, seconds: Fraction
) -> Iterator[Pedal]:
    """Yield the presses of the pedal, which comes up just before it goes down again."""
    for (time, mark), (next_time, _) in itertools.pairwise([*marks, (end, "ped-up")]):
        if mark == "ped":
            yield Pedal(onset=float(time * seconds), offset=float(next_time * seconds - LIFT))
