"""Search spaces are tried out where their settings enter, before anything is trained."""

from __future__ import annotations

import copy

import gymnasium as gym
import pytest

from sb3_piano.exceptions import ConfigError
from sb3_piano.tuning.search_space.parsing import Choice, Float, Int
from sb3_piano.tuning.search_space.space import Space

ENV_ID = "RoboPianist-debug-TwinkleTwinkleLittleStar-v0"
STRETCH = "sb3_piano.wrappers.TemporalStretch"
ENTRY = {"n_timesteps": 100, "policy": "MlpPolicy"}


def check(parameters, entry=None, algo="td3", env_id=ENV_ID):
    entry = {**ENTRY, "env_kwargs": {"n_steps_lookahead": 1}, **(entry or {})}
    before = copy.deepcopy(entry)
    try:
        Space(parameters).check(algo, env_id, entry)
    finally:
        assert entry == before


REWARDS = "env_kwargs.reward_weights"
DECAY = "env_wrapper.FingeringDecay"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"gama": Float(0, 1)}, "'gama': Unknown key 'gama' for TD3. Did you mean 'gamma'?"),
        ({"tau": Float(0, 1), "ent_coef": Float(0, 1)}, "'ent_coef': Unknown key 'ent_coef'"),
        ({"gamma": Float(0.5, 1.5)}, "'gamma' = 1.5: gamma is 1.5: expected 0 to 1."),
        ({"tau": Float(-0.5, 1)}, "'tau' = -0.5: tau is -0.5: expected 0 to 1."),
        ({"learning_rate": Float(0, 1)}, "'learning_rate' = 0.0: .* expected more than 0."),
        (
            {"learning_rate": Choice(["lin_0.1", "lin_0"])},
            "'learning_rate' = 'lin_0': learning_rate is 'lin_0': expected more than 0.",
        ),
        ({"batch_size": Int(0, 9)}, "'batch_size' = 0: batch_size is 0: expected 1 or more."),
        ({"batch_size": Float(1, 9.5)}, "'batch_size' = 9.5: .* expected a whole number."),
        ({"buffer_size": Int(0, 9)}, "'buffer_size' = 0: .* expected 1 or more."),
        ({"gradient_steps": Int(-1, 0)}, "'gradient_steps' = 0: .* 1 or more, or -1"),
        ({"train_freq": Int(0, 4)}, "'train_freq' = 0: .* expected 1 or more."),
        ({"learning_starts": Int(-1, 4)}, "'learning_starts' = -1: .* expected 0 or more."),
        ({"policy_kwargs.dropout": Float(0, 1)}, "'policy_kwargs.dropout': Unknown key 'dropout'"),
        ({"policy_kwargs.net_arch": Choice([[8], [-8]])}, r"'policy_kwargs.net_arch' = \[-8\]: "),
        ({"policy": Choice(["MlpPolicy", "MlPolicy"])}, "'policy' = 'MlPolicy': Unknown policy"),
        ({"noise_std": Float(0.1, 0.2)}, "'noise_std' = 0.1: noise_type is None and noise_std 0.1"),
        ({"n_envs": Int(0, 2)}, "'n_envs' = 0: n_envs is 0: expected 1 or more"),
        (
            {"env_kwargs.n_steps_lookahed": Int(1, 2)},
            "'env_kwargs.n_steps_lookahed': Unknown option 'n_steps_lookahed' of the piano",
        ),
        (
            {"env_kwargs.n_steps_lookahead": Int(-3, 2)},
            "'env_kwargs.n_steps_lookahead' = -3: n_steps_lookahead is -3: expected 0 to 10000",
        ),
        ({f"{REWARDS}.energie": Float(0, 1)}, f"'{REWARDS}.energie': reward_weights is 'energie'"),
        (
            {"env_wrapper.TemporalStretch.factor": Float(0, 1)},
            "'env_wrapper.TemporalStretch.factor' = 0.0: factor is 0.0: expected a number above 0",
        ),
        ({"env_wrapper.TemporalStretch.x": Float(1, 2)}, "'env_wrapper.TemporalStretch.x' = 1.0"),
        ({"env_wrapper.Stretch.x": Float(1, 2)}, "'env_wrapper.Stretch.x': env_wrapper has no '"),
        (
            {"env_wrapper": Choice({"no": [], "wrong": ["no.such.Wrapper"]})},
            r"'env_wrapper' = \['no.such.Wrapper'\]: env_wrapper: 'no.such.Wrapper' cannot be imp",
        ),
        ({"normalize.norm_rew": Choice([0, 1])}, "'normalize.norm_rew': Unknown key 'norm_rew'"),
        ({"normalize.norm_obs_keys": Choice([["a"], ["b"]])}, "'normalize.norm_obs_keys': Value"),
    ],
)  # fmt: skip
def test_unknown_settings_and_impossible_values_are_named_before_anything_is_trained(
    parameters, message
):
    with pytest.raises(ConfigError, match=f"^Search space: {message}"):
        check(parameters)


@pytest.mark.slow
@pytest.mark.parametrize(
    "parameters",
    [
        {"gamma": Float(0, 1), "tau": Float(0, 1), "gradient_steps": Choice([-1, 1])},
        {"train_freq": Choice([1, [1, "episode"]])},
        {"noise_std": Float(0, 0.2), "noise_type": Choice(["normal", "ornstein-uhlenbeck"])},
        {f"{DECAY}.start": Int(0, 9), f"{DECAY}.n_steps": Int(1, 9)},
        {"normalize": Choice([True, False]), "n_envs": Int(1, 4)},
        {"env_wrapper": Choice({"no": [], "slow": [{STRETCH: {"factor": 1.5}}]})},
        {"policy_kwargs.activation_fn": Choice(["nn.ReLU", "nn.Tanh"])},
    ],
)
def test_what_is_possible_passes_also_settings_that_only_go_together(parameters):
    check(parameters)


class Fussy(gym.Wrapper):
    """An environment that tells only at the first reset that it cannot work."""

    made = 0

    def __init__(self, env, mood=0):
        super().__init__(env)
        Fussy.made += 1
        self.mood = mood

    def reset(self, **kwargs):
        if self.mood < 0:
            raise RuntimeError("not today")
        return super().reset(**kwargs)


def test_what_an_environment_says_in_its_own_way_is_passed_on():
    entry = {"env_wrapper": f"{__name__}.Fussy"}
    message = "^Search space: 'env_wrapper.Fussy.mood' = -1: RuntimeError: not today"
    with pytest.raises(ConfigError, match=message):
        check({"env_wrapper.Fussy.mood": Int(-1, 1)}, entry)


def test_one_environment_in_this_process_is_enough_whatever_the_entry_has():
    entry = {"env_wrapper": f"{__name__}.Fussy", "n_envs": 3, "vec_env": "subproc"}
    before = Fussy.made
    message = "^Search space: 'env_wrapper.Fussy.mood' = -1: RuntimeError: not today"
    with pytest.raises(ConfigError, match=message):  # not: a process ended
        check({"env_wrapper.Fussy.mood": Int(-1, 1)}, entry)
    assert Fussy.made - before == 4  # the entry's own; -1 twice, if only it went with others; 1


@pytest.mark.filterwarnings("error")
def test_warnings_are_left_to_the_training():
    check({"batch_size": Choice([48, 64])}, {"n_steps": 64}, algo="ppo")


def test_an_entry_that_is_wrong_by_itself_is_not_blamed_on_the_space():
    with pytest.raises(ConfigError, match="^Unknown key 'gama' for TD3"):
        check({"gamma": Float(0, 1)}, {"gama": 0.9})
