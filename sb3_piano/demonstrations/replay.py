"""Data sets in replay buffers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.buffers import ReplayBuffer

from sb3_piano.demonstrations.dataset import Transitions, open_dataset
from sb3_piano.exceptions import ConfigError

if TYPE_CHECKING:
    from minari import MinariDataset


def fill_replay_buffer(target: BaseAlgorithm | ReplayBuffer, dataset: MinariDataset | str) -> int:
    """Add the transitions of a data set to a replay buffer, as if the model had played them.

    Observations and rewards are stored as the environment gave them; ``VecNormalize`` works on
    samples. Actions are those that were played, scaled to [-1, 1] as all of Stable-Baselines3's. An
    episode's end by its time limit counts as going on, if the buffer handles that.

    A buffer of several environments gets an equal, unbroken stretch for each; where one breaks off
    an episode, that counts as a time limit. At most one transition fewer than there are
    environments is left out, at the end.

    Args:
        target: An off-policy model, or its replay buffer.
        dataset: A Minari data set, or its name.

    Returns:
        How many transitions were added.

    Raises:
        ConfigError: If there is no such data set, the target has no replay buffer of plain arrays,
            its spaces are others, or it is too small.
        ImportError: If Minari is not installed.
    """
    buffer = getattr(target, "replay_buffer", target)
    if not isinstance(buffer, ReplayBuffer):
        raise ConfigError(
            f"A {type(target).__name__} has no replay buffer: expected a model of an off-policy "
            "algorithm, such as TD3 or SAC."
        )
    found = open_dataset(dataset)
    check_spaces(found, buffer.observation_space, buffer.action_space)
    transitions = Transitions.of(found)
    rows = len(transitions) // buffer.n_envs
    if rows == 0 or rows > buffer.buffer_size:
        raise ConfigError(
            f"Data set {found.id!r} has {len(transitions)} transitions, the replay buffer room for "
            f"{buffer.buffer_size * buffer.n_envs} of {buffer.n_envs} environment(s): expected at "
            "least one for each and at most as many as there is room for. Set buffer_size."
        )
    _add(buffer, transitions, rows)
    return rows * buffer.n_envs


def check_spaces(
    dataset: MinariDataset, observation_space: spaces.Space, action_space: spaces.Space
) -> None:
    """Refuse a data set whose observations or actions are others than a model's.

    Raises:
        ConfigError: If they are.
    """
    for name, theirs, ours in (
        ("observations", dataset.observation_space, observation_space),
        ("actions", dataset.action_space, action_space),
    ):
        if theirs.shape != ours.shape:
            raise ConfigError(
                f"Data set {dataset.id!r} has {name} of shape {theirs.shape}, the model of shape "
                f"{ours.shape}: expected the environment that was recorded, with its options."
            )
        if theirs != ours:
            raise ConfigError(
                f"Data set {dataset.id!r} has {name} from {_range(theirs)}, the model from "
                f"{_range(ours)}: expected the environment that was recorded, with its options."
            )


def scaled_actions(actions: npt.NDArray[Any], space: spaces.Space) -> npt.NDArray[Any]:
    """Return actions as Stable-Baselines3 stores them: those of a ``Box`` scaled to [-1, 1]."""
    assert isinstance(space, spaces.Box), "checked with the data set"
    return 2.0 * (actions - space.low) / (space.high - space.low) - 1.0


def _range(space: spaces.Space) -> str:
    if not isinstance(space, spaces.Box):
        return str(space)
    return f"{space.low.min()} to {space.high.max()} ({space.dtype})"


def _add(buffer: ReplayBuffer, transitions: Transitions, rows: int) -> None:
    n_envs = buffer.n_envs
    # Row i has the i-th transition of each environment's stretch.
    order = np.arange(rows * n_envs).reshape(n_envs, rows).T
    actions = scaled_actions(transitions.actions, buffer.action_space)
    ended = transitions.terminations | transitions.truncations
    limited = transitions.truncations & ~transitions.terminations
    if buffer.handle_timeout_termination:
        broken_off = order[-1][~ended[order[-1]]]
        ended[broken_off] = limited[broken_off] = True
    for row in order:
        buffer.add(
            transitions.observations[row],
            transitions.next_observations[row],
            actions[row],
            transitions.rewards[row],
            ended[row],
            [{"TimeLimit.truncated": bool(limit)} for limit in limited[row]],
        )
