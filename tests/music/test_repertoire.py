"""Ten fingers can play every piece of the repertoire, and it is what was composed."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

import numpy as np
import pytest
from music21 import corpus

from sb3_piano.music import MAX_PITCH, MIN_PITCH, PianoRoll, load_score
from sb3_piano.music.hands import finger_number
from sb3_piano.music.repertoire import REPERTOIRE

PIECES = sorted(REPERTOIRE)
FOLDER = Path(REPERTOIRE["repertoire-FurElise"].build.args[0]).parent
BLACK = {1, 3, 6, 8, 10}

# How far apart two fingers of a hand can hold keys, in semitones: the greatest practical spans of
# Parncutt et al. (1997), table 1, and a major ninth for thumb and little finger.
SPANS = (10, 12, 14, 14, 5, 7, 10, 4, 7, 5)
REACH = dict(zip(itertools.combinations(range(1, 6), 2), SPANS, strict=True))


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


def test_fingers_held_together_are_in_the_order_of_the_keys_and_reach_them(score):
    for lower, upper in held_together(score):
        assert lower.pitch < upper.pitch
        assert (lower.finger < upper.finger) == (lower.hand == "right"), (lower, upper)
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


@pytest.mark.parametrize("factor", [1.0, 1.5, 2.0])
def test_in_control_steps_each_note_is_a_strike_and_each_finger_has_one_key(score, factor):
    roll = PianoRoll.from_score(score.stretch(factor), 0.05)
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


def test_the_pedal_comes_up_before_it_goes_down_again_and_at_the_end(score):
    assert all(a.offset < b.onset for a, b in itertools.pairwise(score.pedals))
    assert all(pedal.offset <= score.duration + 1 for pedal in score.pedals)


# What was composed


# For each piece: the beats of a bar and of a minute, beats before the first bar, how many bars,
# how often the pedal goes down; then how each hand, right and left, begins in MIDI pitches.
OPENINGS = """
BachMinuetG 3 112 0 32 0
  74 67 69 71 72 74 67 67 76 72 74 76 78 79 67 67 72 74 72 71 69 71 72 71 69 67
  55 59 62 57 59 60 59 57
BachPreludeC 4 72 0 35 0
  67 72 76 67 72 76 67 72 76 67 72 76 69 74 77 69 74 77 69 74 77 69 74 77
  60 64 60 64 60 62 60 62 59 62 59 62 60 64
ChopinNocturneOp9No2 12 132 1 4 15
  70 79 77 79 77 75 70 79 72 84 79 82 80 79 77 79 74 75 72 70 86 84 82 80 79 80 72 74 75
  39 55 63 58 63 67 51 56 62 59 62 68
ClairDeLune 3 46 0 8 15
  77 80 73 77 72 75 73 77 72 75 70 73 72 75 70 73 77 73
  65 68 66 69 65 68 63 66 61 63 60 63 58 61
FantaisieImpromptu 2 72 0 8 11
  68 69 68 67 68 73 76 75 73 75 73 72 73 76 80 68 69 68 67 68 73 76 75 73 75 73 72 73 76 80
  49 56 61 64 61 56 52 56 61 64 61 56 49 56
FurElise 1.5 66 0.5 22 16
  76 75 76 75 76 71 74 72 69 60 64 69 71 64 68 71 72 64 76 75 76 75 76 71 74 72 69
  45 52 57 40 52 56 45 52 57
Gymnopedie1 3 72 0 21 21
  78 81 79 78 73 71 73 74 69 66 78 81 79 78 73 71 73 74 69 73 78 64
  43 59 62 66 38 57 61 66 43 59 62 66
MapleLeafRag 2 92 0.5 16 0
  68 63 75 68 72 63 75 67 63 75 67 70 63 75 68
  39 51 44 56 51 56 60 51 56 60 45 57 46 58
OdeToJoy 4 112 0 16 0
  64 64 65 67 67 65 64 62 60 60 62 64 64 62 62 64 64 65 67 67 65 64 62 60 60 62 64 62 60 60
  48 52 55 47 50 55 48 52 55
