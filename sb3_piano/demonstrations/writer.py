"""Minari data sets that are being written.

Minari's own ``DataCollector`` is not used: it needs JAX to append numbers to lists, and records
one action a step, where there are two here, what was played and what would have been right.
"""

from __future__ import annotations

import contextlib
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from gymnasium.envs.registration import EnvSpec

from sb3_piano.demonstrations.dataset import (
    EXPERT_ACTION,
    dataset_folder,
    dataset_root,
    open_dataset,
    require_minari,
)
from sb3_piano.exceptions import ConfigError
from sb3_piano.interrupts import ctrl_c_deferred

if TYPE_CHECKING:
    from minari import MinariDataset


@dataclass(frozen=True, eq=False, kw_only=True)
class Episode:
    """An episode of T steps, to be written."""

    seed: int
    """From which seed the environment began."""
    observations: npt.NDArray[Any]
    """(T + 1, ...)"""
    actions: npt.NDArray[Any]
    """(T, ...) what was played."""
    expert_actions: npt.NDArray[Any]
    """(T, ...) what the policy would have done."""
    rewards: npt.NDArray[np.float64]
    """(T,)"""
    terminated: bool
    """Whether the episode ended; otherwise it was truncated."""
    notes: Mapping[str, float] = field(default_factory=dict)
    """Notes on it, such as ``f1``."""


class DatasetWriter:
    """Writes a data set episode by episode; it is there when :meth:`finish` returns, or not at all.

    Use it in a ``with`` statement.

    Args:
        dataset_id: What the data set is called, such as ``robopianist/twinkle/planned-v0``.
        env: The environment that is played in.
        env_spec: How to make it again.
        overwrite: Whether a data set of this name is replaced.

    Raises:
        ConfigError: If it is no valid name, or there is such a data set.
        ImportError: If Minari is not installed.
    """

    def __init__(
        self,
        dataset_id: str,
        env: gym.Env[Any, Any],
        env_spec: EnvSpec | None = None,
        *,
        overwrite: bool = False,
    ) -> None:
        require_minari()
        from minari.dataset.minari_storage import MinariStorage

        self._id = dataset_id
        self._place = dataset_folder(dataset_id)
        if self._place.exists() and not overwrite:
            raise ConfigError(
                f"There is a data set {dataset_id!r} already, in '{self._place}': expected a new "
                "name, or leave to overwrite it."
            )
        root = dataset_root()
        self._made = Path(tempfile.mkdtemp(prefix=".recording-", dir=root))
        new = self._made / "new"
        new.mkdir()
        self._storage = MinariStorage.new(
            new / "data",
            observation_space=env.observation_space,
            action_space=env.action_space,
            env_spec=env_spec,
            jpeg_encoding=False,
        )
        self._count = 0

    def __enter__(self) -> DatasetWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        shutil.rmtree(self._made, ignore_errors=True)

    def add(self, episode: Episode) -> None:
        """Write an episode."""
        from minari.data_collector.episode_buffer import EpisodeBuffer

        ends = np.zeros((2, len(episode.rewards)), dtype=bool)
        ends[0 if episode.terminated else 1, -1] = True
        labels = episode.expert_actions
        none_asked = labels[-1:] * np.nan if labels.dtype.kind == "f" else labels[-1:]
        buffer = EpisodeBuffer(
            seed=episode.seed,
            observations=episode.observations,
            actions=episode.actions,
            rewards=episode.rewards,
            terminations=ends[0],
            truncations=ends[1],
            infos={EXPERT_ACTION: np.concatenate([labels, none_asked])},
        )
        with ctrl_c_deferred():  # which would leave half an episode in the file
            self._storage.update_episodes([buffer])
            self._storage.update_episode_metadata([dict(episode.notes)], [self._count])
            self._count += 1

    def finish(self, metadata: Mapping[str, Any]) -> MinariDataset:
        """Put the data set in its place.

        Args:
            metadata: What is noted about it, in JSON's types; Minari's own names included.
        """
        import minari

        notes = {"dataset_id": self._id, "minari_version": minari.__version__, **metadata}
        self._storage.update_metadata(notes)
        _make_namespace(self._id)
        if self._place.exists():
            self._place.rename(self._made / "old")
        self._place.parent.mkdir(parents=True, exist_ok=True)
        (self._made / "new").rename(self._place)
        return open_dataset(self._id)


def _make_namespace(dataset_id: str) -> None:
    """Let Minari know the folders around a data set as what it calls namespaces."""
    from minari.namespace import create_namespace, list_local_namespaces

    namespace = dataset_id.rpartition("/")[0]
    if namespace and namespace not in list_local_namespaces():
        with contextlib.suppress(ValueError):  # another process has just made it
            create_namespace(namespace)
