"""Ten fingers can play every piece of the repertoire, and the first ones are what was composed."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

import numpy as np
import pytest
from music21 import corpus

from sb3_piano.music import MAX_PITCH, MIN_PITCH, STUDIES, PianoRoll, load_score
from sb3_piano.music.hands import finger_number
from sb3_piano.music.pitch import pitch_number
from sb3_piano.music.repertoire import REPERTOIRE

PIECES = sorted(REPERTOIRE)
FOLDER = Path(REPERTOIRE["repertoire-FurElise"].build.args[0]).parent
UNITS = {
    "repertoire-TwinkleTwinkle": (60 / 100, 4),  # quarter notes
    "repertoire-OdeToJoy": (60 / 112 / 2, 8),  # eighth notes
    "repertoire-BachPreludeC": (60 / 72 / 4, 16),  # sixteenth notes
    "repertoire-BachMinuetG": (60 / 112 / 2, 6),  # eighth notes
    "repertoire-FurElise": (60 / 66 / 4, 6),  # sixteenth notes
    "repertoire-PathetiqueRondo": (60 / 168 / 2, 8),  # eighth notes
}
"""Length in s of what the tests below count in, and how many of them a bar has."""

RELEASE = 0.05
"""How long before the written end of a note its key is let go, in s."""

BLACK = {1, 3, 6, 8, 10}

# How far apart two fingers of a hand can hold keys, in semitones: the greatest practical spans of
# Parncutt et al. (1997), table 1, and a major ninth for thumb and little finger.
REACH = {
    (1, 2): 10,
    (1, 3): 12,
    (1, 4): 14,
    (1, 5): 14,
    (2, 3): 5,
    (2, 4): 7,
    (2, 5): 10,
    (3, 4): 4,
    (3, 5): 7,
    (4, 5): 5,
}


@pytest.fixture(scope="module", params=PIECES)
def piece(request):
    return REPERTOIRE[request.param]


@pytest.fixture(scope="module")
def score(piece):
    return piece.score()


def hand(score, side):
    return [note for note in score.notes if note.hand == side]


def held_together(score):
    """Return the pairs of notes that one hand holds at the same time, the lower one first."""
    return [
        sorted(pair, key=lambda note: note.pitch)
        for side in ("right", "left")
        for pair in itertools.combinations(hand(score, side), 2)
        if pair[1].onset < pair[0].offset
    ]


# Every piece


def test_each_file_is_a_piece():
    stems = {path.stem for path in FOLDER.glob("*.mid")}
    assert set(REPERTOIRE) == {f"repertoire-{stem}" for stem in stems}


def test_a_piece_says_what_it_is_where_it_comes_from_and_who_chose_the_fingers(piece):
    assert piece.collection == "repertoire"
    assert len(piece.title) > 5
    assert len(piece.source) > 80
    assert piece.fingering
    assert "\n" not in piece.title + piece.source + piece.fingering
    assert piece.options == {}


def test_its_source_names_a_print_old_enough_to_be_free(piece):
    assert re.search(r"\b1[78]\d\d\b|\b19[0-2]\d\b", piece.source)


def test_it_is_found_by_its_name(piece, score):
    assert load_score(piece.name) == score
    assert load_score(piece.name.removeprefix("repertoire-")) == score
    assert score.title == piece.name


def test_it_sounds_in_the_middle_of_the_keyboard_for_a_while(score):
    low, high = score.pitch_range
    assert low >= MIN_PITCH + 7
    assert high <= MAX_PITCH - 7
    assert 10 < score.duration < 150
    assert score.notes[0].onset < 3


def test_both_hands_play_and_all_notes_have_fingers(score):
    assert all(0 <= note.finger <= 9 for note in score.notes)
    assert {note.hand for note in score.notes} == {"right", "left"}


def test_fingers_held_together_are_in_the_order_of_the_keys(score):
    for lower, upper in held_together(score):
        fingers = (lower.finger, upper.finger)
        assert lower.pitch < upper.pitch
        assert (fingers[0] < fingers[1]) == (lower.hand == "right"), (lower, upper)


def test_fingers_held_together_reach_their_keys(score):
    for lower, upper in held_together(score):
        fingers = tuple(sorted([finger_number(lower.finger), finger_number(upper.finger)]))
        assert upper.pitch - lower.pitch <= REACH[fingers], (lower, upper)


def test_no_finger_strikes_a_key_before_it_has_left_the_last_one(score):
    for finger in range(10):
        notes = [note for note in score.notes if note.finger == finger]
        for note, following in itertools.pairwise(notes):
            assert note.offset < following.onset, (note, following)


def test_no_key_is_struck_while_it_is_down(score):
    for pitch in {note.pitch for note in score.notes}:
        notes = [note for note in score.notes if note.pitch == pitch]
        for note, following in itertools.pairwise(notes):
            assert note.offset <= following.onset, (note, following)


def test_in_control_steps_each_note_is_a_strike_and_each_finger_has_one_key(score):
    roll = PianoRoll.from_score(score, 0.05)
    assert np.count_nonzero(roll.onset) == len(score.notes)
    for finger in range(10):
        assert (roll.finger == finger).sum(axis=1).max(initial=0) <= 1


def test_the_thumb_seldom_plays_a_black_key_alone(score):
    in_chords = {id(note) for pair in held_together(score) for note in pair}
    alone = [
        note
        for note in score.notes
        if finger_number(note.finger) == 1
        and note.pitch % 12 in BLACK
        and id(note) not in in_chords
    ]
    assert len(alone) <= 0.05 * len(score.notes)


def test_only_an_upbeat_and_the_last_bar_may_be_shorter_than_the_meter(score):
    bar = score.bars[1] - score.bars[0]
    np.testing.assert_allclose(np.diff(score.bars), bar)
    assert 0 <= score.bars[0] < bar
    assert score.bars[-1] < score.duration


@pytest.mark.parametrize("name", UNITS)
def test_bars_are_as_long_as_the_meter_and_the_tempo_say(name):
    unit, units_per_bar = UNITS[name]
    np.testing.assert_allclose(np.diff(REPERTOIRE[name].score().bars), unit * units_per_bar)


def test_the_pedal_comes_up_before_it_goes_down_again_and_at_the_end(score):
    assert all(a.offset < b.onset for a, b in itertools.pairwise(score.pedals))
    assert all(pedal.offset <= score.duration + 1 for pedal in score.pedals)


# Their tunes and harmonies, by another road


def units(piece, side):
    """Return the notes of a hand as (bar, unit of the bar, pitch, length); bars count from 1.

    Lengths are up to the end that is written: later than the key is let go by the release.
    """
    score, (unit, units_per_bar) = REPERTOIRE[piece].score(), UNITS[piece]
    upbeat = score.bars[0] / unit
    found = []
    for note in hand(score, side):
        bar, at = divmod(round(note.onset / unit - upbeat, 3), units_per_bar)
        length = (note.duration + RELEASE) / unit
        found.append((int(bar) + 1, round(at, 3), note.pitch, round(length, 3)))
    return found


def voice(piece, side, bars):
    """Return the pitches of a hand by bar."""
    notes = units(piece, side)
    return [[pitch for bar, _, pitch, _ in notes if bar == number] for number in bars]


def major(tonic, degrees):
    """Return the pitches of degrees of a major scale: 1 is the tonic, 0 the note below it."""
    steps = (0, 2, 4, 5, 7, 9, 11)
    return [tonic + 12 * ((degree - 1) // 7) + steps[(degree - 1) % 7] for degree in degrees]


def names(text):
    return [pitch_number(name) for name in text.split()]


def test_twinkle_is_the_tune_of_the_debug_set_with_a_middle_part():
    outer = [note.pitch for note in STUDIES["debug-TwinkleTwinkleLittleStar"].score().notes]
    middle = major(60, [5, 5, 4, 4, 3, 3, 2])
    tune = [pitch for _, _, pitch, _ in units("repertoire-TwinkleTwinkle", "right")]
    assert tune == outer + middle + middle + outer
    lengths = [length for *_, length in units("repertoire-TwinkleTwinkle", "right")]
    assert lengths == [1, 1, 1, 1, 1, 1, 2] * 6


def test_the_left_hand_of_twinkle_makes_consonances():
    tune = {(bar, at): pitch for bar, at, pitch, _ in units("repertoire-TwinkleTwinkle", "right")}
    for bar, at, pitch, _ in units("repertoire-TwinkleTwinkle", "left"):
        assert (tune[bar, at] - pitch) % 12 in {0, 3, 4, 7, 8, 9}, (bar, at)


def test_the_ode_is_beethovens_tune_with_its_early_note():
    line = [3, 3, 4, 5, 5, 4, 3, 2, 1, 1, 2, 3]
    middle = [2, 2, 3, 1, 2, 3, 4, 3, 1, 2, 3, 4, 3, 2, 1, 2, -2]
    degrees = [*line, 3, 2, 2, *line, 2, 1, 1, *middle, 3, *line[1:], 2, 1, 1]
    notes = units("repertoire-OdeToJoy", "right")
    assert [pitch for _, _, pitch, _ in notes] == major(60, degrees)
    phrase, quarters = [2] * 12 + [3, 1, 4], [2, 2, 2, 2]
    turns = [2, 1, 1, 2, 2, 2, 1, 1, 2, 2, 2, 2, 2]
    lengths = [*phrase, *phrase, *quarters, *turns, 4, *phrase[1:]]
    assert [length for *_, length in notes] == lengths
    assert (12, 6, 64, 4) in notes  # over the bar line
    assert not [note for note in notes if note[:2] == (13, 0)]


# C is 0: the harmony of each half bar, two quarters in bar 12.
C_MAJOR, G_MAJOR, G_SEVENTH = {0, 4, 7}, {7, 11, 2}, {7, 11, 2, 5}
ODE_PHRASE = [C_MAJOR, C_MAJOR, G_MAJOR, G_MAJOR, C_MAJOR, C_MAJOR]
ODE_HARMONY = [
    *[*ODE_PHRASE, C_MAJOR, G_MAJOR],
    *[*ODE_PHRASE, G_SEVENTH, C_MAJOR],
    *[G_MAJOR, C_MAJOR, G_MAJOR, C_MAJOR, G_MAJOR, {4, 8, 11}],
    *[{9, 0, 4, 2, 6}, G_MAJOR],  # A minor, then D 7th
    *[*ODE_PHRASE, G_SEVENTH, C_MAJOR],
]


def test_the_left_hand_of_the_ode_keeps_to_the_harmony():
    tune = {(bar, at): pitch for bar, at, pitch, _ in units("repertoire-OdeToJoy", "right")}
    for bar, at, pitch, _ in units("repertoire-OdeToJoy", "left"):
        harmony = ODE_HARMONY[2 * (bar - 1) + (at >= 4)]
        assert pitch % 12 in harmony, (bar, at)
        assert tune.get((bar, at), 0 if bar == 13 else pitch) % 12 in harmony, (bar, at)


def corpus_notes(part):
    """Return the notes of a part as `units` does, tied ones as one; a unit is a sixteenth."""
    notes = []
    for bar in part.getElementsByClass("Measure"):
        for item in bar.recurse().notes:
            start, length = 4 * item.getOffsetInHierarchy(bar), 4 * item.quarterLength
            for note in getattr(item, "notes", [item]):
                if note.tie is None or note.tie.type == "start":
                    notes.append([bar.number, float(start), note.pitch.midi, float(length)])
                else:
                    begun = next(n for n in reversed(notes) if n[2] == note.pitch.midi)
                    begun[3] += float(length)
    return notes


def test_the_prelude_is_that_of_the_corpus_which_lacks_bar_26():
    copy = corpus.parse("bach/bwv846")
    for part, side in zip(copy.parts, ("right", "left"), strict=True):
        found = units("repertoire-BachPreludeC", side)
        assert {bar for bar, *_ in found} == set(range(1, 36))
        shortened = [(bar - (bar > 26), *note) for bar, *note in found if bar != 26]
        assert sorted(shortened) == sorted(map(tuple, corpus_notes(part)))


def test_bar_26_of_the_prelude_is_a_fourth_over_the_pedal_point():
    # C over G, with F for E: the suspension that bar 27 resolves, and bar 30 has again.
    assert voice("repertoire-BachPreludeC", "left", [26, 30]) == [names("G2 D3") * 2] * 2
    assert voice("repertoire-BachPreludeC", "right", [26, 30]) == [names("G3 C4 F4") * 4] * 2


# Degrees of G major, 1 is G4 in the right hand and G3 in the left.
MINUET_OPENING = [[5, 1, 2, 3, 4], [5, 1, 1], [6, 4, 5, 6, 7], [8, 1, 1], [4, 5, 4, 3, 2]]
MINUET_RIGHT = [
    *[*MINUET_OPENING, [3, 4, 3, 2, 1], [0, 1, 2, 3, 1], [3, 2]],
    *[*MINUET_OPENING, [3, 4, 3, 2, 1], [2, 3, 2, 1, 0], [1]],
    *[[10, 8, 9, 10, 8], [9, 5, 6, 7, 5], [8, 6, 7, 8, 5], [4, 3, 4, 2]],
    *[[2, 3, 4, 5, 6, 7], [8, 7, 6], [7, 2, 4], [5]],
    *[[5, 1, 0, 1], [6, 1, 0, 1], [5, 4, 3], [2, 1, 0, 1, 2]],
    *[[-2, -1, 0, 1, 2, 3], [4, 3, 2], [3, 5, 1, 0], [-4, -2, 1]],
]
MINUET_LEFT = [
    *[[1, 3, 5, 2], [3], [4], [3], [2], [1], [5, 3, 1], [5, -2, 4, 3, 2]],
    *[[3, 2], [1, 3, 1], [4], [3, 4, 3, 2, 1], [2, 0], [1, 3], [4, 5, -2], [1, -6]],
    *[[1], [0], [-1, 1, -1], [2, -5], [2], [3, 5, 4], [5, 0, 2], [5, -2, 4]],
    *[[3, 5, 3], [4, 6, 4], [3, 2, 1], [5], [-2, 0], [-1, 1, 0], [1, -4, -2], [1, -2, -6]],
]
MINUET_SHARP = {20, 21, 22, 23}  # bars in D major, whose C is sharp


@pytest.mark.slow
@pytest.mark.parametrize(
    ("side", "tonic", "degrees"), [("right", 67, MINUET_RIGHT), ("left", 55, MINUET_LEFT)]
)
def test_the_minuet_has_the_notes_of_the_notebook(side, tonic, degrees):
    for number, bar in enumerate(degrees, start=1):
        expected = major(tonic, bar)
        if number in MINUET_SHARP:
            expected = [pitch + (pitch % 12 == 0) for pitch in expected]
        assert voice("repertoire-BachMinuetG", side, [number]) == [expected], number


def test_the_bars_of_the_minuet_are_in_quarters_and_eighths():
    notes = units("repertoire-BachMinuetG", "right")
    rhythms = [tuple(note[3] for note in notes if note[0] == bar) for bar in range(1, 33)]
    assert rhythms == [
        *[(2, 1, 1, 1, 1), (2, 2, 2)] * 2,
        *[(2, 1, 1, 1, 1)] * 3,
        (1, 5),
        *[(2, 1, 1, 1, 1), (2, 2, 2)] * 2,
        *[(2, 1, 1, 1, 1)] * 3,
        (6,),
        *[(2, 1, 1, 1, 1)] * 3,
        *[(2, 1, 1, 2), (1,) * 6, (2, 2, 2), (2, 2, 2), (6,)],
        *[(2, 1, 1, 2), (2, 1, 1, 2), (2, 2, 2), (1, 1, 1, 1, 2)],
        *[(1,) * 6, (2, 2, 2), (1, 1, 2, 2), (6, 6, 6)],
    ]
    bass = units("repertoire-BachMinuetG", "left")
    voices = {25: {4, 2}, 26: {4, 2}, 28: {4}, 29: {6, 2}}
    for bar, lengths in voices.items():
        assert {length for number, *_, length in bass if number == bar} == lengths, bar
    for bar in set(range(1, 33)) - {1, 25, 26, 28, 29}:  # one voice, without rests
        assert sum(length for number, *_, length in bass if number == bar) == 6, bar


ELISE_MOTIF = [76, 75, 76, 71, 74, 72]
ELISE_BARS = {
    0: [76, 75],
    1: ELISE_MOTIF,
    2: [69, 60, 64, 69],
    3: [71, 64, 68, 71],
    4: [72, 64, 76, 75],
    7: [71, 64, 72, 71],
    8: [69, 71, 72, 74],
    9: [76, 67, 77, 76],
    12: [71, 64, 76],
    13: [76, 88, 75],
    14: [76, 75, 76, 75],
    22: [69],
}
A_MINOR, E_MAJOR = {9, 0, 4}, {4, 8, 11}
ELISE_HARMONY = {
    **dict.fromkeys([2, 4, 6, 8, 11, 16, 18, 20, 22], A_MINOR),
    **dict.fromkeys([3, 7, 17, 21], E_MAJOR),
    9: C_MAJOR,
    10: G_MAJOR,
}


def test_elise_has_beethovens_tune():
    for bar, pitches in ELISE_BARS.items():
        assert voice("repertoire-FurElise", "right", [bar]) == [pitches], bar
    again = {5: 1, 6: 2, 15: 1, 16: 2, 17: 3, 18: 4, 19: 1, 20: 2, 21: 7}
    for bar, first in again.items():
        for side in ("right", "left"):
            once, twice = voice("repertoire-FurElise", side, [first, bar])
            assert once == twice, bar


def test_elise_is_in_sixteenths_that_begin_after_a_rest_in_every_other_bar():
    motif = [(at, 1) for at in range(6)]
    answer = [(0, 2), (3, 1), (4, 1), (5, 1)]
    notes = units("repertoire-FurElise", "right")
    for bar, rhythm in {1: motif, 2: answer, 3: answer, 4: answer, 7: answer, 8: answer}.items():
        assert [(at, length) for number, at, _, length in notes if number == bar] == rhythm, bar


def test_the_middle_of_elise_comes_down_the_scale_step_by_step():
    white = [pitch for pitch in range(MIN_PITCH, MAX_PITCH) if pitch % 12 not in BLACK]
    bars = voice("repertoire-FurElise", "right", [9, 10, 11])
    steps = [[white.index(pitch) for pitch in bar] for bar in bars]
    assert steps[1] == [step - 1 for step in steps[0]]
    assert steps[2] == [step - 1 for step in steps[1]]
    notes = units("repertoire-FurElise", "right")
    assert [length for bar, *_, length in notes if bar in (9, 10, 11)] == [3, 1, 1, 1] * 3


def test_the_left_hand_of_elise_breaks_a_chord_of_the_harmony_in_a_bar():
    notes = units("repertoire-FurElise", "left")
    for bar, harmony in ELISE_HARMONY.items():
        chord = [(at, pitch) for number, at, pitch, _ in notes if number == bar]
        assert [at for at, _ in chord] == [0, 1, 2]
        assert {pitch % 12 for _, pitch in chord} <= harmony, bar
        assert chord[0][1] < chord[1][1] < chord[2][1]
        assert voice("repertoire-FurElise", "right", [bar])[0][0] % 12 in harmony, bar


def test_between_its_parts_elise_is_one_line_in_two_hands():
    both = [
        (bar, at, pitch)
        for side in ("right", "left")
        for bar, at, pitch, _ in units("repertoire-FurElise", side)
    ]
    line = [pitch for bar, at, pitch in sorted(both) if (12, 3) <= (bar, at) < (15, 0)]
    assert line == [64, 76, 64, *[76, 76, 88, 75, 76, 75], *[76, 75, 76, 75, 76, 75]]


# Pitches and lengths in eighths; the small notes are part of the note that they lead to.
RONDO = [
    *[("G4", 1), ("C5", 1), ("D5", 1)],
    *[("Eb5", 3), ("F5", 1), ("D5", 3), ("Eb5", 1)],
    *[("C5", 4), ("C5", 1), ("B4", 1), ("C5", 1), ("D5", 1)],
    *[("Eb5", 1), ("D5", 1), ("Eb5", 1), ("F5", 1), ("G5", 2), ("G5", 2)],
    *[("G5", 6), ("F5", 1), ("G5", 1)],
    *[("Ab5", 4), ("D5", 2), ("Eb5", 1), ("F5", 1)],
    *[("G5", 4), ("C5", 2), ("C5", 1), ("D5", 1)],
    *[("Eb5", 2), ("Eb5", 1), ("F5", 1), ("D5", 2), ("D5", 1), ("Eb5", 1)],
    ("C5", 2),
]
C_MINOR, D_DIMINISHED = {0, 3, 7}, {2, 5, 8, 11}
RONDO_HARMONY = [
    *[C_MINOR, {7, 11, 5, 0}],  # G 7th over C
    *[C_MINOR, {3, 7, 2}],
    *[C_MINOR, {11, 2, 7, 8, 0}],
    *[G_MAJOR, G_MAJOR],
    *[D_DIMINISHED, D_DIMINISHED],
    *[C_MINOR, {8, 0, 3, 6}],  # the augmented sixth
    *[C_MINOR, G_MAJOR],
    *[C_MINOR, {0}],
]


def test_the_rondo_has_beethovens_tune():
    notes = [note[:3] for note in units("repertoire-PathetiqueRondo", "right")]
    starts = [8 * (bar - 1) + at for bar, at, _ in notes]
    gaps = [*np.diff(starts), 2]
    small = [note for note, gap in zip(notes, gaps, strict=True) if gap <= 0.5]
    assert small == [
        *[(2, 4, 74), (3, 0, 77)],
        *[(5, 0, 77), (5, 0.5, 79), (6, 0, 75), (6, 0.5, 77)],
    ]
    principal = [note for note in notes if note not in small]
    assert [pitch for *_, pitch in principal] == [pitch_number(name) for name, _ in RONDO]
    due = np.cumsum([-3, *[length for _, length in RONDO[:-1]]])
    delays = {(2, 4.333): 1 / 3, (3, 0.333): 1 / 3, (5, 1): 1, (6, 1): 1}
    for (bar, at, _), start in zip(principal, due, strict=True):
        assert 8 * (bar - 1) + at == pytest.approx(start + delays.get((bar, at), 0), abs=0.01)


def test_the_left_hand_of_the_rondo_breaks_the_harmony_of_each_half_bar():
    notes = units("repertoire-PathetiqueRondo", "left")
    for number, harmony in enumerate(RONDO_HARMONY):
        bar, half = divmod(number, 2)
        pitches = {
            pitch % 12
            for at_bar, at, pitch, _ in notes
            if at_bar == bar + 1 and half * 4 <= at < half * 4 + 4
        }
        assert pitches == harmony, (bar + 1, half)
    bass = [pitch for bar, at, pitch, _ in notes if at == 0]
    assert bass == names("C3 C3 C4 G3 F3 Eb3 G3")
