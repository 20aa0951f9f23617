"""Infer the hands of a MIDI file's tracks from names and pitches."""

from __future__ import annotations

import re
import statistics
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from sb3_piano.music.hands import HANDS, Hand

_PHRASES: dict[Hand, str] = {
    "right": "right hand|righthand|rh|rechte hand|main droite|mano destra|mano derecha",
    "left": "left hand|lefthand|lh|linke hand|main gauche|mano sinistra|mano izquierda",
}
"""Words that name a hand anywhere in the name of a track."""

_BARE: dict[Hand, str] = {
    "right": "right|upper|upper staff|treble|treble clef|treble staff|rechts|droite|md",
    "left": "left|lower|lower staff|bass clef|bass staff|links|gauche|mg|ms",
}
"""Words that name a hand only without another instrument: not "Guitar left"."""

_PIANO = "piano|pianoforte|pno|pf|klavier|clavier|keyboard|keys|grand|acoustic|solo|track|part"

_PIANOS = range(8)
"""The piano programs of General MIDI, including harpsichord and clavinet."""

_LEAST_DISTANCE = 7
"""Least distance of the middles of two tracks that are the two hands, semitones: a fifth."""

_MOST_STRUCK_AT_ONCE = 5


class MidiNote(NamedTuple):
    """A note with its first and last tick."""

    start: int
    end: int
    pitch: int
    velocity: int


@dataclass
class MidiTrack:
    """The notes of one program in a track."""

    name: str
    program: int
    notes: list[MidiNote] = field(default_factory=list)


def hands_of_tracks(tracks: Sequence[MidiTrack]) -> list[Hand | None]:
    """Infer the hand of each track with notes (no drums), None where unknown.

    The names decide, see :func:`hand_of_name`. Without a telling name, two tracks of one piano are
    the two hands if the medians of their pitches are at least a fifth apart and neither strikes
    more than five keys at a time. The higher one is then the right hand.
    """
    hands = [hand_of_name(track.name) for track in tracks]
    if not any(hands) and _are_of_one_piano(tracks) and not any(map(_is_too_full, tracks)):
        first, second = (statistics.median(note.pitch for note in track.notes) for track in tracks)
        if abs(first - second) >= _LEAST_DISTANCE:
            return list(HANDS) if first > second else list(reversed(HANDS))
    return hands


def hand_of_name(name: str) -> Hand | None:
    """Find the hand in the name of a track: ``"Piano RH"``, ``"main gauche"``.

    Case, digits, punctuation and the word piano do not matter. A name with both hands, or with
    another instrument ("Guitar left"), gives None.
    """
    apart = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).casefold()
    letters = re.sub(r"[\W\d_]+", " ", apart)
    # Initials are one word: R.H. and m. d.
    words = re.sub(r"\b([rlm]) ([hdgs])\b", r"\1\2", letters).split()
    text = " ".join(words)
    bare = " ".join(word for word in words if not re.fullmatch(_PIANO, word))
    told = [
        hand
        for hand in HANDS
        if re.fullmatch(_BARE[hand], bare) or re.search(rf"\b({_PHRASES[hand]})\b", text)
    ]
    return told[0] if len(told) == 1 else None


def _are_of_one_piano(tracks: Sequence[MidiTrack]) -> bool:
    programs = {track.program for track in tracks}
    return len(tracks) == 2 and len(programs) == 1 and programs <= set(_PIANOS)


def _is_too_full(track: MidiTrack) -> bool:
    """Return whether a track strikes more keys at a time than one hand can."""
    struck = Counter(note.start for note in track.notes)
    return max(struck.values()) > _MOST_STRUCK_AT_ONCE
