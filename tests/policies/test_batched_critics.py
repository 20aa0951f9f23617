"""Batched critics give what critics one by one give."""

import contextlib

import numpy as np
import pytest
import torch
from gymnasium import spaces
from sb3_contrib import TQC
from stable_baselines3 import SAC, TD3
from stable_baselines3.common.vec_env import DummyVecEnv
from torch import nn

from sb3_piano.policies import RegularizedSACPolicy
from sb3_piano.policies.batched_critics import batched_critics


class Points(DummyVecEnv):
    """Spaces alone, for a model."""

    def __init__(self, inputs=7, actions=3):
        self.num_envs, self.render_mode, self.reset_infos = 1, None, [{}]
        self.observation_space = spaces.Box(-1, 1, (inputs,))
        self.action_space = spaces.Box(-1, 1, (actions,))


def critics(algorithm=SAC, policy="MlpPolicy", **options):
    network = {"net_arch": [16, 16], **options}
    model = algorithm(policy, Points(), policy_kwargs=network, seed=0, device="cpu")
    return model.critic


@pytest.mark.parametrize("count", [2, 5])
@pytest.mark.parametrize(
    ("algorithm", "policy", "options"),
    [
        (SAC, "MlpPolicy", {"activation_fn": nn.Tanh}),
        (TD3, "MlpPolicy", {}),
        (SAC, RegularizedSACPolicy, {"dropout": 0.0, "layer_norm": False, "mean_q": True}),
    ],
)
def test_values_and_gradients_are_equal_but_for_rounding(algorithm, policy, options, count):
    critic = critics(algorithm, policy, n_critics=count, **options)
    obs, actions = torch.randn(9, 7), torch.randn(9, 3, requires_grad=True)
    found = []
    for change in (contextlib.nullcontext(False), batched_critics(critic)):
        with change as changed:
            values = critic(obs, actions)
        assert changed == bool(found)
        loss = sum(((value - 1) ** 2).sum() for value in values)
        gradients = torch.autograd.grad(loss, [actions, *critic.parameters()])
        found.append([*values, *gradients])
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one.detach(), other.detach(), atol=1e-5)
    assert not {"each", "forward"} & set(vars(critic))


@pytest.mark.parametrize("critic", [critics(n_critics=1), critics(TQC), None])
def test_other_critics_stay_as_they_are(critic):
    with batched_critics(critic) as changed:
        assert not changed
