"""Fingers for a whole score."""

from __future__ import annotations

from dataclasses import replace

from sb3_piano.music.constants import UNKNOWN_FINGER
from sb3_piano.music.fingering.search import finger_hand
from sb3_piano.music.fingering.split import assign_hands
from sb3_piano.music.fingering.weights import DEFAULT_WEIGHTS, FingeringWeights
from sb3_piano.music.hands import HANDS, finger_of
from sb3_piano.music.score import Score


def finger_score(score: Score, weights: FingeringWeights = DEFAULT_WEIGHTS) -> Score:
    """Return the score with a finger for each note.

    Fingers that are known stay, and so do hands; `assign_hands` finds the other hands. At most
    ten fingers are on keys at a time, and none on two. Where more is asked of a hand, as by a
    sustain pedal written out as long notes, it lets go of the key held longest first: that note
    keeps its length, but its finger goes on. Of more than five keys struck together by one hand,
    the outer five have a finger; the others have their hand, and no finger (-1).

    Args:
        score: The score; notes keep their times, pitches and velocities.
        weights: What makes a fingering hard.
    """
    score = assign_hands(score)
    notes = list(score.notes)
    for hand in HANDS:
        indices = [index for index, note in enumerate(notes) if note.hand == hand]
        found = finger_hand([notes[index] for index in indices], hand, weights)
        for index, finger in zip(indices, found.fingers, strict=True):
            if notes[index].finger == UNKNOWN_FINGER != finger:
                notes[index] = replace(notes[index], finger=finger_of(hand, finger + 1))
    return replace(score, notes=tuple(notes))
