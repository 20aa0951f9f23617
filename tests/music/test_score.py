import copy
import dataclasses
import math
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from short_scores import note_of as note
from yaml_rows import Tables

from sb3_piano.exceptions import ScoreError
from sb3_piano.music import Note, Pedal, Score

tables = Tables(__file__)


def three_notes(**fields):
    """C4 at 1-2 s, G4 at 2-2.5 s, E4 at 2-4 s."""
    return Score(
        notes=[note(1, 2), note(2, 2.5, 67, finger=4), note(2, 4, 64)], title="etude", **fields
    )


class TestNote:
    def test_what_it_knows(self):
        low, high = note(1.5, 3.75, 21), note(0, 1, 108, velocity=127, finger=9)
        assert (low.key, high.key, low.duration) == (0, 87, 2.25)
        assert (low.velocity, low.finger) == (80, -1)
        with pytest.raises(dataclasses.FrozenInstanceError, match="pitch"):
            low.pitch = 61
        plain = "Note(onset=0.5, offset=1.0, pitch=60, velocity=7, finger=-1, hand=None)"
        of_numpy = note(np.float32(0.5), np.float64(1.0), np.int64(60), velocity=np.int32(7))
        assert repr(of_numpy) == plain

    def test_a_known_finger_decides_which_hand_plays(self):
        assert note(0, 1, finger=4).hand == "right"
        assert note(0, 1, finger=5, hand="right").hand == "left"
        assert note(0, 1, hand="left").hand == "left"
        assert note(0, 1).hand is None

    @tables("fields, message")
    def test_a_bad_value_is_refused_with_its_range(self, fields, message):
        with pytest.raises(ScoreError, match=message):
            Note(**{"onset": 0.0, "offset": 1.0, "pitch": 60, **fields})


class TestConstruction:
    def test_notes_are_sorted_by_onset_then_pitch(self):
        assert [n.pitch for n in three_notes().notes] == [60, 64, 67]

    def test_overlapping_and_touching_pedals_are_merged(self):
        pedals = [(3, 4), (0, 1), (1, 2), (3.5, 3.75), (5, 6)]
        merged = three_notes(pedals=[Pedal(onset=a, offset=b) for a, b in pedals]).pedals
        assert [(p.onset, p.offset) for p in merged] == [(0, 2), (3, 4), (5, 6)]

    def test_no_notes_or_what_is_not_a_note_are_refused_by_title_and_index(self):
        with pytest.raises(ScoreError, match="Score 'etude' has no notes"):
            Score(notes=[], title="etude")
        with pytest.raises(ScoreError, match="Note 1 of 'etude' is a tuple: expected a Note"):
            Score(notes=[note(0, 1), (0, 1, 60)], title="etude")

    def test_equal_contents_make_equal_scores_with_equal_hashes_whatever_their_order(self):
        notes = [*three_notes().notes, note(0, 1, finger=1), note(0, 2, finger=0)]
        one, other = Score(notes=notes), Score(notes=notes[::-1], bars=[0, 2])
        assert (one, hash(one)) == (other, hash(other))
        assert repr(three_notes()) == "Score('etude', 3 notes, 4 s)"
        assert repr(Score(notes=[note(0, 0.5)])) == "Score('', 1 note, 0.5 s)"


def test_duration_is_the_latest_offset_and_one_label_is_a_fingering():
    assert Score(notes=[note(0, 9), note(1, 2)]).duration == 9
    assert three_notes().has_fingering
    assert not Score(notes=[note(0, 1)]).has_fingering
    assert three_notes().pitch_range == (60, 67)


class TestTranspose:
    def test_moves_every_pitch_and_nothing_else(self):
        pedals = [Pedal(onset=0, offset=1)]
        moved = three_notes(pedals=pedals).transpose(-12)
        assert [n.pitch for n in moved.notes] == [48, 52, 55]
        assert [dataclasses.replace(n, pitch=n.pitch + 12) for n in moved.notes] == list(
            three_notes().notes
        )
        assert (moved.pedals, moved.title) == (tuple(pedals), "etude")

    def test_off_the_keyboard_or_by_a_fraction_is_refused_with_what_fits(self):
        message = (
            r"Transposing 'etude' by 45 semitones takes 2 of its 3 notes off the keyboard, "
            r"first note 1 \(pitch 64 to 109\): expected -39 to 41"
        )
        with pytest.raises(ScoreError, match=message):
            three_notes().transpose(45)
        with pytest.raises(ScoreError, match=r"by 1.5: expected whole semitones"):
            three_notes().transpose(1.5)


