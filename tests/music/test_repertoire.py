"""Ten fingers can play the repertoire and the encores, and they are what was composed."""

import itertools
import re
from pathlib import Path

import numpy as np
import pytest
from yaml_rows import Tables

from sb3_piano.exceptions import ConfigError
from sb3_piano.lab.music import Corpus
from sb3_piano.music import MAX_PITCH, MIN_PITCH, PianoRoll, find_piece, load_score
from sb3_piano.music.built_in import ENCORE, REPERTOIRE
from sb3_piano.music.hands import finger_number

tables = Tables(__file__)
PIECES = {**REPERTOIRE, **ENCORE}
BLACK = {1, 3, 6, 8, 10}

# How far apart two fingers of a hand can hold keys, in semitones: the greatest practical spans of
# Parncutt et al. (1997), table 1, and a major ninth for thumb and little finger.
SPANS = (10, 12, 14, 14, 5, 7, 10, 4, 7, 5)
REACH = dict(zip(itertools.combinations(range(1, 6), 2), SPANS, strict=True))


@pytest.fixture(scope="module", params=PIECES)
def piece(request):
    return PIECES[request.param]


@pytest.fixture(scope="module")
def score(piece):
    return piece.score()


@pytest.fixture(scope="module", params=REPERTOIRE)
def fingered(request):
    """A score whose notes have fingers."""
    return REPERTOIRE[request.param].score()


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


@pytest.mark.parametrize("pieces", [REPERTOIRE, ENCORE])
def test_each_file_is_a_piece(pieces):
    folder = Path(next(iter(pieces.values())).build.args[0]).parent
    stems = {path.stem for path in folder.glob("*.mid")}
    assert set(pieces) == {f"{folder.name}-{stem}" for stem in stems}


def test_a_piece_says_what_it_is_of_which_free_print_and_who_chose_the_fingers(piece, score):
    assert piece.name.startswith(f"{piece.collection}-")
    assert len(piece.title) > 5
    assert len(piece.source) > 80
    assert re.search(r"\b1[78]\d\d\b|\b19[0-2]\d\b", piece.source), "old enough to be free"
    assert piece.fingering
    assert "\n" not in piece.title + piece.source + piece.fingering
    assert piece.options == {}
    assert find_piece(piece.name.removeprefix(f"{piece.collection}-")) is piece
    assert score.title == piece.name


def test_it_sounds_in_the_middle_of_the_keyboard_for_a_while_with_both_hands(score):
    low, high = score.pitch_range
    assert low >= MIN_PITCH + 3
    assert high <= MAX_PITCH - 7
    assert 10 < score.duration < 150
    assert score.notes[0].onset < 3
    assert {note.hand for note in score.notes} == {"right", "left"}


def test_the_encores_last_twenty_seconds_and_leave_fingers_to_be_found_and_are_in_no_corpus():
    assert len(ENCORE) >= 12
    for piece in ENCORE.values():
        score = piece.score()
        assert 20 <= score.duration <= 45, piece.name
        assert not score.has_fingering
    with pytest.raises(ConfigError, match="Unknown source 'encore'"):
        Corpus(sources={"encore": 1})


def test_no_hand_spans_more_than_a_ninth_or_holds_more_than_five_keys(score):
    for note in score.notes:
        held = [n for n in hand(score, note.hand) if n.onset <= note.onset < n.offset]
        pitches = [n.pitch for n in held]
        assert len(held) <= 5, note
        assert max(pitches) - min(pitches) <= max(SPANS), note


def test_all_notes_have_fingers_that_are_in_the_order_of_keys_held_and_reach_them(fingered):
    assert all(0 <= note.finger <= 9 for note in fingered.notes)
    for lower, upper in held_together(fingered):
        assert lower.pitch < upper.pitch
        assert (lower.finger < upper.finger) == (lower.hand == "right"), (lower, upper)
        fingers = tuple(sorted([finger_number(lower.finger), finger_number(upper.finger)]))
        assert upper.pitch - lower.pitch <= REACH[fingers], (lower, upper)


def test_no_finger_strikes_a_key_before_it_has_left_the_last_one(fingered):
    for finger in range(10):
        notes = [note for note in fingered.notes if note.finger == finger]
        for note, following in itertools.pairwise(notes):
            assert note.offset < following.onset, (note, following)


