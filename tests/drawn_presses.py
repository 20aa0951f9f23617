"""Presses of a hand, drawn by hypothesis."""

from __future__ import annotations

from hypothesis import strategies as st

from sb3_piano.music.constants import NUM_KEYS
from sb3_piano.music.presses import Press


@st.composite
def hand_presses(draw, longest=12, most=10, rests=4):
    """Draw what a hand plays, in order of time: chords and lines, each finger on one key a time."""
    free_from = [1] * 5  # the first state in which each finger and ...
    silent_from: dict[int, int] = {}  # ... each key may be struck
    presses = []
    for _ in range(draw(st.integers(1, most))):
        finger = draw(st.integers(0, 4))
        key = draw(st.integers(0, NUM_KEYS - 1))
        earliest = max(free_from[finger], silent_from.get(key, 1))
        first = earliest + draw(st.integers(0, rests))
        last = first + draw(st.integers(0, longest))
        presses.append(Press(key, finger, first, last))
        free_from[finger] = last + 1
        silent_from[key] = last + 2
    return sorted(presses, key=lambda press: (press.first, press.key))
