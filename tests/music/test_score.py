import copy
import dataclasses
import math
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from short_scores import note_of as note

from sb3_piano.exceptions import ScoreError
from sb3_piano.music import Note, Pedal, Score


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

    def test_numpy_numbers_become_plain_numbers(self):
        made = note(np.float32(0.5), np.float64(1.0), np.int64(60), velocity=np.int32(7))
        assert (
            repr(made) == "Note(onset=0.5, offset=1.0, pitch=60, velocity=7, finger=-1, hand=None)"
        )

    def test_a_known_finger_decides_which_hand_plays(self):
        assert note(0, 1, finger=4).hand == "right"
        assert note(0, 1, finger=5, hand="right").hand == "left"
        assert note(0, 1, hand="left").hand == "left"
        assert note(0, 1).hand is None

    @pytest.mark.parametrize(
        ("fields", "message"),
        [
            ({"onset": 1.5}, "Offset 1.0 s is not after onset 1.5 s"),
            ({"onset": 1.0}, "Offset 1.0 s is not after onset 1.0 s"),
            ({"onset": -0.1}, "Onset -0.1 is no time: expected seconds from 0"),
            ({"onset": math.nan}, "Onset nan is no time"),
            ({"offset": math.inf}, "Offset inf is no time"),
            ({"offset": "2"}, "Offset '2' is no time"),
            ({"pitch": 20}, r"Pitch 20 is out of range: expected 21 \(A0\) to 108 \(C8\)"),
            ({"pitch": 109}, "Pitch 109 is out of range"),
            ({"pitch": 60.0}, "Pitch 60.0 is no whole number"),
            ({"velocity": 0}, "Velocity 0 is out of range: expected 1 to 127"),
            ({"velocity": 128}, "Velocity 128 is out of range"),
            ({"hand": "both"}, "Hand 'both' is not valid: expected 'right', 'left' or None"),
            ({"finger": 10}, r"Finger 10 is out of range: expected 0-4 \(right\), 5-9 \(left\)"),
            ({"finger": -2}, r"Finger -2 is out of range: .* or -1 \(unknown\)"),
        ],
    )
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

    def test_an_empty_score_is_refused_by_title(self):
        with pytest.raises(ScoreError, match="Score 'etude' has no notes"):
            Score(notes=[], title="etude")

    def test_what_is_not_a_note_is_refused_by_index(self):
        with pytest.raises(ScoreError, match="Note 1 of 'etude' is a tuple: expected a Note"):
            Score(notes=[note(0, 1), (0, 1, 60)], title="etude")

    def test_equal_contents_make_equal_scores_with_equal_hashes(self):
        reordered = Score(notes=reversed(three_notes().notes), title="etude")
        assert reordered == three_notes()
        assert hash(reordered) == hash(three_notes())

    def test_the_order_of_simultaneous_notes_of_one_pitch_does_not_matter(self):
        short, long = note(0, 1, finger=1), note(0, 2, finger=0)
        assert Score(notes=[short, long]) == Score(notes=[long, short])

    def test_repr_tells_title_count_and_length(self):
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

    def test_off_the_keyboard_names_the_notes_and_the_range_that_fits(self):
        message = (
            r"Transposing 'etude' by 45 semitones takes 2 of its 3 notes off the keyboard, "
            r"first note 1 \(pitch 64 to 109\): expected -39 to 41"
        )
        with pytest.raises(ScoreError, match=message):
            three_notes().transpose(45)

    def test_a_fraction_of_a_semitone_is_refused(self):
        with pytest.raises(ScoreError, match=r"by 1.5: expected whole semitones"):
            three_notes().transpose(1.5)


class TestStretch:
    def test_factor_two_is_half_as_fast_with_pedals(self):
        slow = three_notes(pedals=[Pedal(onset=0.5, offset=1)]).stretch(2.0)
        assert [(n.onset, n.offset) for n in slow.notes] == [(2, 4), (4, 8), (4, 5)]
        assert slow.pedals == (Pedal(onset=1, offset=2),)

    @pytest.mark.parametrize(
        ("factor", "message"),
        [
            *((x, f"Cannot stretch 'etude' by {x}: expected") for x in (0.0, -1.0, math.nan)),
            (math.inf, "Cannot stretch 'etude' by inf"),
            # 2 and 2.5 times the smallest number above 0 are the same number.
            (5e-324, "Note 2 of 'etude' stretched by 5e-324: offset 1e-323"),
            (7e307, r"Note 1 of 'etude' stretched by 7e\+307: offset inf"),
        ],
    )
    def test_a_factor_that_leaves_no_times_is_refused(self, factor, message):
        with pytest.raises(ScoreError, match=message):
            three_notes().stretch(factor)


