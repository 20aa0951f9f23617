"""A run tells its callbacks where they are, however deep they are nested."""

from __future__ import annotations

from pathlib import Path

import pytest
from scripted import NoisyEnv, tiny_td3, vector_of
from stable_baselines3.common.callbacks import (
    BaseCallback,
    CallbackList,
    ConvertCallback,
    EvalCallback,
    EveryNTimesteps,
)

from sb3_piano.callbacks import F1Callback, OnsetF1Callback
from sb3_piano.callbacks.own_env import RunContext, hand_over
from sb3_piano.vec_env import ThreadVecEnv


def no_env(innermost):
    raise AssertionError("no environment is needed yet")


def context(folder="runs/1"):
    return RunContext(folder=Path(folder), make_env=no_env)


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
    run = context()
    hand_over(run, callbacks)
    assert [callback.run for callback in asking] == [run] * 5


def test_the_best_model_goes_into_the_runs_folder_unless_told_otherwise():
    callbacks = [F1Callback(), OnsetF1Callback(), F1Callback(best_model_save_path="mine")]
    hand_over(context(), callbacks)
    paths = [callback.best_model_save_path for callback in callbacks]
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
    hand_over(RunContext(folder=tmp_path, make_env=make_env), [callback])
    tiny_td3(NoisyEnv()).learn(10, callback)
    assert len(callback.evaluations_metrics) == 2
    assert len(made) == 1
    assert closed == made
    assert (tmp_path / "best_f1" / "best_model.zip").is_file()
