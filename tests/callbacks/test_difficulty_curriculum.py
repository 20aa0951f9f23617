"""Easy pieces first, in real trainings."""

import numpy as np
import pytest
from acting import ActAt
from scripted import log_lines, on_pieces, series, tiny, tiny_ppo
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import DummyVecEnv

from sb3_piano.callbacks import DifficultyCallback
from sb3_piano.exceptions import ConfigError
from sb3_piano.music import Note, Score, load_score
from sb3_piano.music.difficulty import features, rank
from sb3_piano.vec_env import ProcessVecEnv, ThreadVecEnv


def piece(n_keys):
    """Return a piece of some chords, the harder the more keys they have."""
    pitches = [60 + 2 * key for key in range(n_keys)]
    notes = [Note(onset=0.1 * i, offset=0.1 * i + 0.1, pitch=p) for i in (0, 1) for p in pitches]
    return Score(notes=notes, title=f"{n_keys} keys")


FIVE = [piece(n_keys) for n_keys in (3, 1, 5, 2, 4)]
"""Pieces of equal length, not in the order of their difficulty."""


class Drawn(BaseCallback):
    """Keep the pieces that environments draw: the band in which they do, and the number of keys."""

    def __init__(self):
        super().__init__()
        self.found = {}
        self.band = 1

    def _on_step(self):
        for env in np.flatnonzero(self.locals["dones"]).tolist():
            (score,) = self.training_env.get_attr("score", env)
            # drawn in this step, by the weights of the one before
            self.found.setdefault((env, self.band), set()).add(int(score.title[0]))
        self.band = self.logger.name_to_value["curriculum/band"]
        return True


def drawn(venv, steps, **settings):
    """Return which pieces each environment draws in each band."""
    curriculum = DifficultyCallback(**settings)
    seen = Drawn()
    tiny(venv).learn(steps, callback=[curriculum, seen])
    venv.close()
    return seen.found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("vector", "settings", "second"),
    [(DummyVecEnv, {}, {1, 2, 3, 4, 5}), (ThreadVecEnv, {"cumulative": False}, {4, 5})],
)
def test_one_band_comes_after_the_other_and_then_all_are_equally_likely(vector, settings, second):
    found = drawn(on_pieces(FIVE, vector=vector), 400, bands=2, fraction=0.5, **settings)
    assert found == {(0, 1): {1, 2, 3}, (0, 2): second, (0, 3): {1, 2, 3, 4, 5}}


@pytest.mark.slow
def test_an_environment_without_a_piece_of_the_band_plays_its_nearest():
    easy, hard = [FIVE[1], FIVE[3]], [FIVE[0], FIVE[2], FIVE[4]]
    found = drawn(on_pieces(easy, hard), 2 * 300, bands=5, fraction=0.5)
    assert found[0, 1] == {1}
    assert found[0, 2] == found[0, 5] == {1, 2}
    assert found[1, 1] == found[1, 2] == found[1, 3] == {3}
    assert found[1, 4] == {3, 4}
    found = drawn(on_pieces(easy, hard), 2 * 300, bands=5, fraction=0.5, cumulative=False)
    assert [found[0, band] for band in range(1, 7)] == [{1}, {2}, {2}, {2}, {2}, {1, 2}]
    assert [found[1, band] for band in range(1, 7)] == [{3}, {3}, {3}, {4}, {5}, {3, 4, 5}]


@pytest.mark.slow
def test_environments_in_processes():
    found = drawn(on_pieces(FIVE, FIVE, vector=ProcessVecEnv), 2 * 200, bands=2, fraction=1.0)
    assert found[0, 1] <= {1, 2, 3}
    assert found[1, 1] <= {1, 2, 3}
    assert found[0, 2] & found[1, 2] & {4, 5}


def test_the_band_is_logged_by_the_step_and_goes_on_with_a_training(tmp_path):
    def bands(model, steps, **options):
        curriculum = DifficultyCallback(bands=4, fraction=0.8)
        found = series(
            log_lines(tmp_path, model, steps, curriculum, log_interval=1, **options),
            "curriculum/band",
        )
        # of 80 steps a band has 20: the 20th begins the second
        assert all(band == min(step // 20, 4) + 1 for step, band in found.items())
        return found

    assert set(bands(tiny(on_pieces(FIVE)), 100).values()) == {1, 2, 3, 4, 5}
    model = tiny(on_pieces(FIVE))
    model.learn(50, callback=DifficultyCallback(bands=4, fraction=0.8))
    assert min(bands(model, 50, reset_num_timesteps=False)) > 50  # of 100 steps in all


def test_a_second_training_sets_the_weights_of_its_own_environments_whatever_the_algorithm():
    curriculum = DifficultyCallback(bands=5)
    for make in (tiny, tiny, lambda venv: tiny_ppo(venv, 50, n_epochs=10, seed=3)):
        venv = on_pieces(FIVE)
        make(venv).learn(100, callback=[curriculum, ActAt(1, "stop")])
        assert venv.envs[0]._probabilities.tolist() == [0, 1, 0, 0, 0]


def test_the_bands_are_those_of_the_ranks_of_the_command():
    names = ["debug-TwinkleTwinkleLittleStar", "scale-CMajor", "repertoire-OdeToJoy", "hanon-01"]
    model, curriculum = tiny(on_pieces(names)), DifficultyCallback(bands=3)
    model.learn(1, callback=curriculum)
    expected = list(rank({name: features(load_score(name)) for name in names}))
    assert list(curriculum.bands.items()) == list(zip(expected, (1, 1, 2, 3), strict=True))
    message = "bands is 5, but the environments choose among 4 pieces: expected at most as many"
    with pytest.raises(ConfigError, match=message):
        model.learn(1, callback=DifficultyCallback(bands=5))
