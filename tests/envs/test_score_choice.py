"""What is played in an episode: the environment's own score, a given one, or a transformed one."""

import numpy as np
import pytest

from sb3_piano.batch import PianoVectorEnv
from sb3_piano.envs import PianoEnv
from sb3_piano.envs.score_choice import chosen_score
from sb3_piano.exceptions import ConfigError, ScoreError, UnknownPieceError
from sb3_piano.music import Note, Score

OWN = Score(notes=[Note(onset=0.0, offset=0.1, pitch=60)], title="own")
OTHER = Score(notes=[Note(onset=0.0, offset=0.2, pitch=70)], title="other")


def up_by_chance(score, random):
    return score.transpose(int(random.integers(1, 10)))


def pitches(env):
    return [note.pitch for note in env.score.notes]


def test_a_transform_gets_the_score_that_would_be_played():
    seen = []

    def transform(score, random):
        seen.append(score)
        return score.transpose(2)

    random = np.random.default_rng(0)
    assert chosen_score({"transform": transform}, OWN, random).pitch_range == (62, 62)
    options = {"transform": transform, "score": OTHER}
    assert chosen_score(options, OWN, random).pitch_range == (72, 72)
    assert seen == [OWN, OTHER]


def test_a_transform_draws_from_the_generator_that_the_seed_of_the_environment_sets():
    env = PianoEnv(OWN, n_steps_lookahead=0)
    drawn = []
    for _ in range(2):
        env.reset(seed=3, options={"transform": up_by_chance})
        drawn.append(pitches(env))
        env.reset(options={"transform": up_by_chance})
        drawn.append(pitches(env))
    expected = np.random.default_rng(3)
    first, second = (60 + int(expected.integers(1, 10)) for _ in range(2))
    assert drawn == [[first], [second]] * 2
    env.reset()
    assert pitches(env) == [60]  # it was for single episodes


def test_the_slots_of_a_vector_transform_their_scores_each_with_its_own_generator():
    envs = PianoVectorEnv(3, OWN, n_steps_lookahead=0, n_threads=1)
    envs.reset(seed=5, options={"transform": up_by_chance})
    expected = [60 + int(np.random.default_rng(5 + slot).integers(1, 10)) for slot in range(3)]
    assert [pitches(env) for env in envs.envs] == [[pitch] for pitch in expected]
    envs.close()


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"tempo": 2}, ConfigError, "Unknown reset option 'tempo'. Expected one of score, tr"),
        ({"transform": lambda score, random: None}, ConfigError, "'transform' made a NoneType of"),
        ({"transform": 3}, ConfigError, "'transform' is 3, which ends with TypeError"),
        ({"transform": lambda score: score}, ConfigError, "takes 1 positional argument but 2"),
        ({"transform": lambda score, random: 1 / 0}, ConfigError, "ZeroDivisionError"),
        (["score"], ConfigError, r"The options of reset are \['score'\]"),
        ({3: "score"}, ConfigError, "Unknown reset option 3"),
        ({"score": {"title": "x"}}, ScoreError, "cannot be made of these fields"),
        ({"score": "Nocturn"}, UnknownPieceError, "Unknown piece 'Nocturn'"),
    ],
)
def test_bad_options_are_refused(options, error, message):
    with pytest.raises(error, match=message):
        chosen_score(options, OWN, np.random.default_rng(0))
