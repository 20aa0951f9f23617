"""The environment of a callback: like the training's, and without a trace in the training."""

import contextlib
import random
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import torch
from scripted import NoisyEnv, tiny, tiny_ppo, vector_of, weights_of
from stable_baselines3.common.callbacks import (
    BaseCallback,
    CallbackList,
    ConvertCallback,
    EvalCallback,
    EveryNTimesteps,
)
from stable_baselines3.common.vec_env import (
    DummyVecEnv,
    SubprocVecEnv,
    VecFrameStack,
    VecMonitor,
    VecNormalize,
)

import sb3_piano.layers
from sb3_piano.callbacks import F1Callback, OnsetF1Callback
from sb3_piano.callbacks.own_env import (
    RunContext,
    make_own_env,
    preserve_random_state,
    set_run_context,
    sync_normalization,
)
from sb3_piano.exceptions import ConfigError
from sb3_piano.vec_env import ThreadVecEnv


class Innermost(gym.Wrapper):
    """A wrapper by whose name its place is found."""


def own_env(venv, innermost=None):
    return make_own_env(tiny(venv), None, innermost)


def layers(env):
    return [type(layer).__name__ for layer in sb3_piano.layers.layers(env)]


def learned(make_model, callback):
    model = make_model()
    model.learn(60, callback=callback)
    return weights_of(model), model.get_env().unwrapped.envs[0].unwrapped.np_random.normal()


def td3():
    return tiny(VecNormalize(vector_of(NoisyEnv, seed=1)), learning_starts=10)


def td3_in_threads():
    return tiny(
        vector_of(NoisyEnv, n_envs=2, vec_env_cls=ThreadVecEnv, vec_env_kwargs={"n_threads": 1}),
        learning_starts=10,
    )


def ppo():
    return tiny_ppo(vector_of(NoisyEnv), 20, seed=1)


@pytest.mark.slow
@pytest.mark.parametrize("make_model", [td3, td3_in_threads, ppo])
@pytest.mark.parametrize(("deterministic", "seed"), [(True, 0), (False, None)])
def test_training_gives_the_same_model_with_and_without_evaluation(make_model, deterministic, seed):
    expected, next_draw = learned(make_model, None)
    callback = F1Callback(eval_freq=7, deterministic=deterministic, n_eval_episodes=2, seed=seed)
    found, draw = learned(make_model, callback)
    assert len(callback.evaluations_metrics) >= 4
    assert torch.equal(found, expected)
    assert draw == next_draw


def test_the_global_generators_are_given_back_as_they_were(tmp_path):
    model = tiny(NoisyEnv())

    def draws():
        return random.random(), np.random.random(), torch.rand(()).item()  # noqa: NPY002

    def make_env(innermost):
        draws()
        return vector_of(NoisyEnv)

    model.set_random_seed(3)
    expected = draws()
    model.set_random_seed(3)
    with contextlib.suppress(KeyboardInterrupt), preserve_random_state(model, 5):
        assert draws() != expected
        raise KeyboardInterrupt
    make_own_env(model, RunContext(folder=tmp_path, make_env=make_env))
    assert draws() == expected


@pytest.mark.parametrize("innermost", [None, Innermost])
@pytest.mark.parametrize("vec_env_cls", [DummyVecEnv, ThreadVecEnv])
def test_one_environment_is_copied_with_its_wrappers_and_one_more(vec_env_cls, innermost):
    wrap = gym.wrappers.FlattenObservation
    training = vector_of(NoisyEnv, n_envs=2, wrapper_class=wrap, vec_env_cls=vec_env_cls)
    copied = own_env(training, innermost)
    assert type(copied) is DummyVecEnv
    assert copied.num_envs == 1
    inside = ["NoisyEnv"] if innermost is None else ["Innermost", "NoisyEnv"]
    assert layers(copied.envs[0]) == ["FlattenObservation", "Monitor", *inside]
    assert layers(training.envs[0]) == ["FlattenObservation", "Monitor", "NoisyEnv"]
    assert copied.envs[0].unwrapped is not training.envs[0].unwrapped
    assert layers(own_env(DummyVecEnv([NoisyEnv])).envs[0]) == ["Monitor", "NoisyEnv"]


