"""How much memory a full replay buffer takes."""

from __future__ import annotations

import contextlib

import gymnasium as gym
import numpy as np
from stable_baselines3.common.buffers import ReplayBuffer

from sb3_piano.bench.rows import Row
from sb3_piano.bench.settings import ENV_ID, BenchSettings
from sb3_piano.buffers import CompactReplayBuffer
from sb3_piano.envs import GENERAL_ID
from sb3_piano.training import load_config

_GB = 1e9
_PRESET = "td3"


def memory_rows(settings: BenchSettings) -> tuple[Row, ...]:
    """Return the sizes of SB3's replay buffer and of ours, for RoboPianist's full observation.

    Both are filled with the same transitions, and what they take by then is scaled to the size in
    the preset: nobody has to have the memory for it.
    """
    size = load_config(_PRESET, GENERAL_ID).algorithm_kwargs["buffer_size"]
    with contextlib.closing(gym.make(ENV_ID, observation="roll")) as env:
        spaces = env.observation_space, env.action_space
        stock = ReplayBuffer(settings.transitions, *spaces, device="cpu")
        compact = CompactReplayBuffer(settings.transitions, *spaces, device="cpu")
        _fill((stock, compact), env, settings.transitions)
    scale = size / settings.transitions
    stock_bytes, compact_bytes = round(_nbytes(stock) * scale), round(compact.nbytes * scale)
    return (
        _row(f"ReplayBuffer({size})", stock_bytes, {}),
        _row(
            f"CompactReplayBuffer({size})",
            compact_bytes,
            {"x of ReplayBuffer": compact_bytes / stock_bytes},
        ),
    )


def _fill(buffers: tuple[ReplayBuffer, ...], env: gym.Env, transitions: int) -> None:
    """Add as many transitions under random actions as are asked for, to every buffer."""
    env.action_space.seed(0)
    observation, _ = env.reset(seed=0)
    for _ in range(transitions):
        action = env.action_space.sample()
        following, reward, terminated, truncated, _ = env.step(action)
        for buffer in buffers:
            buffer.add(
                observation[None],
                following[None],
                action[None],
                np.array([reward]),
                np.array([terminated or truncated]),
                [{"TimeLimit.truncated": truncated and not terminated}],
            )
        observation = env.reset()[0] if terminated or truncated else following


def _nbytes(buffer: ReplayBuffer) -> int:
    return sum(value.nbytes for value in vars(buffer).values() if isinstance(value, np.ndarray))


def _row(name: str, nbytes: int, ratios: dict[str, float]) -> Row:
    return Row(part="memory", name=name, value=nbytes / _GB, unit="GB", ratios=ratios)
