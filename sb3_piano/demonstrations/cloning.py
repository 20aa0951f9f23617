"""Behaviour cloning, and replay buffers filled from data sets."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import torch
from gymnasium import spaces
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.running_mean_std import RunningMeanStd

from sb3_piano.demonstrations.corpus import RecordedCorpus, open_recorded
from sb3_piano.demonstrations.dataset import Transitions, open_dataset
from sb3_piano.demonstrations.shards import Shard
from sb3_piano.demonstrations.streaming import DEFAULT_BUFFER, Rows, ShuffledRows
from sb3_piano.exceptions import ConfigError
from sb3_piano.settings import Count, Positive, checked

if TYPE_CHECKING:
    from minari import MinariDataset

DEFAULT_LOG_STD = -3.5
"""About 0.03 of half an action range: no more than the noise that a planned pianist survives."""

_CONSTANT = 1e-8
"""Up to this variance a number of the observation counts as constant."""


def fill_replay_buffer(target: BaseAlgorithm | ReplayBuffer, dataset: MinariDataset | str) -> int:
    """Add the transitions of a data set to a replay buffer, as if the model had played them.

    Observations and rewards are stored as the environment gave them; ``VecNormalize`` works on
    samples. Actions are the played ones, scaled to [-1, 1] as Stable-Baselines3 does. The end of an
    episode by its time limit is not terminal, if the buffer handles that.

    A buffer of several environments gets an equal, unbroken stretch for each; a stretch that cuts
    an episode counts as a time limit. Fewer transitions than environments may be left out at the
    end.

    Args:
        target: An off-policy model, or its replay buffer.
        dataset: A Minari data set, or its name.

    Returns:
        How many transitions were added.

    Raises:
        ConfigError: If there is no such data set, the target has no replay buffer of plain arrays,
            its spaces are others, or it is too small.
        MissingPackageError: If Minari is not installed.
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
    """Raise an error unless a data set has the model's observations and actions.

    Raises:
        ConfigError: If they differ.
    """
    for name, theirs, ours in (
        ("observations", dataset.observation_space, observation_space),
        ("actions", dataset.action_space, action_space),
    ):
        if theirs != ours:
            differs = theirs.shape != ours.shape
            them, us = (f"of shape {s.shape}" if differs else _range(s) for s in (theirs, ours))
            raise ConfigError(
                f"Data set {dataset.id!r} has {name} {them}, the model {us}: expected the "
                "environment that was recorded, with its options."
            )


def scaled_actions(actions: npt.NDArray[Any], space: spaces.Space) -> npt.NDArray[Any]:
    """Scale actions of a ``Box`` to [-1, 1], as Stable-Baselines3 stores them."""
    assert isinstance(space, spaces.Box), "checked with the data set"
    return 2.0 * (actions - space.low) / (space.high - space.low) - 1.0


def _range(space: spaces.Space) -> str:
    if not isinstance(space, spaces.Box):
        return f"from {space}"
    return f"from {space.low.min()} to {space.high.max()} ({space.dtype})"


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


@dataclass(frozen=True, kw_only=True)
class Cloning:
    """Result of :func:`clone_behaviour`."""

    n_transitions: int
    """Number of transitions."""
    losses: tuple[float, ...]
    """Mean squared error of the actions, scaled to [-1, 1], in each epoch."""


# Of our own, because the imitation package cannot be installed beside this one: its last release,
# 1.0.1, demands gymnasium 0.29 and Stable-Baselines3 2.2.
def clone_behaviour(
    model: BaseAlgorithm,
    dataset: MinariDataset | RecordedCorpus | str,
    *,
    epochs: int = 60,
    batch_size: int = 256,
    learning_rate: float = 1e-3,
    log_std: float | None = DEFAULT_LOG_STD,
    seed: int = 0,
    buffer: int = DEFAULT_BUFFER,
    on_epoch: Callable[[float], object] = lambda loss: None,
) -> Cloning:
    """Train the actor of an off-policy model on the expert actions of a data set.

    The loss is the squared error of the deterministic action; the learning rate falls to 0 along a
    half cosine. Critics stay unchanged. If the model has ``VecNormalize`` with normalised
    observations, its statistics become those of the data set.

    Args:
        model: A model of SAC, TQC, TD3 or DDPG.
        dataset: A Minari data set or its name, or a corpus or its folder.
        epochs: How often to go through all transitions, at least 1.
        batch_size: Transitions of an update, at least 1.
        learning_rate: Learning rate of Adam at the beginning, above 0.
        log_std: Logarithm of the exploration's standard deviation that SAC and TQC get, before
            the action is squashed; ``None`` leaves it. Fresh ones explore the whole range, which
            would play nothing of what was learnt. Others, and those with gSDE, have none.
        seed: Shuffles the transitions.
        buffer: Transitions that are held in memory, at least 1; a larger corpus is read shard by
            shard in each epoch, see :class:`~sb3_piano.demonstrations.streaming.ShuffledRows`.
        on_epoch: Called with the loss of each epoch.

    Raises:
        ConfigError: If a number is out of range, the model has no actor, or the data set does not
            fit it.
        MissingPackageError: If Minari is not installed.
    """
    checked("epochs", epochs, Count)
    checked("batch_size", batch_size, Count)
    checked("learning_rate", learning_rate, Positive)
    checked("buffer", buffer, Count)
    actor = getattr(model.policy, "actor", None)
    if not isinstance(actor, torch.nn.Module):
        raise ConfigError(
            f"A {type(model).__name__} has no actor to clone into: expected SAC, TQC, TD3 or DDPG."
        )
    rows = _rows(model, dataset, buffer)
    if log_std is not None:
        _fix_exploration(actor, log_std)
    losses = []
    model.policy.set_training_mode(True)
    try:
        for loss in _epochs(model, actor, rows, epochs, batch_size, learning_rate, seed):
            losses.append(loss)
            on_epoch(loss)
    finally:
        model.policy.set_training_mode(False)
    target = getattr(model.policy, "actor_target", None)
    if isinstance(target, torch.nn.Module):
        target.load_state_dict(actor.state_dict())
    return Cloning(n_transitions=len(rows), losses=tuple(losses))