class TestStretch:
    def test_factor_two_is_half_as_fast_with_pedals(self):
        slow = three_notes(pedals=[Pedal(onset=0.5, offset=1)]).stretch(2.0)
        assert [(n.onset, n.offset) for n in slow.notes] == [(2, 4), (4, 8), (4, 5)]
        assert slow.pedals == (Pedal(onset=1, offset=2),)

    @tables("factor, message")
    def test_a_factor_that_leaves_no_times_is_refused(self, factor, message):
        with pytest.raises(ScoreError, match=message):
            three_notes().stretch(factor)


def test_a_warp_moves_all_times_and_leaves_out_bar_lines_before_the_start():
    score = three_notes(pedals=[Pedal(onset=1.5, offset=2)], bars=[0, 1, 2])
    moved = score.warp(lambda time: 2 * time - 1)
    assert [(n.onset, n.offset) for n in moved.notes] == [(1, 3), (3, 7), (3, 4)]
    assert (moved.pedals, moved.bars) == ((Pedal(onset=2, offset=3),), (1, 3))
    with pytest.raises(ScoreError, match=r"Note 0 of .* warped: onset -1.0 is no time"):
        score.warp(lambda time: time - 2)


def test_without_silence_the_first_note_starts_at_zero_and_pedals_move_or_are_cut():
    pedals = [(0, 0.5), (0.75, 1.5), (2, 3)]
    trimmed = three_notes(pedals=[Pedal(onset=a, offset=b) for a, b in pedals]).trim_silence()
    assert [n.onset for n in trimmed.notes] == [0, 1, 1]
    assert [(p.onset, p.offset) for p in trimmed.pedals] == [(0, 0.5), (1, 2)]


class TestBars:
    def test_move_with_the_notes_and_become_plain_numbers(self):
        score = three_notes(bars=[0, 1, 1.5, 2, 3, 4])
        assert score.transpose(3).bars == (0, 1, 1.5, 2, 3, 4)
        assert score.stretch(3).bars == (0, 3, 4.5, 6, 9, 12)
        assert score.excerpt(1.5, 4).bars == (0, 0.5, 1.5)
        assert score.trim_silence().bars == (0, 0.5, 1, 2, 3)
        numbers = three_notes(bars=np.arange(3, dtype=np.float32)).bars
        assert repr(numbers) == "(0.0, 1.0, 2.0)"

    @tables("bars, message")
    def test_a_bad_line_is_refused_by_index_and_value(self, bars, message):
        with pytest.raises(ScoreError, match=message):
            three_notes(bars=bars)

    def test_survive_replacing_pickling_and_deep_copying(self):
        score = three_notes(bars=[0, 2], pedals=[Pedal(onset=0, offset=1)])
        copies = [pickle.loads(pickle.dumps(score)), copy.deepcopy(score)]
        assert copies == [score, score]
        for copied in (dataclasses.replace(score, title="other"), *copies):
            assert copied.bars == (0, 2)


class TestExcerpt:
    def test_cuts_notes_at_the_end_and_pedals_on_both_sides_and_starts_at_zero(self):
        pedals = [(0, 1.75), (1.875, 2), (2.5, 9), (10, 11)]
        cut = three_notes(pedals=[Pedal(onset=a, offset=b) for a, b in pedals]).excerpt(1.5, 3)
        assert [(n.onset, n.offset, n.pitch) for n in cut.notes] == [(0.5, 1.5, 64), (0.5, 1, 67)]
        assert [(p.onset, p.offset) for p in cut.pedals] == [(0, 0.25), (0.375, 0.5), (1, 1.5)]

    def test_times_out_of_order_and_an_empty_result_are_refused(self):
        nan, inf = math.nan, math.inf
        for start, end in ((2, 1), (1, 1), (-1, 1), (nan, 1), (0, nan), (inf, 1)):
            with pytest.raises(ScoreError, match=f"from {start} s to {end} s: expected 0 <= start"):
                three_notes().excerpt(start, end)
        with pytest.raises(ScoreError, match=r"No note of 'etude' .* between 1.0 s and 2.0 s"):
            three_notes().excerpt(2.5, 3)

    @given(cut=st.floats(1.0, 2.0, exclude_min=True))
    def test_every_onset_lands_in_exactly_one_of_two_neighbouring_excerpts(self, cut):
        before, after = three_notes().excerpt(0, cut), three_notes().excerpt(cut, 4)
        assert [n.pitch for n in before.notes + after.notes] == [60, 64, 67]
