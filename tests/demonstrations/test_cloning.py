"""Behaviour cloning: a stock actor does what the recorded player would have done."""

import numpy as np
import pytest
import torch
from linear_players import Linear, pendulum
from sb3_contrib import TQC
from stable_baselines3 import DDPG, PPO, SAC, TD3
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize
from yaml_rows import Tables

from sb3_piano.demonstrations import clone_behaviour, open_dataset, record, recording
from sb3_piano.exceptions import ConfigError

tables = Tables(__file__)

NAME = "test/pendulum-v0"
QUICK = {"epochs": 60, "batch_size": 32, "learning_rate": 3e-3}


@pytest.fixture
def disturbed(monkeypatch):
    """A recorded player whose actions were changed before they were played.

    Pendulum has no noise of ours, so the noise is drawn here.
    """

    class Noisy:
        """Adds noise to what is asked of the environment, unknown to the player."""

        restart = staticmethod(lambda: None)

        def sample(self, random):
            return random.normal(size=1)

    monkeypatch.setattr(recording, "ActuatorNoise", lambda env, std, memory: Noisy())
    env = pendulum()
    return record(Linear(env), env, NAME, episodes=8, noise=[1.0]).dataset


def new_model(algorithm, normalize=False, **options):
    venv = DummyVecEnv([pendulum])
    venv = VecNormalize(venv, norm_reward=False) if normalize else venv
    kwargs = {"policy_kwargs": {"net_arch": [32], **options}, "buffer_size": 10}
    return algorithm("MlpPolicy", venv, seed=0, device="cpu", **kwargs)


def played(model, observations):
    normalizer = model.get_vec_normalize_env()
    inputs = observations if normalizer is None else normalizer.normalize_obs(observations)
    return model.predict(inputs, deterministic=True)[0]


def parameters(module):
    return torch.nn.utils.parameters_to_vector(module.parameters()).detach().clone()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("algorithm", "normalize"), [(SAC, False), (TD3, True), (DDPG, False), (TQC, True)]
)
def test_a_clone_plays_what_was_right_not_what_was_played(disturbed, algorithm, normalize):
    model = new_model(algorithm, normalize)
    critic = parameters(model.critic)
    told = []
    cloning = clone_behaviour(model, NAME, **QUICK, on_epoch=told.append)
    assert not model.policy.training
    assert cloning.n_transitions == 160
    assert cloning.losses == tuple(told)
    assert len(told) == 60
    assert told[-1] < 0.02 * told[0]
    seen = np.concatenate([episode.observations[:-1] for episode in disturbed])
    right = Linear(pendulum()).act(seen)
    errors = np.abs(played(model, seen) - right)
    assert errors.mean() < 0.06  # of actions from -2 to 2
    assert np.abs(np.concatenate([e.actions for e in disturbed]) - right).mean() > 0.4
    # The actions of the loss are from -1 to 1.
    assert np.square(errors / 2).mean() == pytest.approx(told[-1], rel=0.5)
    assert torch.equal(parameters(model.critic), critic)
    if hasattr(model, "actor_target"):
        assert torch.equal(parameters(model.actor_target), parameters(model.actor))


@pytest.mark.parametrize("algorithm", [SAC, TQC])
@pytest.mark.parametrize("log_std", [-3.0, None])
def test_exploring_is_as_narrow_as_was_asked_for(pendulum_data, algorithm, log_std):
    pendulum_data()
    model = new_model(algorithm)
    fresh = parameters(model.actor.log_std)
    clone_behaviour(model, NAME, epochs=2, log_std=log_std)
    observations = model.policy.obs_to_tensor(np.eye(3, dtype=np.float32))[0]
    found = model.actor.get_action_dist_params(observations)[1]
    if log_std is None:
        assert torch.equal(parameters(model.actor.log_std), fresh)
    else:
        assert found.detach().numpy() == pytest.approx(log_std)


def test_normalisation_has_the_statistics_of_the_data_set(piano):
    env = piano()
    dataset = record(Linear(env), env, "t-v0", episodes=3).dataset
    venv = VecNormalize(DummyVecEnv([piano]), norm_reward=False)
    model = TD3("MlpPolicy", venv, buffer_size=9, policy_kwargs={"net_arch": [4]}, device="cpu")
    clone_behaviour(model, "t-v0", epochs=1)
    seen = np.concatenate([episode.observations[:-1] for episode in dataset]).astype(np.float64)
    np.testing.assert_allclose(venv.obs_rms.mean, seen.mean(axis=0), atol=1e-6)
    assert venv.obs_rms.count == len(seen) == 39
    constant = np.ptp(seen, axis=0) == 0
    assert 0 < constant.sum() < 100
    assert (venv.obs_rms.var[constant] == 1).all()
    varied = seen.var(axis=0) > 1e-6
    normalised = venv.normalize_obs(seen)[:, varied]
    np.testing.assert_allclose(normalised.std(axis=0), 1, rtol=0.02)


def test_equal_seeds_clone_the_same_and_touch_no_other_randomness(pendulum_data):
    pendulum_data()
    losses = []
    for seed in (3, 3, 4):
        model = new_model(SAC)
        torch.manual_seed(1)
        losses.append(clone_behaviour(model, NAME, epochs=3, batch_size=16, seed=seed).losses)
        assert torch.equal(torch.rand(1), torch.rand(1, generator=torch.manual_seed(1)))
    assert losses[0] == losses[1] != losses[2]


@tables("options, message")
def test_what_is_out_of_range_is_refused(pendulum_data, options, message):
    pendulum_data()
    with pytest.raises(ConfigError, match=message):
        clone_behaviour(new_model(TD3), NAME, **options)


def test_a_model_that_does_not_fit_is_refused(pendulum_data, piano):
    pendulum_data()
    on_policy = PPO("MlpPolicy", pendulum(), n_steps=8, batch_size=8, device="cpu")
    with pytest.raises(ConfigError, match="A PPO has no actor to clone into: expected SAC"):
        clone_behaviour(on_policy, NAME)
    on_piano = TD3("MlpPolicy", piano(), buffer_size=9, policy_kwargs={"net_arch": [4]})
    with pytest.raises(ConfigError, match=r"shape \(3,\), the model of shape \(130,\)"):
        clone_behaviour(on_piano, NAME)
    assert open_dataset(NAME).total_steps == 60
