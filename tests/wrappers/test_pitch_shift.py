"""Pieces shifted along the keyboard, by semitones and by octaves."""

from __future__ import annotations

import dataclasses
from collections import Counter

import numpy as np
import playing_scores
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from playing_scores import melody, piano, played

from sb3_piano.exceptions import ConfigError, ScoreError
from sb3_piano.music import MAX_PITCH, MIN_PITCH
from sb3_piano.wrappers import OctaveShift, PitchShift


def shifts(env, score, count):
    """Return by how much a piece is shifted in several episodes."""
    random = np.random.default_rng(0)
    return [env.change(score, random).notes[0].pitch - score.notes[0].pitch for _ in range(count)]


class TestFixedShift:
    def test_all_notes_move_and_nothing_else_changes(self):
        before, after = melody(60, 64), played(PitchShift(piano(melody(60, 64)), 3))
        assert [note.pitch for note in after.notes] == [63, 67]
        assert [dataclasses.replace(note, pitch=note.pitch - 3) for note in after.notes] == list(
            before.notes
        )

    @settings(max_examples=30, deadline=None)
    @given(score=playing_scores.scores(), data=st.data())
    def test_a_shift_and_its_opposite_play_the_piece_itself(self, score, data):
        low, high = score.pitch_range
        shift = data.draw(st.integers(max(MIN_PITCH - low, -43), min(MAX_PITCH - high, 43)))
        env = PitchShift(piano(melody(64)), shift)
        assert (played(env, score=score) == score) == (shift == 0)
        env = PitchShift(PitchShift(piano(melody(64)), -shift), shift)  # the outer one acts first
        assert played(env, score=score) == score
        assert env.unwrapped.score.bars == score.bars

    @settings(max_examples=20, deadline=None)
    @given(octaves=st.integers(-3, 4))
    def test_an_octave_is_twelve_semitones(self, octaves):
        by_octaves = played(OctaveShift(piano(melody(60)), octaves))
        assert by_octaves == played(PitchShift(piano(melody(60)), 12 * octaves))
        assert by_octaves.notes[0].pitch == 60 + 12 * octaves

    @pytest.mark.parametrize("wrapper", [PitchShift, OctaveShift])
    def test_off_the_keyboard_is_an_error_at_once_for_the_own_piece(self, wrapper):
        steps = {PitchShift: 48, OctaveShift: 4}[wrapper]
        message = r"Transposing 'melody' by 48 semitones takes 1 of its 2 notes .* first note 1"
        with pytest.raises(ScoreError, match=message):
            wrapper(piano(melody(60, 61)), steps)
        assert wrapper(piano(melody(60)), steps)

    def test_off_the_keyboard_is_an_error_at_reset_for_another_piece(self):
        env = PitchShift(piano(), -5)
        with pytest.raises(ScoreError, match=r"by -5 semitones .*pitch 25 to 20"):
            env.reset(options={"score": melody(25)})
        assert played(env, score=melody(26)).notes[0].pitch == 21

    def test_takes_nothing_from_the_random_generator(self):
        env = PitchShift(piano(), 3)
        env.reset(seed=8)
        assert env.unwrapped.np_random.random() == np.random.default_rng(8).random()


class TestDrawnShift:
    def test_every_shift_of_the_range_is_equally_likely(self):
        drawn = Counter(shifts(PitchShift(piano(), [-2, 2]), melody(60), 1000))
        assert sorted(drawn) == [-2, -1, 0, 1, 2]
        assert all(150 < count < 250 for count in drawn.values())

    def test_octaves_of_the_range_are_equally_likely(self):
        drawn = Counter(shifts(OctaveShift(piano(), (-1, 1)), melody(60), 900))
        assert sorted(drawn) == [-12, 0, 12]
        assert all(250 < count < 350 for count in drawn.values())

    def test_only_shifts_that_fit_the_piece_are_drawn(self):
        env = PitchShift(piano(), [-7, 7])
        assert set(shifts(env, melody(60, 106), 100)) == {*range(-7, 3)}
        assert set(shifts(env, melody(25, 60), 100)) == {*range(-4, 8)}
        assert set(shifts(env, melody(22, 107), 100)) == {-1, 0, 1}

    def test_only_whole_octaves_that_fit_the_piece_are_drawn(self):
        env = OctaveShift(piano(), [-3, 3])
        assert set(shifts(env, melody(60, 96), 100)) == {-36, -24, -12, 0, 12}
        assert set(shifts(env, melody(60, 97), 100)) == {-36, -24, -12, 0}
        assert set(shifts(env, melody(33, 60), 100)) == {-12, 0, 12, 24, 36}
        assert set(shifts(env, melody(32, 60), 100)) == {0, 12, 24, 36}

    @pytest.mark.parametrize(
        ("wrapper", "steps", "score", "shift"),
        [
            (PitchShift, [5, 7], melody(60, 106), 2),
            (PitchShift, [-9, -7], melody(25, 60), -4),
            (OctaveShift, [2, 3], melody(60, 90), 12),
            (OctaveShift, [1, 2], melody(60, 100), 0),
            (OctaveShift, [-3, -2], melody(40, 60), -12),
            (PitchShift, [50, 50], melody(60), 48),
        ],
    )
    def test_where_none_fits_the_nearest_that_does_is_played(self, wrapper, steps, score, shift):
        assert set(shifts(wrapper(piano(), steps), score, 10)) == {shift}
        assert set(shifts(wrapper(piano(score), steps), score, 10)) == {shift}

    def test_is_drawn_from_the_generator_of_the_environment(self):
        env = PitchShift(piano(melody(60)), [-9, 9])
        twin = np.random.default_rng(4)
        for episode in range(5):
            score = played(env, seed=4 if episode == 0 else None)
            assert score.notes[0].pitch == 60 + twin.integers(-9, 10)
        assert env.unwrapped.np_random.random() == twin.random()


@pytest.mark.parametrize("wrapper", [PitchShift, OctaveShift])
@pytest.mark.parametrize(
    ("steps", "message"),
    [
        ("3", "is '3': expected a whole number"),
        (1.0, "is 1.0: expected a whole number"),
        (True, "is True: expected a whole number"),
        (None, "is None: expected a whole number"),
        ([1], r"is \[1\]: expected one number, or a pair of the lowest and the highest"),
        ([1, 2, 3], r"is \[1, 2, 3\]: expected one number, or a pair"),
        ([2, 1], r"is \[2, 1\]: expected the lower end first"),
        ([0, "1"], r"\[1\] is '1': expected a whole number"),
        ([0.5, 1], r"\[0\] is 0.5: expected a whole number"),
    ],
)
def test_a_bad_shift_is_refused_by_name_and_value(wrapper, steps, message):
    name = {PitchShift: "semitones", OctaveShift: "octaves"}[wrapper]
    with pytest.raises(ConfigError, match=name + r"\s?" + message):
        wrapper(piano(), steps)