def test_a_copy_normalises_as_the_training_does_now_and_learns_nothing_itself():
    training = VecNormalize(VecMonitor(DummyVecEnv([NoisyEnv])))
    model = tiny(training)
    copied = make_own_env(model, None)
    assert isinstance(copied, VecNormalize)
    assert isinstance(copied.venv, VecMonitor)
    assert (training.training, copied.training) == (True, False)
    model.learn(20)
    sync_normalization(model, copied)
    copied.reset()
    copied.step(np.zeros((1, 1)))
    assert copied.obs_rms.count == training.obs_rms.count == pytest.approx(21, abs=1e-3)
    np.testing.assert_array_equal(copied.obs_rms.mean, training.obs_rms.mean)


def test_other_wrappers_of_the_vector_are_copied_for_one_environment():
    training = VecFrameStack(vector_of(NoisyEnv), n_stack=3)
    copied = own_env(training, Innermost)
    assert isinstance(copied, VecFrameStack)
    assert copied.reset().shape == (1, 6)
    assert layers(copied.venv.envs[0]) == ["Monitor", "Innermost", "NoisyEnv"]
    assert layers(training.venv.envs[0]) == ["Monitor", "NoisyEnv"]
    with pytest.raises(ConfigError, match="VecFrameStack around the training's 2 environments"):
        own_env(VecFrameStack(vector_of(NoisyEnv, n_envs=2), n_stack=3))


def test_an_environment_that_cannot_be_copied_is_named(tmp_path):
    class WithFile(NoisyEnv):
        def __init__(self):
            self.file = (tmp_path / "open").open("w")

        def close(self):
            self.file.close()

    elsewhere = {"vec_env_cls": SubprocVecEnv, "vec_env_kwargs": {"start_method": "fork"}}
    for training, message in (
        (vector_of(WithFile), "training's WithFile cannot be copied .*eval_env="),
        (vector_of(NoisyEnv, **elsewhere), "in a SubprocVecEnv.*eval_env=.*by 'sb3-piano train'"),
    ):
        with pytest.raises(ConfigError, match=message):
            own_env(training)
        training.close()


RUN = RunContext(folder=Path("runs/1"), make_env=lambda innermost: pytest.fail("not needed yet"))


class Asking(BaseCallback):
    run = None

    def use_run(self, run):
        self.run = run

    def _on_step(self):
        return True


def test_every_callback_that_asks_is_told():
    asking = [Asking() for _ in range(5)]
    callbacks = [
        asking[0],
        CallbackList([EveryNTimesteps(10, asking[1]), ConvertCallback(lambda *_: True)]),
        EvalCallback(NoisyEnv(), asking[2], asking[3]),
        F1Callback(callback_on_new_best=CallbackList([asking[4]])),
    ]
    set_run_context(RUN, callbacks)
    assert [callback.run for callback in asking] == [RUN] * 5
    # The best model goes into the run's folder unless another one is given.
    judges = [callbacks[-1], OnsetF1Callback(), F1Callback(best_model_save_path="mine")]
    set_run_context(RUN, judges)
    paths = [judge.best_model_save_path for judge in judges]
    assert paths == [str(Path("runs/1/best_f1")), str(Path("runs/1/best_onset_f1")), "mine"]


@pytest.mark.filterwarnings("error:Training and eval env are not of the same type")
def test_the_environment_is_the_runs_and_closed_at_the_end(tmp_path):
    made, closed = [], []

    class Env(NoisyEnv):
        def close(self):
            closed.append(self)

    def make_env(innermost):
        assert innermost is None
        made.append(Env())
        return vector_of(lambda: made[-1], vec_env_cls=ThreadVecEnv)  # other than the training's

    callback = F1Callback(eval_freq=5)
    set_run_context(RunContext(folder=tmp_path, make_env=make_env), [callback])
    tiny(NoisyEnv()).learn(10, callback)
    assert len(callback.evaluations_metrics) == 2
    assert len(made) == 1
    assert closed == made
    assert (tmp_path / "best_f1" / "best_model.zip").is_file()
