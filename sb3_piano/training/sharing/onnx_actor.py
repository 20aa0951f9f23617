"""The actor of a saved model as an ONNX file, for programs without this package."""

from __future__ import annotations

import io
import warnings
from pathlib import Path
from typing import Any, cast

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from sb3_piano.exceptions import ConfigError, MissingPackageError, install_command
from sb3_piano.files import write_bytes
from sb3_piano.training.playing.player import SavedPlayer

OBSERVATION, ACTION = "observation", "action"
"""Names of the graph's input and output."""


def write_onnx(player: SavedPlayer, file: Path) -> None:
    """Write what a model plays for an observation, without exploring, as ONNX.

    Input ``observation`` is (batch, n) float32, as the environment with the run's wrappers gives
    it; the statistics of ``VecNormalize`` are in the graph. Output ``action`` is (batch, m)
    float32, as ``predict(observation, deterministic=True)`` returns it.

    Raises:
        ConfigError: If the model is no network from vectors to vectors.
        MissingPackageError: If onnx is not installed.
    """
    try:
        import onnx  # noqa: F401  # torch needs it
    except ImportError as error:
        raise MissingPackageError(
            f"ONNX files need another package: {install_command('onnx')}"
        ) from error
    model = player.model
    if not isinstance(model, BaseAlgorithm):
        raise ConfigError(
            f"Run '{player.run.path}' plays by {player.config.algo!r}, which is no network: "
            "expected the run of a training, or no ONNX file."
        )
    for space in (model.observation_space, model.action_space):
        if not isinstance(space, gym.spaces.Box) or len(space.shape) != 1:
            raise ConfigError(
                f"Run '{player.run.path}' observes {model.observation_space} and acts in "
                f"{model.action_space}: expected vectors, or no ONNX file."
            )
    actor = _Actor(model.policy, player.vec_env).eval()
    example = torch.zeros(1, actor.size)
    batch = {OBSERVATION: {0: "batch"}, ACTION: {0: "batch"}}
    buffer = io.BytesIO()
    device = model.policy.device
    model.policy.to("cpu")
    with warnings.catch_warnings():
        # The newer exporter needs onnxscript, too, and gives the same graph.
        warnings.simplefilter("ignore")
        torch.onnx.export(
            actor,
            (example,),
            cast(Any, buffer),  # torch takes files, too, which its types leave out
            input_names=[OBSERVATION],
            output_names=[ACTION],
            dynamic_axes=batch,
            dynamo=False,
        )
    model.policy.to(device)
    write_bytes(file, buffer.getvalue())


class _Actor(torch.nn.Module):
    """A policy with what SB3 does around it in NumPy: normalisation before, scaling after."""

    mean: torch.Tensor
    scale: torch.Tensor
    low: torch.Tensor
    high: torch.Tensor

    def __init__(self, policy: BasePolicy, venv: VecEnv) -> None:
        super().__init__()
        self.policy = policy
        self._agents = venv.num_envs
        part = int(np.prod(policy.observation_space.shape or ()))
        self.size = part * self._agents
        self._clip: float | None = None
        if isinstance(venv, VecNormalize) and venv.norm_obs:
            statistics: Any = venv.obs_rms
            self._clip = venv.clip_obs
            self.register_buffer("mean", torch.tensor(statistics.mean).double())
            deviation = np.sqrt(statistics.var + venv.epsilon)
            self.register_buffer("scale", torch.tensor(deviation).double())
        space: Any = policy.action_space
        self.register_buffer("low", torch.tensor(space.low).float())
        self.register_buffer("high", torch.tensor(space.high).float())
        self._part, self._actions = part, int(space.shape[0])

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        seen = observation.reshape(-1, self._part)
        if self._clip is not None:
            seen = (seen.double() - self.mean) / self.scale
            seen = seen.clamp(-self._clip, self._clip).float()
        action = self.policy._predict(seen, deterministic=True)
        if self.policy.squash_output:
            action = self.low + 0.5 * (action + 1.0) * (self.high - self.low)
        else:
            action = torch.minimum(torch.maximum(action, self.low), self.high)
        return action.reshape(-1, self._agents * self._actions)