class TestTrimSilence:
    def test_the_first_note_starts_at_zero(self):
        assert [n.onset for n in three_notes().trim_silence().notes] == [0, 1, 1]

    def test_a_pedal_is_moved_cut_at_zero_or_dropped_if_wholly_before(self):
        pedals = [(0, 0.5), (0.75, 1.5), (2, 3)]
        trimmed = three_notes(pedals=[Pedal(onset=a, offset=b) for a, b in pedals]).trim_silence()
        assert [(p.onset, p.offset) for p in trimmed.pedals] == [(0, 0.5), (1, 2)]


class TestBars:
    @pytest.mark.parametrize(
        ("change", "bars"),
        [
            (lambda score: score.transpose(3), (0, 1, 1.5, 2, 3, 4)),
            (lambda score: score.stretch(3), (0, 3, 4.5, 6, 9, 12)),
            (lambda score: score.excerpt(1.5, 4), (0, 0.5, 1.5)),
            (lambda score: score.trim_silence(), (0, 0.5, 1, 2, 3)),
        ],
    )
    def test_move_with_the_notes(self, change, bars):
        assert change(three_notes(bars=[0, 1, 1.5, 2, 3, 4])).bars == bars

    def test_numbers_become_plain_ones(self):
        bars = three_notes(bars=np.arange(3, dtype=np.float32)).bars
        assert repr(bars) == "(0.0, 1.0, 2.0)"

    def test_scores_that_differ_only_in_bars_are_equal(self):
        assert three_notes(bars=[0, 2]) == three_notes()
        assert hash(three_notes(bars=[0, 2])) == hash(three_notes())

    @pytest.mark.parametrize(
        ("bars", "message"),
        [
            ([0, -1.0], "Bar line 1 of 'etude' is at -1.0: expected seconds from 0"),
            ([math.nan], "Bar line 0 of 'etude' is at nan: expected seconds"),
            ([0, math.inf], "Bar line 1 of 'etude' is at inf: expected seconds"),
            (["0"], "Bar line 0 of 'etude' is at '0': expected seconds"),
            ([0, 2, 2], "Bar line 2 of 'etude' is at 2 s: expected it after bar line 1 at 2.0 s"),
            ([3, 2], "Bar line 1 of 'etude' is at 2 s: expected it after bar line 0 at 3.0 s"),
        ],
    )
    def test_a_bad_line_is_refused_by_index_and_value(self, bars, message):
        with pytest.raises(ScoreError, match=message):
            three_notes(bars=bars)

    def test_survive_replacing_pickling_and_deep_copying(self):
        score = three_notes(bars=[0, 2], pedals=[Pedal(onset=0, offset=1)])
        assert pickle.loads(pickle.dumps(score)) == copy.deepcopy(score) == score
        for copied in (
            dataclasses.replace(score, title="other"),
            pickle.loads(pickle.dumps(score)),
            copy.deepcopy(score),
        ):
            assert copied.bars == (0, 2)


class TestExcerpt:
    def test_cuts_notes_at_the_end_and_shifts_the_start_to_zero(self):
        cut = three_notes().excerpt(1.5, 3)
        assert [(n.onset, n.offset, n.pitch) for n in cut.notes] == [(0.5, 1.5, 64), (0.5, 1, 67)]

    def test_clips_pedals_on_both_sides(self):
        pedals = [(0, 1.5), (1.75, 2), (2.5, 9), (10, 11)]
        score = three_notes(pedals=[Pedal(onset=a, offset=b) for a, b in pedals])
        cut = score.excerpt(1.0, 3.0).pedals
        assert [(p.onset, p.offset) for p in cut] == [(0, 0.5), (0.75, 1), (1.5, 2)]

    def test_an_empty_result_names_where_the_onsets_lie(self):
        with pytest.raises(ScoreError, match=r"No note of 'etude' .* between 1.0 s and 2.0 s"):
            three_notes().excerpt(2.5, 3)

    @pytest.mark.parametrize(
        ("start", "end"), [(2, 1), (1, 1), (-1, 1), (math.nan, 1), (0, math.nan), (math.inf, 1)]
    )
    def test_times_out_of_order_are_refused_by_value(self, start, end):
        with pytest.raises(ScoreError, match=f"from {start} s to {end} s: expected 0 <= start"):
            three_notes().excerpt(start, end)

    @given(cut=st.floats(1.0, 2.0, exclude_min=True))
    def test_every_onset_lands_in_exactly_one_of_two_neighbouring_excerpts(self, cut):
        before, after = three_notes().excerpt(0, cut), three_notes().excerpt(cut, 4)
        assert [n.pitch for n in before.notes + after.notes] == [60, 64, 67]
