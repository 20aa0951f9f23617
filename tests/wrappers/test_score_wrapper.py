"""Score wrappers in stacks: seeds, options, copies, and what they may lead to."""

import contextlib

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from playing_scores import melody, piano, played
from random_scores import FINGERS, scores

from sb3_piano.exceptions import ScoreError
from sb3_piano.music import Note, Score
from sb3_piano.wrappers import Excerpt, OctaveShift, PitchShift, RandomPiece, TemporalStretch
from sb3_piano.wrappers.score_wrapper import ScorePlan, ScoreWrapper, possible_scores


def debug_env():
    id = "RoboPianist-debug-CMajorScaleOneHand-v0"
    return gym.make(id, physics="fast", n_steps_lookahead=0)


def sequence(env, seed, count=6):
    return [played(env, seed=seed if i == 0 else None) for i in range(count)]


def test_fixed_changes_leave_the_generator_alone():
    env = Excerpt(TemporalStretch(OctaveShift(PitchShift(piano(), 1), 1), 0.5), length=2)
    env.reset(seed=3)
    assert env.unwrapped.np_random.random() == np.random.default_rng(3).random()


class TestOrderAndOptions:
    def test_the_outermost_acts_first(self):
        # 2 s of the piece stretched to twice its length, against 2 s of the piece itself.
        outer_stretch = TemporalStretch(Excerpt(piano(), length=2), 2)
        outer_excerpt = Excerpt(TemporalStretch(piano(), 2), length=2)
        assert [len(played(env).notes) for env in (outer_stretch, outer_excerpt)] == [1, 2]
        assert [env.unwrapped.score.duration for env in (outer_stretch, outer_excerpt)] == [4, 4]

    def test_a_transform_given_to_reset_acts_before_the_wrappers(self):
        def last_note(score, random):
            return Score(notes=score.notes[-1:], title=str(random.integers(1000)))

        env = Excerpt(PitchShift(piano(melody(60, 70)), 1), start=1, length=1)
        env.reset(seed=5, options={"transform": last_note})
        assert [note.pitch for note in env.unwrapped.score.notes] == [71]
        assert env.unwrapped.score.title == str(np.random.default_rng(5).integers(1000))


class TestSameObject:
    def test_a_fixed_change_keeps_the_goal_that_the_environment_has_prepared(self):
        for wrapper, value in (
            *((PitchShift, 1), (OctaveShift, 1), (TemporalStretch, 1.5)),
            (lambda env, start: Excerpt(env, start=start, length=2), 1),
            (lambda env, value: PitchShift(TemporalStretch(env, value), -1), 2),
        ):
            env = wrapper(debug_env(), value)
            env.reset()
            roll = env.unwrapped.roll
            env.reset()
            assert env.unwrapped.roll is roll

    def test_a_drawn_value_that_repeats_gives_the_same_object(self):
        env = PitchShift(piano(), [-1, 1])
        assert len({id(score) for score in sequence(env, 0, count=30)}) == 3


def drawn_by(env, random):
    """Return what an episode would play, without preparing it."""
    plan = ScorePlan()
    while isinstance(env, ScoreWrapper):
        plan, env = env.extend(plan, {}), env.env
    return plan(env.default_score, random)


class TestPossibleScores:
    uncertain = st.sampled_from([0.5, 1.0])
    changes = st.tuples(
        st.one_of(
            st.tuples(st.just(PitchShift), st.tuples(st.integers(-60, 0), st.integers(0, 60))),
            st.tuples(st.just(PitchShift), st.tuples(st.integers(20, 30), st.integers(30, 60))),
            st.tuples(st.just(OctaveShift), st.tuples(st.integers(-6, 0), st.integers(0, 6))),
            st.tuples(st.just(TemporalStretch), st.tuples(st.floats(0.5, 1), st.floats(1, 2))),
            st.tuples(st.just(TemporalStretch), st.floats(0.5, 2)),
        ),
        uncertain,
    )

    @pytest.mark.slow
    @given(
        inner=st.lists(changes, max_size=2),
        outer=st.lists(changes, max_size=2),
        start=st.sampled_from([0, "random"]),
        length=st.floats(0.2, 5),
        score=scores(FINGERS),
    )
    def test_whatever_is_drawn_lies_within_their_pitches(self, inner, outer, start, length, score):
        env = RandomPiece(piano(), [score, melody(40, 80, 30)])
        for (wrapper, value), probability in inner:
            env = wrapper(env, value, probability=probability)
        with contextlib.suppress(ScoreError):  # a part at the beginning may be silent
            env = Excerpt(env, start=start, length=length)
        for (wrapper, value), probability in outer:
            with contextlib.suppress(ScoreError):  # which it may also be after a stretch
                env = wrapper(env, value, probability=probability)
        ranges = [possible.pitch_range for possible in possible_scores(env)]
        lowest, highest = min(low for low, _ in ranges), max(high for _, high in ranges)
        random = np.random.default_rng(0)
        for _ in range(20):
            low, high = drawn_by(env, random).pitch_range
            assert lowest <= low <= high <= highest

    def test_a_part_that_a_drawn_stretch_may_leave_silent_is_refused_before_any_episode(self):
        late = Score(notes=[Note(onset=1.0, offset=2.0, pitch=60)])
        part = Excerpt(piano(late), length=1.5)
        assert possible_scores(TemporalStretch(part, (1.0, 1.4)))
        with pytest.raises(ScoreError, match="No note .* is struck from 0.0 s to 1.5 s"):
            TemporalStretch(part, (1.0, 2.0))

    def test_they_are_no_more_than_what_may_be_played(self):
        six = melody(60, 61, 62, 63, 64, 65, length=1.0)
        assert possible_scores(Excerpt(piano(six), start=1, length=1)) == [six.excerpt(1, 2)]
        assert possible_scores(Excerpt(piano(six), start="random", length=1)) == [six]
        inner = Excerpt(TemporalStretch(piano(six), 2, probability=0.5), length=2)
        assert max(score.pitch_range[1] for score in possible_scores(inner)) == 61
        assert six not in possible_scores(PitchShift(piano(six), 3))

    def test_of_a_part_of_what_is_drawn_all_notes_count(self):
        six = melody(60, 61, 62, 63, 64, 65, length=1.0)
        part = PitchShift(Excerpt(piano(six), start=0, length=1), 2)
        for env in (
            TemporalStretch(part, [0.5, 2]),
            TemporalStretch(part, 2, probability=0.5),
            Excerpt(part, start="random", length=2),
        ):
            pitches = {note.pitch for score in possible_scores(env) for note in score.notes}
            assert pitches == {*range(62, 68)}
