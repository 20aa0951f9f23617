"""Pieces shifted along the keyboard, by semitones and by octaves, and stretched."""

from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from playing_scores import melody, piano, played
from random_scores import FINGERS, scores
from yaml_rows import Tables

from sb3_piano import wrappers
from sb3_piano.exceptions import ScoreError
from sb3_piano.music import MAX_PITCH, MIN_PITCH, Note, Score
from sb3_piano.wrappers import OctaveShift, PitchShift, TemporalStretch


def shifts(env, score, count):
    """Return by how much a piece is shifted in several episodes."""
    random = np.random.default_rng(0)
    return [env.change(score, random).notes[0].pitch - score.notes[0].pitch for _ in range(count)]


class TestFixedShift:
    @given(score=scores(FINGERS), data=st.data())
    def test_a_shift_and_its_opposite_play_the_piece_itself(self, score, data):
        low, high = score.pitch_range
        shift = data.draw(st.integers(max(MIN_PITCH - low, -43), min(MAX_PITCH - high, 43)))
        env = PitchShift(piano(melody(64)), shift)
        assert (played(env, score=score) == score) == (shift == 0)
        env = PitchShift(PitchShift(piano(melody(64)), -shift), shift)  # the outer one acts first
        assert played(env, score=score) == score
        assert env.unwrapped.score.bars == score.bars

    @given(octaves=st.integers(-3, 4))
    def test_an_octave_is_twelve_semitones(self, octaves):
        by_octaves = played(OctaveShift(piano(melody(60)), octaves))
        assert by_octaves == played(PitchShift(piano(melody(60)), 12 * octaves))
        assert by_octaves.notes[0].pitch == 60 + 12 * octaves

    @pytest.mark.parametrize(("wrapper", "steps"), [(PitchShift, 48), (OctaveShift, 4)])
    def test_off_the_keyboard_is_an_error_at_once_or_at_reset(self, wrapper, steps):
        message = r"Transposing 'melody' by 48 semitones takes 1 of its 2 notes .* first note 1"
        with pytest.raises(ScoreError, match=message):
            wrapper(piano(melody(60, 61)), steps)
        env = wrapper(piano(melody(60)), steps)
        with pytest.raises(ScoreError, match=message):
            env.reset(options={"score": melody(60, 61)})


class TestDrawnShift:
    def test_every_shift_of_the_range_is_equally_likely(self):
        drawn = Counter(shifts(PitchShift(piano(), [-2, 2]), melody(60), 1000))
        assert sorted(drawn) == [-2, -1, 0, 1, 2]
        assert all(150 < count < 250 for count in drawn.values())

    @Tables(__file__)("wrapper, steps, pitches, drawn")
    def test_only_shifts_that_fit_the_piece_are_drawn(self, wrapper, steps, pitches, drawn):
        kind, score = getattr(wrappers, wrapper), melody(*pitches)
        for env in (piano(), piano(score)):
            assert set(shifts(kind(env, steps), score, 100)) == {*drawn}


FACTORS = st.floats(0.1, 10.0)


def factors(env, count, *, seed=0):
    random, score = np.random.default_rng(seed), melody(60)
    return [env.change(score, random).duration for _ in range(count)]


@given(score=scores(FINGERS), factor=FACTORS)
def test_a_piece_is_stretched_with_its_pedals_and_bars(score, factor):
    slow, expected = (
        played(TemporalStretch(piano(melody(60)), factor), score=score),
        score.stretch(factor),
    )
    assert (slow, slow.bars) == (expected, expected.bars)


@given(inner=FACTORS, outer=FACTORS)
def test_factors_of_a_stack_multiply(inner, outer):
    env = TemporalStretch(TemporalStretch(piano(melody(60, 62)), inner), outer)
    assert played(env).duration == pytest.approx(2 * inner * outer)


@pytest.mark.parametrize(
    ("options", "high", "position"), [({}, 4, np.log2), ({"scale": "linear"}, 2, np.asarray)]
)
def test_drawn_factors_fill_the_range_evenly_on_their_scale(options, high, position):
    drawn = position(factors(TemporalStretch(piano(), [0.5, high], **options), 900))
    thirds = np.histogram(drawn, bins=3, range=position([0.5, high]))[0]
    assert sum(thirds) == 900
    assert all(250 < count < 350 for count in thirds)


@pytest.mark.parametrize("factor", [1e-320, [1e-320, 1.0]])
def test_a_note_left_without_length_is_an_error_at_once_for_the_own_piece(factor):
    short = Score(notes=[Note(onset=1.0, offset=1.0000001, pitch=60)], title="short")
    with pytest.raises(ScoreError, match="Note 0 of 'short' stretched by 1e-320"):
        TemporalStretch(piano(short), factor)
    with pytest.raises(ScoreError, match="Note 0 of 'short' stretched by 1e-320"):
        TemporalStretch(piano(), 1e-320).reset(options={"score": short})


@pytest.mark.parametrize(
    ("wrapper", "value"),
    [(PitchShift, 3), (PitchShift, [2, 5]), (OctaveShift, 1), (TemporalStretch, 1.5)],
)
class TestProbability:
    @pytest.mark.parametrize(
        ("probability", "least", "most"), [(0.3, 250, 350), (0, 0, 0), (1, 1000, 1000)]
    )
    def test_so_many_episodes_play_the_changed_piece(
        self, wrapper, value, probability, least, most
    ):
        env, random = wrapper(piano(), value, probability=probability), np.random.default_rng(0)
        score = melody(60)
        changed = sum(env.change(score, random) is not score for _ in range(1000))
        assert least <= changed <= most

    def test_certainty_draws_no_number(self, wrapper, value):
        plain, certain = wrapper(piano(), value), wrapper(piano(), value, probability=1.0)
        assert [played(plain, seed=3) for _ in range(2)] == [
            played(certain, seed=3) for _ in range(2)
        ]
