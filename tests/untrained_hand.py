"""What tests of the sight-reader's corrections share: a network that has learnt nothing."""

import numpy as np
import torch

from sb3_piano.envs import PianoEnv
from sb3_piano.players import HandModel
from sb3_piano.policies import HandsTD3Policy, set_standardization
from sb3_piano.policies.hand_network import HandHead
from sb3_piano.wrappers import HandActions


def hands(piece, observation="hands", **options):
    """Return an environment for it."""
    options |= {"reduced_action_space": False, "physics": "fast", "initial_buffer_time": 0.1}
    return HandActions(PianoEnv(piece, observation=observation, **options))


def write_network(file, piece):
    """Write the file of a network whose actions are anywhere in their range."""
    torch.manual_seed(3)
    env, random = hands(piece), np.random.default_rng(0)
    spaces = env.observation_space, env.action_space
    policy = HandsTD3Policy(*spaces, lambda _: 1e-4, net_arch={"pi": [16], "qf": [8]})
    size = spaces[0].shape[0] // 2
    set_standardization(policy, random.normal(size=size), random.uniform(0.5, 2.0, size=size))
    for module in policy.modules():
        if isinstance(module, HandHead):
            torch.nn.init.normal_(module.weight, 0.0, 0.1)
    HandModel.of(policy, env).save(file)
