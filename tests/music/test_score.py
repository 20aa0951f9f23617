import copy
import dataclasses
import math
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sb3_piano.exceptions import ScoreError
from sb3_piano.music import Note, Pedal, Score


def note(onset, offset, pitch=60, **fields):
    return Note(onset=onset, offset=offset, pitch=pitch, **fields)


def three_notes(**fields):
    """C4 at 1-2 s, G4 at 2-2.5 s, E4 at 2-4 s."""
    return Score(
        notes=[note(1, 2), note(2, 2.5, 67, finger=4), note(2, 4, 64)], title="etude", **fields
    )


class TestNote:
    def test_defaults_are_velocity_80_and_no_finger(self):
        assert (note(0, 1).velocity, note(0, 1).finger) == (80, -1)

    def test_lowest_and_highest_pitch_are_keys_0_and_87(self):
        assert [note(0, 1, 21).key, note(0, 1, 108).key] == [0, 87]

    def test_duration_is_the_time_from_onset_to_offset(self):
        assert note(1.5, 3.75).duration == 2.25

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

    def test_cannot_be_changed(self):
        with pytest.raises(dataclasses.FrozenInstanceError, match="pitch"):
            note(0, 1).pitch = 61

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

    @pytest.mark.parametrize("fields", [{"velocity": 1}, {"velocity": 127}, {"finger": 9}])
    def test_the_ends_of_the_ranges_are_valid(self, fields):
        assert dataclasses.replace(note(0, 1), **fields)


class TestConstruction:
    def test_notes_are_sorted_by_onset_then_pitch(self):
        assert [n.pitch for n in three_notes().notes] == [60, 64, 67]

    def test_any_iterable_of_notes_is_stored_as_a_tuple(self):
        assert Score(notes=(note(t, t + 1) for t in (2, 0))).notes == (note(0, 1), note(2, 3))

    def test_overlapping_and_touching_pedals_are_merged(self):
        pedals = [(3, 4), (0, 1), (1, 2), (3.5, 3.75), (5, 6)]
        merged = three_notes(pedals=[Pedal(onset=a, offset=b) for a, b in pedals]).pedals
        assert [(p.onset, p.offset) for p in merged] == [(0, 2), (3, 4), (5, 6)]

    def test_a_pedal_must_end_after_it_starts(self):
        with pytest.raises(ScoreError, match=r"Offset 1.0 s is not after onset 2.0 s"):
            Pedal(onset=2, offset=1)

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

    def test_the_title_is_part_of_equality(self):
        assert dataclasses.replace(three_notes(), title="other") != three_notes()

    def test_survives_pickling_and_deep_copying(self):
        score = three_notes(pedals=[Pedal(onset=0, offset=1)])
        assert pickle.loads(pickle.dumps(score)) == score
        assert copy.deepcopy(score) == score

    def test_cannot_be_changed(self):
        with pytest.raises(dataclasses.FrozenInstanceError, match="title"):
            three_notes().title = "other"

    def test_repr_tells_title_count_and_length(self):
        assert repr(three_notes()) == "Score('etude', 3 notes, 4 s)"
        assert repr(Score(notes=[note(0, 0.5)])) == "Score('', 1 note, 0.5 s)"


class TestProperties:
    def test_duration_is_the_latest_offset_not_that_of_the_last_note(self):
        assert Score(notes=[note(0, 9), note(1, 2)]).duration == 9

    def test_has_fingering_needs_one_label(self):
        assert three_notes().has_fingering
        assert not Score(notes=[note(0, 1)]).has_fingering

    def test_pitch_range_is_lowest_and_highest(self):
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

    @pytest.mark.parametrize("semitones", [-39, 41])
    def test_reaches_both_ends_of_the_keyboard(self, semitones):
        assert three_notes().transpose(semitones).transpose(-semitones) == three_notes()

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

    @pytest.mark.parametrize("factor", [0.0, -1.0, math.nan, math.inf])
    def test_a_senseless_factor_is_refused_by_value(self, factor):
        with pytest.raises(ScoreError, match=f"Cannot stretch 'etude' by {factor}: expected"):
            three_notes().stretch(factor)

    def test_a_note_squeezed_to_nothing_is_named(self):
        # 2 and 2.5 times the smallest number above 0 are the same number.
        with pytest.raises(
            ScoreError, match=r"Note 2 of 'etude' stretched by 5e-324: offset 1e-323"
        ):
            three_notes().stretch(5e-324)

    def test_a_factor_that_overflows_names_the_note(self):
        with pytest.raises(ScoreError, match=r"Note 1 of 'etude' stretched by 7e\+307: offset inf"):
            three_notes().stretch(7e307)