PathetiqueRondo 4 168 1.5 8 12
  67 72 74 75 77 74 75 72 74 72 71 72 74 77 75 74 75 77 79 79
  48 51 55 60 48 53 55 59 48 51 55 60
Reverie 4 92 0 10 10
  79 74 76 77 79 76 74 76 72 76 74 70 74 76 77 72 67 69
  58 60 62 67 62 60 58 60 62 67 62 60 58
TwinkleTwinkle 4 100 0 12 0
  60 60 67 67 69 69 67 65 65 64 64 62 62 60 67 67 65 65 64 64 62 67 67 65 65 64 64 62
  48 52 53 52 50 48 53 55 48 52 50 48
"""


def openings():
    """Return the table above: name, five numbers, pitches of the right hand and of the left."""
    lines = OPENINGS.strip().splitlines()
    for head, right, left in zip(lines[::3], lines[1::3], lines[2::3], strict=True):
        name, *numbers = head.split()
        pitches = [[int(pitch) for pitch in hand.split()] for hand in (right, left)]
        yield name, [float(number) for number in numbers], *pitches


@pytest.mark.parametrize(("name", "numbers", "right", "left"), list(openings()))
def test_it_begins_as_it_is_known_in_its_meter_and_tempo(name, numbers, right, left):
    beats, tempo, first, n_bars, n_presses = numbers
    bars = (first + beats * np.arange(n_bars)) * 60 / tempo
    score = REPERTOIRE[f"repertoire-{name}"].score()
    np.testing.assert_allclose(score.bars, bars, atol=1e-4)
    assert len(score.pedals) == n_presses
    for side, pitches in (("right", right), ("left", left)):
        assert [note.pitch for note in hand(score, side)][: len(pitches)] == pitches


def of_music21(name):
    """Return the strikes of a piece of music21's corpus: (bar, quarter note in it, pitch)."""
    struck = set()
    for staff in corpus.parse(name).parts:
        for bar in staff.getElementsByClass("Measure"):
            for item in bar.recurse().notes:
                for note in getattr(item, "notes", [item]):
                    if note.tie is None or note.tie.type == "start":
                        at = float(item.getOffsetInHierarchy(bar))
                        struck.add((bar.number, at, note.pitch.midi))
    return struck


def strikes(name, quarter):
    """Return the same of a piece of ours; a bar of an upbeat has the number 0."""
    score = REPERTOIRE[f"repertoire-{name}"].score()
    lines = np.array(score.bars)
    found = set()
    for note in score.notes:
        bar = int(np.searchsorted(lines, note.onset + 1e-6))
        start = lines[bar - 1] if bar else 0.0
        found.add((bar, round((note.onset - start) / quarter, 3), note.pitch))
    return found


def test_the_prelude_is_that_of_music21_which_lacks_bar_26():
    ours = strikes("BachPreludeC", 60 / 72)
    shortened = {(bar - (bar > 26), at, pitch) for bar, at, pitch in ours if bar != 26}
    assert shortened == of_music21("bach/bwv846")
    # C over G, with F for E: the suspension that bar 27 resolves, and bar 30 has again.
    bars = [{(at, pitch) for bar, at, pitch in ours if bar == number} for number in (26, 30)]
    assert bars[0] == bars[1]
    assert {pitch for _, pitch in bars[0]} == {43, 50, 55, 60, 65}


def test_the_maple_leaf_rag_is_that_of_music21_but_for_a_misprint():
    ours = strikes("MapleLeafRag", 60 / 92)
    theirs = {strike for strike in of_music21("joplin/maple_leaf_rag") if strike[0] <= 16}
    upbeat_of_the_repeat = {(16, 1.5, 39), (16, 1.5, 51)}
    assert theirs - ours == {(16, 0.0, 55), *upbeat_of_the_repeat}
    assert ours - theirs == {(16, 0.0, 56)}


def test_in_the_fantaisie_sextuplets_go_against_sixteenths():
    score = REPERTOIRE["repertoire-FantaisieImpromptu"].score()
    sixteenth = 60 / 72 / 8
    onsets = [note.onset / sixteenth for note in hand(score, "left")]
    np.testing.assert_allclose(onsets, [4 * number / 3 for number in range(96)], atol=1e-3)
