"""The search spaces that come with this package.

Where ranges come from, by the names used below:

    RoboPianist  Zakka et al. (2023), "RoboPianist: Dexterous Piano Playing with Deep RL".
    RL Zoo       rl_zoo3's own ranges for the algorithm, in its hyperparams_opt.py.
    presets      the files in sb3_piano/hyperparams. Each range holds what they have for the debug
                 pieces, so that a study can begin there.

Not searched are train_freq and gradient_steps: more updates for each step of the environment nearly
always learn more from as many steps, in as much more time. In studies with a budget of minutes,
``gradient_steps: {int: [1, 4]}`` may be added.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from sb3_piano.envs import DEFAULT_REWARD_WEIGHTS
from sb3_piano.tuning.search_space.parsing import Choice, Discount, Float, Int, Parameter
from sb3_piano.tuning.search_space.space import Space

_COMMON: dict[str, Parameter] = {
    # RL Zoo: 1e-5 to 2e-3; presets: 3e-4 and 1e-3. Trials are short, so it begins higher.
    "learning_rate": Float(1e-4, 3e-3, log=True),
    # RL Zoo: 4 to 2048; presets: 128 and 256.
    "batch_size": Int(64, 512, log=True),
    # From 2.5 control steps to 33, 0.1 s to 1.7 s; presets: 0.8, which is 5. RL Zoo's range begins
    # at 0.97.
    "gamma": Discount(0.6, 0.97),
}
_TARGETS: dict[str, Parameter] = {
    # RL Zoo: 0.001 to 0.08; presets: 0.005 and 0.01.
    "tau": Float(0.002, 0.05, log=True),
}
_NETWORK: dict[str, Parameter] = {
    # RoboPianist: three layers; presets for the debug pieces: two, which take half the time.
    "policy_kwargs.net_arch": Choice([[128, 128], [256, 256], [256, 256, 256], [512, 512]]),
}
_ENTROPY: dict[str, Parameter] = {
    # The temperature at the start. RoboPianist: 1; presets for the debug pieces: 0.02.
    "ent_coef": Choice(["auto_0.02", "auto_0.1", "auto_1.0"]),
    # For each of 39 actions -2 to -0.5. One action is the whole range of a joint, so that a policy
    # may become exact only at a low entropy. RoboPianist: -0.5; SB3: -1; presets: down to -1.5.
    "target_entropy": Float(-78.0, -19.5),
}
_NOISE: dict[str, Parameter] = {
    # At 0.1 a hand is 6 cm off. TD3's authors: 0.1; presets for the debug pieces: 0.04.
    "noise_std": Float(0.01, 0.2, log=True),
}


def _policy(name: str) -> dict[str, Parameter]:
    # RoboPianist's critics have dropout and layer normalisation.
    return {"policy": Choice(["MlpPolicy", f"sb3_piano.policies.{name}"])}


_SAC = {**_COMMON, **_TARGETS, **_ENTROPY, **_policy("RegularizedSACPolicy"), **_NETWORK}
_DDPG = {**_COMMON, **_TARGETS, **_NOISE, **_policy("RegularizedTD3Policy"), **_NETWORK}
_TD3: dict[str, Parameter] = {
    **_DDPG,
    # TD3's authors: 0.2, clipped at 0.5; presets for the debug pieces: 0.02 and 0.05.
    "target_policy_noise": Float(0.01, 0.2, log=True),
    "target_noise_clip": Float(0.02, 0.5, log=True),
    "policy_delay": Int(1, 4),  # TD3's authors, and SB3's default: 2
}
_TQC: dict[str, Parameter] = {
    **_COMMON, **_TARGETS, **_ENTROPY, **_NETWORK,
    # RL Zoo has 0 to 5 of 5 to 50; presets: 2 of 25. Some have to remain.
    "top_quantiles_to_drop_per_net": Int(0, 5),
    "policy_kwargs.n_quantiles": Int(10, 50),
}  # fmt: skip
_CROSSQ: dict[str, Parameter] = {
    **_COMMON, **_ENTROPY,
    "policy_delay": Int(1, 4),  # its authors, and the presets: 3
    # Its authors have critics of 2048, SB3 of 1024, presets for the debug pieces of 256.
    "policy_kwargs.net_arch": Choice({
        "critics 256": {"pi": [256, 256], "qf": [256, 256]},
        "critics 512": {"pi": [256, 256], "qf": [512, 512]},
        "critics 1024": {"pi": [256, 256], "qf": [1024, 1024]},
    }),
}  # fmt: skip


def _separate(*layers: int) -> dict[str, Any]:
    return {"pi": [*layers], "vf": [*layers]}


_PPO: dict[str, Parameter] = {
    # RL Zoo: 1e-5 to 2e-3; presets: 3e-4.
    "learning_rate": Float(3e-5, 3e-3, log=True),
    # Every n_steps is a multiple of every batch_size, so that no batch is smaller than the others.
    "n_steps": Choice([256, 512, 1024, 2048]),
    "batch_size": Choice([32, 64, 128, 256]),
    "n_epochs": Int(3, 20),  # RL Zoo: 1 to 20; presets: 10
    "gamma": _COMMON["gamma"],
    # RL Zoo: from 0.9 on; with a gamma this low, little changes above.
    "gae_lambda": Discount(0.6, 0.99),
    "clip_range": Float(0.1, 0.4),  # RL Zoo; presets: 0.2
    "ent_coef": Float(0.0, 0.02),  # RL Zoo: up to 0.1; presets: 0
    "max_grad_norm": Float(0.3, 2.0),  # RL Zoo; presets: 0.5
    # Logarithm of the actions' deviation at the start, in shares of half a joint's range: from 0.05
    # to 1. SB3's default is 1, presets for the debug pieces have 0.14.
    "policy_kwargs.log_std_init": Float(-3.0, 0.0),
    "policy_kwargs.net_arch": Choice({
        "2 x 64": _separate(64, 64),
        "2 x 256": _separate(256, 256),
        "3 x 256": _separate(256, 256, 256),
    }),
}  # fmt: skip

# Only what changes nothing about the music that is asked for, so that trials remain comparable.
_ENV: dict[str, Parameter] = {
    # How far ahead the goal is seen: 0.05 s to 1 s. RoboPianist: 10.
    "env_kwargs.n_steps_lookahead": Int(1, 20),
    # Presets for the debug pieces: "fingers". "roll" says no more than "window", and takes longer.
    "env_kwargs.observation": Choice(["window", "fingers"]),
}
# Only the proportions matter, so ``key_press`` stays at 1. From a tenth of RoboPianist's weight to
# ten times as much, or three times where the term is as large as ``key_press``.
_REWARD: dict[str, Parameter] = {
    f"env_kwargs.reward_weights.{term}": Float(
        DEFAULT_REWARD_WEIGHTS[term] / 10, DEFAULT_REWARD_WEIGHTS[term] * most, log=True
    )
    for term, most in (("fingering", 3), ("energy", 10), ("forearm", 3), ("sustain", 3))
}

SPACES: Mapping[str, Space] = MappingProxyType(
    {
        "td3": Space(_TD3),
        "sac": Space(_SAC),
        "tqc": Space(_TQC),
        "ddpg": Space(_DDPG),
        "crossq": Space(_CROSSQ),
        "ppo": Space(_PPO),
        "env": Space(_ENV),
        "reward": Space(_REWARD),
    }
)
"""By the name of their algorithm; "env" and "reward" are for any."""