def _rows(
    model: BaseAlgorithm, dataset: MinariDataset | RecordedCorpus | str, buffer: int
) -> ShuffledRows:
    """Return normalised observations and target actions; set the statistics to the data's."""
    found = open_recorded(dataset)
    reads: list[Callable[[], Transitions]]
    if isinstance(found, RecordedCorpus):
        first = found.dataset(found.shards[0])
        reads = [partial(_of_shard, found, shard) for shard in found.shards]
        sizes = [shard.steps for shard in found.shards]
    else:
        first, transitions = found, Transitions.of(found)
        reads, sizes = [lambda: transitions], [len(transitions)]
    check_spaces(first, model.observation_space, model.action_space)
    _set_statistics(model, (read().observations for read in reads))
    parts = [partial(_inputs_and_targets, model, read) for read in reads]
    return ShuffledRows(parts, sizes, buffer)


def _of_shard(corpus: RecordedCorpus, shard: Shard) -> Transitions:
    return Transitions.of(corpus.dataset(shard))


def _inputs_and_targets(model: BaseAlgorithm, read: Callable[[], Transitions]) -> Rows:
    transitions, normalizer = read(), model.get_vec_normalize_env()
    inputs: Any = transitions.observations
    if normalizer is not None and normalizer.norm_obs:
        inputs = normalizer.normalize_obs(inputs)
    targets = scaled_actions(transitions.expert_actions, model.action_space)
    return np.asarray(inputs, np.float32), np.asarray(targets, np.float32)


def _epochs(
    model: BaseAlgorithm,
    actor: torch.nn.Module,
    rows: ShuffledRows,
    epochs: int,
    batch_size: int,
    learning_rate: float,
    seed: int,
) -> Iterator[float]:
    """Train the actor and yield the mean loss of each epoch."""
    optimizer = torch.optim.Adam(actor.parameters(), learning_rate, fused=True)
    updates = epochs * math.ceil(len(rows) / batch_size)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, updates)
    random = torch.Generator().manual_seed(seed)
    for _ in range(epochs):
        total = 0.0
        for batch in rows.batches(batch_size, random):
            observations, targets = (array.to(model.device) for array in batch)
            # SB3's hook of all its policies: the action before it is scaled to the action space.
            played = model.policy._predict(observations, deterministic=True)
            loss = torch.nn.functional.mse_loss(played, targets)
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            schedule.step()
            total += loss.item() * len(targets)
        yield total / len(rows)


def _set_statistics(model: BaseAlgorithm, parts: Iterable[npt.NDArray[Any]]) -> None:
    """Set the statistics of ``VecNormalize``, if used, to those of the data."""
    normalizer = model.get_vec_normalize_env()
    if normalizer is None or not normalizer.norm_obs:
        return
    assert not isinstance(normalizer.obs_rms, dict), "observations are plain arrays"
    statistics = RunningMeanStd(epsilon=0.0, shape=normalizer.obs_rms.mean.shape)
    for part in parts:
        mean, variance = part.mean(axis=0, dtype=np.float64), part.var(axis=0, dtype=np.float64)
        statistics.update_from_moments(mean, variance, len(part))
    # What never changed in the data set must not count a thousandfold when it does.
    statistics.var = np.where(statistics.var < _CONSTANT, 1.0, statistics.var)
    normalizer.obs_rms = statistics


def _fix_exploration(actor: torch.nn.Module, log_std: float) -> None:
    layer = getattr(actor, "log_std", None)
    if isinstance(layer, torch.nn.Linear):
        with torch.no_grad():
            layer.weight.zero_()
            layer.bias.fill_(log_std)
