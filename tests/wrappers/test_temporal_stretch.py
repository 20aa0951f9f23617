"""Pieces played slower or faster."""

from __future__ import annotations

import math

import numpy as np
import playing_scores
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from playing_scores import melody, piano, played

from sb3_piano.exceptions import ConfigError, ScoreError
from sb3_piano.music import Note, Score
from sb3_piano.wrappers import TemporalStretch

FACTORS = st.floats(0.1, 10.0)


def factors(env, count, *, seed=0):
    random, score = np.random.default_rng(seed), melody(60)
    return [env.change(score, random).duration for _ in range(count)]


def test_two_is_twice_as_slow_and_the_episode_twice_as_long():
    env = TemporalStretch(piano(melody(60, 62)), 2)
    score = played(env)
    assert [(note.onset, note.offset, note.pitch) for note in score.notes] == [
        (0, 2, 60),
        (2, 4, 62),
    ]
    assert len(env.unwrapped.roll) - 1 == 2 * 40


@settings(max_examples=30, deadline=None)
@given(score=playing_scores.scores(), factor=FACTORS)
def test_every_time_is_multiplied_and_nothing_else_changes(score, factor):
    slow = played(TemporalStretch(piano(melody(60)), factor), score=score)
    for after, before in zip(slow.notes, score.notes, strict=True):
        assert (after.onset, after.offset) == (before.onset * factor, before.offset * factor)
        assert (after.pitch, after.velocity, after.finger) == (
            before.pitch,
            before.velocity,
            before.finger,
        )
    assert slow.bars == tuple(line * factor for line in score.bars)
    assert slow.pedals[0].offset == 1.5 * factor


@settings(max_examples=30, deadline=None)
@given(inner=FACTORS, outer=FACTORS)
def test_factors_of_a_stack_multiply(inner, outer):
    env = TemporalStretch(TemporalStretch(piano(melody(60, 62)), inner), outer)
    assert played(env).duration == pytest.approx(2 * inner * outer)


def test_drawn_factors_fill_the_range_evenly_on_a_logarithmic_scale():
    drawn = np.log2(factors(TemporalStretch(piano(), [0.5, 4]), 900))
    assert drawn.min() >= -1
    assert drawn.max() <= 2
    thirds = np.histogram(drawn, bins=3, range=(-1, 2))[0]
    assert all(250 < count < 350 for count in thirds)


def test_a_range_of_one_factor_is_that_factor_however_its_logarithm_is_rounded():
    for factor in np.linspace(0.5, 3, 20).tolist():
        assert set(factors(TemporalStretch(piano(), [factor, factor]), 2)) == {factor}


def test_is_drawn_from_the_generator_of_the_environment():
    env = TemporalStretch(piano(melody(60)), (0.5, 2))
    twin = np.random.default_rng(6)
    expected = [math.exp(twin.uniform(math.log(0.5), math.log(2))) for _ in range(3)]
    drawn = [played(env, seed=6 if i == 0 else None).duration for i in range(3)]
    assert drawn == pytest.approx(expected)
    assert len(set(drawn)) == 3


@pytest.mark.parametrize("factor", [1e-320, [1e-320, 1.0]])
def test_a_note_left_without_length_is_an_error_at_once_for_the_own_piece(factor):
    short = Score(notes=[Note(onset=1.0, offset=1.0000001, pitch=60)], title="short")
    with pytest.raises(ScoreError, match="Note 0 of 'short' stretched by 1e-320"):
        TemporalStretch(piano(short), factor)
    with pytest.raises(ScoreError, match="Note 0 of 'short' stretched by 1e-320"):
        TemporalStretch(piano(), 1e-320).reset(options={"score": short})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("factor", "message"),
    [
        ("2", "factor is '2': expected a finite number"),
        (math.inf, "factor is inf: expected a finite number"),
        (math.nan, "factor is nan: expected a finite number"),
        (True, "factor is True: expected a finite number"),
        (0, "factor is 0: expected a number above 0"),
        (-1.5, "factor is -1.5: expected a number above 0"),
        ([0.5], r"factor is \[0.5\]: expected one number, or a pair"),
        ([0.0, 1.0], r"factor\[0\] is 0.0: expected a number above 0"),
        ([2.0, 0.5], r"factor is \[2.0, 0.5\]: expected the lower end first"),
    ],
)
def test_a_bad_factor_is_refused_by_value(factor, message):
    with pytest.raises(ConfigError, match=message):
        TemporalStretch(piano(), factor)