class TestTrimSilence:
    def test_the_first_note_starts_at_zero(self):
        assert [n.onset for n in three_notes().trim_silence().notes] == [0, 1, 1]

    def test_a_pedal_is_moved_cut_at_zero_or_dropped_if_wholly_before(self):
        pedals = [(0, 0.5), (0.75, 1.5), (2, 3)]
        trimmed = three_notes(pedals=[Pedal(onset=a, offset=b) for a, b in pedals]).trim_silence()
        assert [(p.onset, p.offset) for p in trimmed.pedals] == [(0, 0.5), (1, 2)]

    def test_a_score_without_leading_silence_stays_as_it_is(self):
        once = three_notes().trim_silence()
        assert once.trim_silence() == once


class TestBars:
    def test_a_score_knows_none_unless_told(self):
        assert three_notes().bars == ()

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

    def test_transposing_keeps_them(self):
        assert three_notes(bars=[0, 2]).transpose(3).bars == (0, 2)

    def test_stretching_scales_them(self):
        assert three_notes(bars=[0.5, 2]).stretch(3).bars == (1.5, 6)

    def test_an_excerpt_keeps_those_from_its_start_up_to_but_not_including_its_end(self):
        bars = [0, 1, 1.5, 2, 3, 4]
        assert three_notes(bars=bars).excerpt(1.5, 4).bars == (0, 0.5, 1.5)

    def test_trimming_moves_them_along_and_drops_those_before(self):
        assert three_notes(bars=[0, 1.25, 3]).trim_silence().bars == (0.25, 2)

    def test_survive_replacing_pickling_and_deep_copying(self):
        score = three_notes(bars=[0, 2])
        for copied in (
            dataclasses.replace(score, title="other"),
            pickle.loads(pickle.dumps(score)),
            copy.deepcopy(score),
        ):
            assert copied.bars == (0, 2)


class TestExcerpt:
    def test_keeps_onsets_from_start_up_to_but_not_including_end(self):
        score = Score(notes=[note(0, 1), note(1, 2, 61), note(2, 3, 62), note(3, 4, 63)])
        assert [n.pitch for n in score.excerpt(1, 3).notes] == [61, 62]

    def test_cuts_notes_at_the_end_and_shifts_the_start_to_zero(self):
        cut = three_notes().excerpt(1.5, 3)
        assert [(n.onset, n.offset, n.pitch) for n in cut.notes] == [(0.5, 1.5, 64), (0.5, 1, 67)]

    def test_clips_pedals_on_both_sides(self):
        pedals = [(0, 1.5), (1.75, 2), (2.5, 9), (10, 11)]
        score = three_notes(pedals=[Pedal(onset=a, offset=b) for a, b in pedals])
        cut = score.excerpt(1.0, 3.0).pedals
        assert [(p.onset, p.offset) for p in cut] == [(0, 0.5), (0.75, 1), (1.5, 2)]

    def test_an_infinite_end_means_the_end_of_the_piece(self):
        assert three_notes().excerpt(0, math.inf) == three_notes()

    def test_an_empty_result_names_where_the_onsets_lie(self):
        with pytest.raises(ScoreError, match=r"No note of 'etude' .* between 1.0 s and 2.0 s"):
            three_notes().excerpt(2.5, 3)

    @pytest.mark.parametrize(
        ("start", "end"), [(2, 1), (1, 1), (-1, 1), (math.nan, 1), (0, math.nan), (math.inf, 1)]
    )
    def test_times_out_of_order_are_refused_by_value(self, start, end):
        with pytest.raises(ScoreError, match=f"from {start} s to {end} s: expected 0 <= start"):
            three_notes().excerpt(start, end)

    @settings(max_examples=50, deadline=None)
    @given(cut=st.floats(1.0, 2.0, exclude_min=True))
    def test_every_onset_lands_in_exactly_one_of_two_neighbouring_excerpts(self, cut):
        before, after = three_notes().excerpt(0, cut), three_notes().excerpt(cut, 4)
        assert [n.pitch for n in before.notes + after.notes] == [60, 64, 67]
