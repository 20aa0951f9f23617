"""Pieces shifted along the keyboard, by semitones and by octaves, and stretched."""

import contextlib
from collections import Counter

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from playing_scores import melody, piano, played
from random_scores import FINGERS, scores
from short_scores import score_of
from yaml_rows import Tables

from sb3_piano import wrappers
from sb3_piano.exceptions import ScoreError
from sb3_piano.music import MAX_PITCH, MIN_PITCH, Note, Score
from sb3_piano.wrappers import Excerpt, OctaveShift, PitchShift, RandomPiece, TemporalStretch
from sb3_piano.wrappers.score_wrapper import ScorePlan, ScoreWrapper, possible_scores


def shifts(env, score, count):
    """Return by how much a piece is shifted in several episodes."""
    random = np.random.default_rng(0)
    return [env.change(score, random).notes[0].pitch - score.notes[0].pitch for _ in range(count)]


class TestFixedShift:
    @settings(max_examples=10)
    @given(score=scores(FINGERS), data=st.data(), octaves=st.integers(-3, 4))
    def test_a_shift_and_its_opposite_play_the_piece_itself(self, score, data, octaves):
        low, high = score.pitch_range
        shift = data.draw(st.integers(max(MIN_PITCH - low, -43), min(MAX_PITCH - high, 43)))
        env = PitchShift(piano(melody(64)), shift)
        assert (played(env, score=score) == score) == (shift == 0)
        env = PitchShift(PitchShift(piano(melody(64)), -shift), shift)  # the outer one acts first
        assert played(env, score=score) == score
        assert env.unwrapped.score.bars == score.bars
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


def factors(env, count, *, seed=0):
    random, score = np.random.default_rng(seed), melody(60)
    return [env.change(score, random).duration for _ in range(count)]


@settings(max_examples=10)
@given(score=scores(FINGERS), factor=st.floats(0.1, 10.0))
def test_a_piece_is_stretched_with_its_pedals_and_bars(score, factor):
    slow, expected = (
        played(TemporalStretch(piano(melody(60)), factor), score=score),
        score.stretch(factor),
    )
    assert (slow, slow.bars) == (expected, expected.bars)


def test_factors_of_a_stack_multiply():
    env = TemporalStretch(TemporalStretch(piano(melody(60, 62)), 0.3), 5)
    assert played(env).duration == pytest.approx(2 * 0.3 * 5)


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


# Parts of pieces, in seconds and in bars.


SIX = melody(60, 61, 62, 63, 64, 65, length=1.0)  # bars at 0, 2 and 4 s


def pitches(score):
    return [note.pitch for note in score.notes]


def windows(env, score, count=200):
    """Return how often each part of a piece is played in several episodes, by its pitches."""
    random = np.random.default_rng(0)
    return Counter(
        "".join(chr(p) for p in pitches(env.change(score, random))) for _ in range(count)
    )


def text(*numbers):
    return "".join(map(chr, numbers))


class TestSeconds:
    def test_a_fixed_part_is_that_of_the_score(self):
        for span, arguments in (
            ((0, 4), {}),
            ((1.5, 3.5), {"start": 1.5, "length": 2}),
            ((4, 6), {"start": 4, "length": 10}),  # what is left of the piece
            ((0, 4), {"unit": "bars", "length": 2}),
            ((2, 4), {"unit": "bars", "start": 1, "length": 1}),
            ((4, 6), {"unit": "bars", "start": 2, "length": 2}),
        ):
            assert played(Excerpt(piano(SIX), **arguments)) == SIX.excerpt(*span)

    @pytest.mark.parametrize("start", [0, "random"])
    def test_a_piece_that_is_no_longer_is_played_whole(self, start):
        for length, unit in ((6, "seconds"), (7, "seconds"), (3, "bars"), (4.0, "bars")):
            assert played(Excerpt(piano(SIX), start=start, length=length, unit=unit)) is SIX

    def test_a_random_part_begins_with_a_note_and_lies_within_the_piece(self):
        drawn = windows(Excerpt(piano(), start="random", length=4), SIX, 600)
        assert set(drawn) == {text(60, 61, 62, 63), text(61, 62, 63, 64), text(62, 63, 64, 65)}
        assert all(150 < count < 250 for count in drawn.values())

    @pytest.mark.slow
    @given(score=scores(FINGERS), length=st.floats(0.01, 9.0), seed=st.integers(0, 9))
    def test_a_random_part_always_has_notes_and_is_as_long_as_can_be(self, score, length, seed):
        env = Excerpt(piano(), start="random", length=length)
        random = np.random.default_rng(seed)
        start, end = env.draw(score, random)
        assert played(env, score=score, seed=seed).notes
        if score.duration <= length:
            assert (start, end) == (0, float("inf"))
        else:
            assert end - start == pytest.approx(length, abs=2e-6)
            assert start >= 0
            assert end <= score.duration + 2e-6

    def test_a_rounding_error_neither_loses_a_note_nor_adds_one(self):
        tenths = score_of(*((i / 10, (i + 1) / 10, 60 + i) for i in range(6)))
        assert tenths.notes[3].onset < 0.1 + 0.2  # which would then be struck before the end
        env = Excerpt(piano(tenths), start=0.1, length=0.2)
        assert pitches(played(env)) == [61, 62]
        env = Excerpt(piano(tenths), start=0.1 + 0.2, length=0.2)
        assert pitches(played(env)) == [63, 64]

    def test_a_silent_part_is_an_error_at_once_for_the_own_piece(self):
        message = r"No note of 'melody' is struck from 9.0 s to 10.0 s: its onsets lie"
        with pytest.raises(ScoreError, match=message):
            Excerpt(piano(SIX), start=9, length=1)
        with pytest.raises(ScoreError, match=message):
            Excerpt(piano(melody(*range(60, 72))), start=9, length=1).reset(options={"score": SIX})


