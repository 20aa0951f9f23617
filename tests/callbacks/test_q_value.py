"""The Q-value in the log."""

import numpy as np
import pytest
import torch
from acting import Noted
from sb3_contrib import TQC, CrossQ
from scripted import tiny, weights_of
from stable_baselines3 import SAC, TD3
from stable_baselines3.common.env_util import make_vec_env

from sb3_piano.buffers import CyclingReplayBuffer
from sb3_piano.callbacks import QValueCallback


def last_logged():
    return Noted(lambda own: own.logger.name_to_value.get("train/q_value"))


def trained(algorithm, callbacks, steps=45, env="Pendulum-v1", **settings):
    settings = {"learning_starts": 20, "batch_size": 32, "seed": 3, **settings}
    model = tiny(env, algorithm, buffer_size=10**4, **settings)
    return model.learn(steps, callback=callbacks, log_interval=10**6)


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", [SAC, TD3, TQC, CrossQ])
def test_the_value_is_logged_and_the_training_is_the_same(algorithm):
    noted = last_logged()
    model = trained(algorithm, [QValueCallback(every=10), noted])
    assert len(set(noted.seen)) == 2  # after 30 and 40 steps; after 10 and 20 nothing is learnt
    assert np.isfinite(noted.seen).all()
    plain = trained(algorithm, None)
    torch.testing.assert_close(weights_of(model), weights_of(plain), rtol=0, atol=0)


def test_a_model_that_is_loaded_goes_on_as_without_it(tmp_path):
    venv = make_vec_env("Pendulum-v1", n_envs=2, seed=0)
    model = trained(SAC, None, 60, venv, replay_buffer_class=CyclingReplayBuffer)
    model.save(tmp_path / "model")

    def weights(callbacks):
        loaded = SAC.load(tmp_path / "model", env=venv)
        # As of a run that is resumed: no batch was drawn from this buffer yet.
        rows = {name: value for name, value in vars(model.replay_buffer).items() if name != "_turn"}
        vars(loaded.replay_buffer).update(rows)
        loaded.set_random_seed(5)
        loaded.learn(20, callback=callbacks, reset_num_timesteps=False)
        return weights_of(loaded)

    torch.testing.assert_close(weights([QValueCallback(every=1)]), weights(None), rtol=0, atol=0)


def test_the_value_is_that_of_the_smaller_critic_at_the_actions_taken():
    noted = last_logged()
    model = trained(SAC, [QValueCallback(every=1), noted], steps=25)
    for critic, value in zip(model.critic.q_networks, (5.0, -7.0), strict=True):
        torch.nn.init.zeros_(critic[-1].weight)
        torch.nn.init.constant_(critic[-1].bias, value)
    model.learning_rate, model.lr_schedule = 0.0, lambda _: 0.0
    noted.seen.clear()
    model.learn(2, callback=[QValueCallback(every=1), noted], reset_num_timesteps=False)
    assert noted.seen[0] == pytest.approx(-7.0)
