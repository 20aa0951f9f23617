"""Weights at the end of a training, averaged over its updates."""

import signal

import numpy as np
import pytest
import torch
from stable_baselines3 import PPO
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
        parameters = self.model.policy.parameters()
        self.seen.append(torch.cat([one.detach().flatten() for one in parameters]).numpy().copy())


@pytest.mark.parametrize("decay", [0.0, 0.5, 0.99])
def test_the_policy_ends_with_the_moving_average_of_what_it_was(decay):
    recorder = _Recorder()
    model = PPO("MlpPolicy", "Pendulum-v1", n_steps=16, batch_size=16, seed=0, device="cpu")
    model.learn(64, callback=[recorder, AveragedWeightsCallback(decay)])
    assert len(recorder.seen) == 5
    average = np.zeros_like(recorder.seen[0])
    for number, weights in enumerate(recorder.seen, start=1):
        share = max(1 - decay, 1 / number)
        average += share * (weights - average)
    final = torch.cat([one.detach().flatten() for one in model.policy.parameters()]).numpy()
    np.testing.assert_allclose(final, average, atol=1e-6)
    assert np.abs(recorder.seen[-1] - recorder.seen[0]).max() > 1e-3


class _StopAt(BaseCallback):
    """End the training at a step, by a signal or without one."""

    def __init__(self, step, signaled):
        super().__init__()
        self._step, self._signaled = step, signaled

    def _on_step(self):
        if self.num_timesteps == self._step and self._signaled:
            signal.raise_signal(signal.SIGINT)
        return self.num_timesteps < self._step


@pytest.mark.parametrize(
    ("step", "signaled", "averaged"),
    [(40, True, False), (40, False, True), (64, True, True)],
    ids=["interrupted", "ended by a callback", "a signal in the last step"],
)
def test_an_interrupted_training_keeps_its_last_weights(step, signaled, averaged):
    recorder = _Recorder()
    model = PPO("MlpPolicy", "Pendulum-v1", n_steps=16, batch_size=16, seed=0, device="cpu")
    with stop_on_signal():
        model.learn(64, callback=[recorder, AveragedWeightsCallback(), _StopAt(step, signaled)])
    final = torch.cat([one.detach().flatten() for one in model.policy.parameters()]).numpy()
    assert np.array_equal(final, recorder.seen[-1]) is not averaged