@pytest.mark.parametrize("factor", [1.0, 1.5, 2.0])
def test_no_key_is_struck_while_it_is_down_in_control_steps_neither_and_fingers_have_one_key(
    score, factor
):
    for pitch in {note.pitch for note in score.notes}:
        notes = [note for note in score.notes if note.pitch == pitch]
        for note, following in itertools.pairwise(notes):
            assert note.offset <= following.onset, (note, following)
    roll = PianoRoll.from_score(score.stretch(factor), 0.05)
    assert np.count_nonzero(roll.onset) == len(score.notes)
    for finger in range(10):
        assert (roll.finger == finger).sum(axis=1).max(initial=0) <= 1


def test_the_thumb_seldom_plays_a_black_key_alone(fingered):
    in_chords = {id(note) for pair in held_together(fingered) for note in pair}
    alone = [
        note
        for note in fingered.notes
        if finger_number(note.finger) == 1
        and note.pitch % 12 in BLACK
        and id(note) not in in_chords
    ]
    assert len(alone) <= 0.05 * len(fingered.notes)


def test_only_an_upbeat_and_the_last_bar_may_be_shorter_than_the_meter(score):
    bar = score.bars[1] - score.bars[0]
    np.testing.assert_allclose(np.diff(score.bars), bar)
    assert 0 <= score.bars[0] < bar
    assert score.bars[-1] < score.duration


def test_the_pedal_comes_up_before_it_goes_down_again_and_at_the_end(score):
    assert all(a.offset < b.onset for a, b in itertools.pairwise(score.pedals))
    assert all(pedal.offset <= score.duration + 1 for pedal in score.pedals)


# What was composed


OPENINGS = Path(__file__).parents[1] / "data" / "music" / "openings.txt"


def openings():
    """Return name, five numbers, pitches of the right hand and of the left."""
    lines = OPENINGS.read_text().strip().splitlines()[2:]
    for head, right, left in zip(lines[::3], lines[1::3], lines[2::3], strict=True):
        name, *numbers = head.split()
        pitches = [[int(pitch) for pitch in hand.split()] for hand in (right, left)]
        yield name, [float(number) for number in numbers], *pitches


@pytest.mark.parametrize(("name", "numbers", "right", "left"), list(openings()))
def test_it_begins_as_it_is_known_in_its_meter_and_tempo(name, numbers, right, left):
    beats, tempo, first, n_bars, n_presses = numbers
    bars = (first + beats * np.arange(n_bars)) * 60 / tempo
    score = load_score(name)
    np.testing.assert_allclose(score.bars, bars, atol=1e-4)
    assert len(score.pedals) == n_presses
    for side, pitches in (("right", right), ("left", left)):
        assert [note.pitch for note in hand(score, side)][: len(pitches)] == pitches


def of_music21(name):
    """Return the strikes of a piece of music21's corpus: (bar, quarter note in it, pitch)."""
    from music21 import corpus

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
    score = load_score(name)
    lines = np.array(score.bars)
    found = set()
    for note in score.notes:
        bar = int(np.searchsorted(lines, note.onset + 1e-6))
        start = lines[bar - 1] if bar else 0.0
        found.add((bar, round((note.onset - start) / quarter, 3), note.pitch))
    return found


@pytest.mark.slow
def test_the_prelude_is_that_of_music21_which_lacks_bar_26():
    ours = strikes("BachPreludeC", 60 / 72)
    shortened = {(bar - (bar > 26), at, pitch) for bar, at, pitch in ours if bar != 26}
    assert shortened == of_music21("bach/bwv846")
    # C over G, with F for E: the suspension that bar 27 resolves, and bar 30 has again.
    bars = [{(at, pitch) for bar, at, pitch in ours if bar == number} for number in (26, 30)]
    assert bars[0] == bars[1]
    assert {pitch for _, pitch in bars[0]} == {43, 50, 55, 60, 65}


@pytest.mark.slow
@tables("name, tempo, known, bars, theirs_alone, ours_alone")
def test_pieces_are_those_of_music21_but_for_a_note(
    name, tempo, known, bars, theirs_alone, ours_alone
):
    ours = strikes(name, 60 / tempo)
    theirs = {strike for strike in of_music21(known) if strike[0] <= bars}
    assert sorted(map(list, theirs - ours)) == theirs_alone
    assert sorted(map(list, ours - theirs)) == ours_alone


def test_in_the_fantaisie_sextuplets_go_against_sixteenths():
    score = REPERTOIRE["repertoire-FantaisieImpromptu"].score()
    sixteenth = 60 / 72 / 8
    onsets = [note.onset / sixteenth for note in hand(score, "left")]
    np.testing.assert_allclose(onsets, [4 * number / 3 for number in range(96)], atol=1e-3)
