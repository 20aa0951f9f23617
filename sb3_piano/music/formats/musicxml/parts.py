"""Choose the pianist's parts of a MusicXML file, and the hands of their staves."""

from __future__ import annotations

import re
import statistics
from collections.abc import Sequence
from pathlib import Path

from sb3_piano.exceptions import ScoreError
from sb3_piano.music.formats.common import chosen_parts
from sb3_piano.music.formats.midi_hands import hand_of_name
from sb3_piano.music.formats.musicxml.source import NAMELESS, SourcePart
from sb3_piano.music.hands import HANDS, Hand

_KEYBOARDS = re.compile(
    r"piano|pno|\bpf(te?)?\b|fortepian|pianino|klav|clavi|clave[cm]|klaver|cemb|harpsi|hpsc?h?d"
    r"|keyboard|\bkeys\b|\bkbd|organ|orgel|orgue|celesta|spinett?|virginal|harmonium|zongora|piyano"
    r"|teclado|tastiera|tasten|пиан|рояль|клавир|ピアノ|钢琴|鋼琴|피아노",
    re.I,
)
_PLAYER = re.compile(r"\b(primo|secondo|[12]|ii?)\b", re.I)
"""Names of the two players of a duet."""


def played_parts(
    parts: Sequence[SourcePart], path: Path, chosen: Sequence[str | int]
) -> list[SourcePart]:
    """Choose the pianist's parts, or parts by name or number from 1.

    Raises:
        ScoreError: If there are none, or the pianist's parts are unclear.
    """
    sounding = [part for part in parts if part.notes]
    if chosen:
        numbers = chosen_parts(path, [part.name for part in parts], chosen)
        sounding = played = [part for n, part in enumerate(parts) if n in numbers and part.notes]
    else:
        played = _of_piano(sounding)
    if not sounding:
        raise ScoreError(f"MusicXML file {str(path)!r} has no notes with a pitch.")
    if not played:
        names = ", ".join(repr(part.name) for part in parts)
        raise ScoreError(
            f"{str(path)!r} has {len(parts)} parts ({names}): expected one or two, or one whose "
            "name or two staves make it the piano's. Choose by 'sb3-piano pieces "
            "import --parts NAME|N --name NAME', in Python by load_score(..., parts=...)."
        )
    return played


def _of_piano(parts: list[SourcePart]) -> list[SourcePart]:
    """Choose the parts of one pianist: by name, else by instrument or two staves."""
    if len(parts) < 2:
        return parts
    named = [p for p in parts if _KEYBOARDS.search(p.name) or hand_of_name(p.name)]
    if len(named) == 1 and named[0].staves == 1:
        is_hand = not _KEYBOARDS.search(named[0].name)  # "Treble" goes with its "Bass"
        named = parts if is_hand and len(parts) == 2 else _with_nameless(named[0], parts)
    grand = [part for part in parts if part.staves > 1]
    sounding = [p for p in parts if p.is_keyboard and (p in grand or NAMELESS.fullmatch(p.name))]
    played = named or sounding or grand
    if len({_PLAYER.sub("", p.name) for p in played}) < len({p.name for p in played}) and any(
        part.staves > 1 for part in played
    ):
        return []  # a duet
    if not named and (len(played) > 2 or (len(played) == 2 and grand)):
        return []
    return played or (parts if len(parts) == 2 else [])


def _with_nameless(one: SourcePart, parts: list[SourcePart]) -> list[SourcePart]:
    """Return a part with one staff and the nameless part of its other hand."""
    place = parts.index(one)
    beside = [part for part in (*parts[place + 1 :], *parts[:place][::-1]) if not part.name]
    return [part for part in parts if part is one or part in beside[:1]]


def hands_of_staves(parts: Sequence[SourcePart]) -> list[dict[int, Hand | None]]:
    """Return the hand of each staff, for each part."""
    by_name = [hand_of_name(part.name) for part in parts]
    single = [index for index, part in enumerate(parts) if part.staves == 1]
    if len(single) == 2:
        first, second = single
        known = by_name[first] or by_name[second]
        if known is not None:  # the nameless one is the other hand
            other = HANDS[known == HANDS[0]]
            by_name[first], by_name[second] = by_name[first] or other, by_name[second] or other
        elif _middle(parts[first]) >= _middle(parts[second]):
            by_name[first], by_name[second] = HANDS
    return [
        _hands_of_part(part, hand, is_alone=len(parts) == 1)
        for part, hand in zip(parts, by_name, strict=True)
    ]


def _hands_of_part(
    part: SourcePart, hand: Hand | None, *, is_alone: bool
) -> dict[int, Hand | None]:
    if part.staves > 1:
        return {1: "right", 2: "left"} if part.staves == 2 else {}
    if hand is None and is_alone and any(note.fingers for note in part.notes):
        hand = "left" if part.clef == "F" else "right"
    return {1: hand}


def _middle(part: SourcePart) -> float:
    return statistics.median(note.pitch for note in part.notes)
