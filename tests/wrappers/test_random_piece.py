"""Pieces chosen at random."""

from collections import Counter

import numpy as np
import pytest
from playing_scores import melody, piano, played, titles
from stable_baselines3.common.vec_env import DummyVecEnv

from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError, ScoreError
from sb3_piano.music import Note, Score, find_piece, write_midi
from sb3_piano.music.difficulty import features
from sb3_piano.vec_env import ProcessVecEnv, ThreadVecEnv
from sb3_piano.wrappers import Excerpt, PitchShift, RandomPiece, TemporalStretch
from sb3_piano.wrappers.score_wrapper import possible_scores

A, B, C = (melody(pitch, title=title) for pitch, title in ((60, "a"), (62, "b"), (64, "c")))


def frequencies(env, count):
    random = np.random.default_rng(0)
    return Counter(env.choose(random).title for _ in range(count))


class TestChoice:
    @pytest.mark.parametrize(
        ("weights", "shares"),
        [(None, [1 / 3, 1 / 3, 1 / 3])]
        + [([0.6 * scale, 0, 0.2 * scale], [3 / 4, 0, 1 / 4]) for scale in (1, 0.1, 1e308)],
    )
    def test_pieces_are_as_frequent_as_their_weights(self, weights, shares):
        drawn = frequencies(RandomPiece(piano(), [A, B, C], weights), 900)
        assert [drawn["abc"[n]] for n in range(3)] == pytest.approx(np.dot(900, shares), abs=50)

    def test_pieces_are_whatever_can_be_played_and_patterns_of_names(self, tmp_path):
        write_midi(melody(60, 64), tmp_path / "own.mid")
        env = RandomPiece(piano(), [A, "scale-[CD]Major", tmp_path / "own.mid"])
        (tmp_path / "own.mid").unlink()  # read when the wrapper was made
        assert {*titles(env, 30)} == {"a", "scale-CMajor", "scale-DMajor", "own"}

    def test_studies_are_as_the_environment_was_told(self):
        env = PianoEnv("hanon-01", physics="fast", tempo=120, octaves=1)
        wrapped = RandomPiece(env, ["hanon-02"])
        expected = find_piece("hanon-02").score(tempo=120, octaves=1)
        assert played(wrapped).duration == expected.duration
        assert wrapped.piece_features(0) == features(expected)

    def test_of_many_pieces_each_is_read_when_it_is_first_chosen(self, tmp_path):
        paths = [tmp_path / f"{index:03}.mid" for index in range(101)]
        for path in paths:
            path.write_bytes(b"")  # nothing that could be read
        env = RandomPiece(piano(), paths, [0, 1, *[0] * 99])
        write_midi(melody(60, 64), paths[1])
        first = played(env)
        assert first.title == "001"
        paths[1].unlink()
        assert played(env) is first
        with pytest.raises(ScoreError, match="000.mid"):
            RandomPiece(piano(), paths[:100])


class TestPlaceInTheStack:
    @pytest.mark.parametrize(
        "stack",
        [
            lambda env: PitchShift(RandomPiece(env, [A, B]), 7),
            lambda env: RandomPiece(PitchShift(env, 7), [A, B]),
            lambda env: PitchShift(RandomPiece(PitchShift(env, 3), [A, B]), 4),
            lambda env: TemporalStretch(RandomPiece(PitchShift(env, 7), [A, B]), 1),
        ],
    )
    def test_the_chosen_piece_is_shifted_wherever_the_shift_stands(self, stack):
        env = stack(piano())
        seen = {(score.title, score.notes[0].pitch) for score in (played(env) for _ in range(20))}
        assert seen == {("a", 67), ("b", 69)}

    def test_of_two_the_outermost_chooses_and_the_other_one_draws_nothing(self):
        inner = RandomPiece(piano(), [A, B])
        assert played(RandomPiece(PitchShift(inner, 1), [C]), seed=3).notes[0].pitch == 65
        twin = np.random.default_rng(3)
        twin.choice(1, p=[1.0])
        assert inner.unwrapped.np_random.random() == twin.random()

    def test_only_pieces_with_a_chance_count_as_possible(self):
        env = PitchShift(RandomPiece(piano(), [A, B, C], [1, 0, 1]), 1)
        assert [(s.title, s.notes[0].pitch) for s in possible_scores(env)] == [("a", 61), ("c", 65)]
        assert [s.title for s in possible_scores(RandomPiece(env, [B]))] == ["b"]

    def test_a_piece_that_a_wrapper_inside_cannot_change_is_refused_at_once(self):
        with pytest.raises(ScoreError, match="Transposing 'high' by 5 semitones"):
            RandomPiece(PitchShift(piano(), 5), [A, melody(104, title="high")])
        plain = melody(60, title="plain", bars=())
        with pytest.raises(ScoreError, match="The bars of 'plain' are not known"):
            RandomPiece(Excerpt(piano(), length=1, unit="bars"), [A, plain])


