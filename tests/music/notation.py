"""A short notation of the MusicXML that test cases are made of.

Measures stand between bars, ``C4:4 +E4:4 | ~D4 F#4:16{tie(start)}``. Whatever is no note is an
element by its name, with what it is called with: ``tempo(60)``. A note has a name, its length in
sixteenths after a colon, a voice after a slash, a staff after an @, and elements inside it in
braces; one with a plus is struck with the note before it, one with a tilde is a grace note.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

DIVISIONS = 4

_WORD = re.compile(r"(?:[^\s(){}]|\([^)]*\)|\{[^}]*\})+")
_NOTE = re.compile(r"(~?)(\+?)([A-H])(#?)(\d)(?::([^/@{]*))?(?:/(\d))?(?:@(\d))?(?:\{(.*)\})?")
_ELEMENT = re.compile(r"([\w-]+)(?:\((.*)\))?")


class Notation:
    """Makes MusicXML of the notation, with what elements mean by their names."""

    def __init__(self, elements: Mapping[str, str]) -> None:
        self._elements = elements

    def document(self, parts: Mapping[str, str], **options: str | int) -> str:
        """Return a document of parts by name, ``_`` for a space; with options of :meth:`part`."""
        names = "".join(
            f'<score-part id="{name}"><part-name>{name.replace("_", " ")}</part-name></score-part>'
            for name in parts
        )
        music = (
            f'<part id="{name}">{self.part(text, **options)}</part>' for name, text in parts.items()
        )
        return (
            '<?xml version="1.0" encoding="UTF-8"?><!DOCTYPE score-partwise PUBLIC "-//Recordare//'
            'DTD MusicXML 3.1 Partwise//EN" "http://www.musicxml.org/dtds/partwise.dtd">'
            f"<score-partwise><part-list>{names}</part-list>{''.join(music)}</score-partwise>"
        )

    def part(
        self,
        text: str,
        *,
        staves: int = 1,
        clef: str = "G",
        transpose: str = "",
        divisions: str = f"<divisions>{DIVISIONS}</divisions>",
        meter: str = "<beats>4</beats><beat-type>4</beat-type>",
        first: str = 'number="1"',
    ) -> str:
        """Return the measures of a part; ``first`` are the attributes of the first of them."""
        head = (
            f"<attributes>{divisions}<time>{meter}</time><staves>{staves}</staves>"
            f"<clef><sign>{clef}</sign><line>2</line></clef>{transpose}</attributes>"
        )
        measures = ["".join(map(self._made, _WORD.findall(one))) for one in text.split("|")]
        marks = [first, *(f'number="{number}"' for number in range(2, len(measures) + 1))]
        return "".join(
            f"<measure {mark}>{head if mark is first else ''}{music}</measure>"
            for mark, music in zip(marks, measures, strict=True)
        )

    def _made(self, word: str) -> str:
        note = _NOTE.fullmatch(word)
        if note is None:
            name, given = _ELEMENT.fullmatch(word).groups()
            return self._elements[name].format(*(given or "").split(";"))
        grace, chord, step, sharp, octave, length, voice, staff, inside = note.groups()
        duration = "<grace/>" if grace else f"<duration>{length}</duration>"
        words = _WORD.findall((inside or "").replace(",", " "))
        return (
            f"<note>{'<chord/>' if chord else ''}<pitch><step>{step}</step>"
            f"{'<alter>1</alter>' if sharp else ''}<octave>{octave}</octave></pitch>{duration}"
            f"<voice>{voice or 1}</voice><staff>{staff or 1}</staff>"
            f"{''.join(map(self._made, words))}</note>"
        )
