"""Weights at the end of a training, averaged over its updates."""

import numpy as np
import pytest
from acting import ActAt
from scripted import tiny_ppo, weights_of
from stable_baselines3.common.callbacks import BaseCallback

from sb3_piano.callbacks import AveragedWeightsCallback
from sb3_piano.interrupts import stop_on_signal


class _Recorder(BaseCallback):
    """Keep the weights after each update; what comes after it in a list changes the last ones."""

    def __init__(self):
        super().__init__()
        self.seen = []

    def _on_rollout_start(self):
        self._keep()

    def _on_training_end(self):
        self._keep()

    def _on_step(self):
        return True

    def _keep(self):
        self.seen.append(weights_of(self.model).numpy().copy())


@pytest.mark.parametrize("decay", [0.0, 0.5, 0.99])
def test_the_policy_ends_with_the_moving_average_of_what_it_was(decay):
    recorder = _Recorder()
    model = tiny_ppo("Pendulum-v1", 16, n_epochs=2, seed=0)
    model.learn(64, callback=[recorder, AveragedWeightsCallback(decay)])
    assert len(recorder.seen) == 5
    average = np.zeros_like(recorder.seen[0])
    for number, weights in enumerate(recorder.seen, start=1):
        share = max(1 - decay, 1 / number)
        average += share * (weights - average)
    final = weights_of(model).numpy()
    np.testing.assert_allclose(final, average, atol=1e-6)
    assert np.abs(recorder.seen[-1] - recorder.seen[0]).max() > 1e-3


@pytest.mark.parametrize(
    ("step", "signaled", "averaged"),
    [(40, True, False), (40, False, True), (64, True, True)],
    ids=["interrupted", "ended by a callback", "a signal in the last step"],
)
def test_an_interrupted_training_keeps_its_last_weights(step, signaled, averaged):
    recorder = _Recorder()
    model = tiny_ppo("Pendulum-v1", 16, n_epochs=2, seed=0)
    stops = [ActAt(step, signal) for signal in (["SIGINT"] if signaled else []) + ["stop"]]
    with stop_on_signal():
        model.learn(64, callback=[recorder, AveragedWeightsCallback(), *stops])
    final = weights_of(model).numpy()
    assert np.array_equal(final, recorder.seen[-1]) is not averaged