class TestBars:
    def test_the_last_bar_lasts_until_the_end_of_the_piece_and_an_upbeat_is_one(self):
        notes = [Note(onset=0, offset=1, pitch=60), Note(onset=2.5, offset=9, pitch=62)]
        score = Score(notes=notes, bars=[0, 2, 4, 6, 8])
        env = Excerpt(piano(score), start=1, length=1, unit="bars")
        assert [(n.onset, n.offset) for n in played(env).notes] == [(0.5, 7)]
        with pytest.raises(ScoreError, match="from bar 2: expected one of its bars, 0 to 1"):
            Excerpt(piano(score), start=2, length=1, unit="bars")
        notes = [Note(onset=t, offset=t + 1, pitch=60 + t) for t in range(5)]
        score = Score(notes=notes, bars=[1, 3])
        for start, expected in enumerate(([60], [61, 62], [63, 64])):
            part = played(Excerpt(piano(score), start=start, length=1, unit="bars"))
            assert pitches(part) == expected

    def test_random_bars_are_equally_likely(self):
        drawn = windows(Excerpt(piano(), start="random", length=2, unit="bars"), SIX, 400)
        assert set(drawn) == {text(60, 61, 62, 63), text(62, 63, 64, 65)}
        assert 150 < drawn[text(60, 61, 62, 63)] < 250

    def test_a_random_part_begins_with_a_bar_in_which_a_note_is_struck(self):
        onsets = {0: 60, 0.5: 61, 6: 62, 10: 63}
        notes = [Note(onset=t, offset=t + 1, pitch=pitch) for t, pitch in onsets.items()]
        score = Score(notes=notes, bars=range(0, 20, 2))
        drawn = windows(Excerpt(piano(), start="random", length=1, unit="bars"), score)
        assert set(drawn) == {text(60, 61), text(62), text(63)}
        # Of the part that would begin with the last note, the first bar is empty.
        drawn = windows(Excerpt(piano(), start="random", length=2, unit="bars"), score)
        assert set(drawn) == {text(60, 61), text(62), text(63)}

    def test_a_piece_without_bars_is_an_error_that_knows_a_way_out(self):
        plain = melody(60, 62, bars=(), title="plain")
        message = r"bars of 'plain' are not known: .* MusicXML file, or an excerpt in seconds"
        for start in (0, "random"):
            with pytest.raises(ScoreError, match=message):
                Excerpt(piano(plain), start=start, unit="bars")
        with pytest.raises(ScoreError, match=message):
            Excerpt(piano(), unit="bars").reset(options={"score": plain})


# Stacks: seeds, options, copies, and what they may lead to.


def debug_env():
    id = "RoboPianist-debug-CMajorScaleOneHand-v0"
    return gym.make(id, physics="fast", n_steps_lookahead=0)


def sequence(env, seed, count=6):
    return [played(env, seed=seed if i == 0 else None) for i in range(count)]


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
    def test_a_fixed_change_keeps_the_goal_and_leaves_the_generator_alone(self):
        for wrap in (
            lambda env: PitchShift(env, 1),
            lambda env: OctaveShift(env, 1),
            lambda env: TemporalStretch(env, 1.5),
            lambda env: Excerpt(env, start=1, length=2),
            lambda env: PitchShift(TemporalStretch(env, 2), -1),
        ):
            env = wrap(debug_env())
            env.reset(seed=3)
            roll = env.unwrapped.roll
            assert env.unwrapped.np_random.random() == np.random.default_rng(3).random()
            env.reset()
            assert env.unwrapped.roll is roll
        # Nor does a drawn value that repeats.
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