def new_choice():
    """Return a choice of three pieces; a function that a process can be given."""
    return RandomPiece(PianoEnv(A, physics="fast", n_steps_lookahead=0), [A, B, C])


class TestForCurricula:
    def test_each_piece_has_a_name_of_its_own(self, tmp_path):
        write_midi(melody(60), tmp_path / "own.mid")
        twins = [A, melody(70, title="a"), melody(71, title="a (2)"), melody(72, title="a")]
        env = RandomPiece(piano(), [*twins, "TwinkleTwinkle", tmp_path / "own.mid"])
        assert env.piece_names == [
            "a",
            "a (2)",
            "a (2) (2)",
            "a (3)",
            find_piece("TwinkleTwinkle").name,
            str(tmp_path / "own.mid"),
        ]

    def test_the_index_is_that_of_the_piece_in_the_names(self):
        env = RandomPiece(piano(), [A, B, C], [1, 0, 1])
        assert env.piece_names == ["a", "c"]
        assert env.piece_index is None
        seen = set()
        for _ in range(12):
            title = played(env).title
            assert env.piece_names[env.piece_index] == title
            seen.add(title)
        assert seen == {"a", "c"}

    def test_there_is_no_index_where_the_piece_is_not_chosen_here(self):
        inner = RandomPiece(piano(), [A, B])
        played(inner)
        assert inner.piece_index is not None
        played(inner, score=C)
        assert inner.piece_index is None
        outer = RandomPiece(inner, [B, C])
        played(outer)
        assert (inner.piece_index, outer.piece_index is None) == (None, False)
        assert PitchShift(outer, 1).get_wrapper_attr("piece_names") == ["b", "c"]

    def test_new_weights_count_from_the_next_episode_on(self):
        env = RandomPiece(piano(), [A, B, C])
        env.reset(seed=0)
        env.set_piece_weights([0, 3, 1])
        twin = np.random.default_rng(5)
        expected = ["abc"[twin.choice(3, p=[0, 3 / 4, 1 / 4])] for _ in range(20)]
        assert titles(env, 20, seed=5) == expected
        assert set(expected) == {"b", "c"}

    def test_a_piece_without_a_chance_at_first_never_gets_one(self):
        env = RandomPiece(piano(), [A, B, C], [1, 0, 1])
        env.set_piece_weights([0, 1])
        assert {*titles(env, 10)} == {"c"}
        assert [score.title for score in env.sources] == ["a", "c"]  # KeyRange counts on both
        with pytest.raises(ConfigError, match="weights is .*: expected a list of 2, one for each"):
            env.set_piece_weights([1, 1, 1])

    def test_the_features_are_those_of_what_is_played(self):
        chord = [
            Note(onset=0.0, offset=1.0, pitch=p, hand=h) for p, h in ((60, "left"), (76, "right"))
        ]
        two_hands = Score(notes=chord, title="two hands")
        env = RandomPiece(piano(), [A, "OdeToJoy", two_hands], [0, 1, 1])
        assert env.piece_features(0) == features(find_piece("OdeToJoy").score())
        assert env.piece_features(1).maximum_polyphony == 2
        right = PianoEnv(two_hands, physics="fast", hands="right")
        env = RandomPiece(right, [two_hands, "OdeToJoy"])
        assert env.piece_features(0).maximum_polyphony == 1
        assert env.piece_features(1).notes < find_piece("OdeToJoy").score().notes.__len__()

    @pytest.mark.parametrize(
        "vector", [DummyVecEnv, ThreadVecEnv, pytest.param(ProcessVecEnv, marks=pytest.mark.slow)]
    )
    def test_a_vector_of_environments_passes_all_of_it_on(self, vector):
        venv = vector([new_choice, new_choice])
        venv.seed(0)
        venv.env_method("set_piece_weights", [0.0, 0.0, 1.0], indices=1)
        venv.reset()
        assert venv.get_attr("piece_names") == [["a", "b", "c"]] * 2
        assert venv.get_attr("piece_index", 1) == [2]
        assert [f.notes for f in venv.env_method("piece_features", 0)] == [1, 1]
        venv.close()
