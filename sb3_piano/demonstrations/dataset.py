"""Minari data sets: folders, reading of transitions, and writing."""

from __future__ import annotations

import contextlib
import io
import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from gymnasium.envs.registration import EnvSpec

from sb3_piano.array_files import check_hdf5
from sb3_piano.exceptions import (
    ConfigError,
    MissingPackageError,
    SB3PianoError,
    install_command,
    one_line,
)
from sb3_piano.files import read_file, sync_folder
from sb3_piano.interrupts import ctrl_c_deferred
from sb3_piano.locks import LOCK_SUFFIX, hold
from sb3_piano.unfinished import delete_unowned, partial_folder

if TYPE_CHECKING:
    from minari import EpisodeData, MinariDataset
    from minari.data_collector.episode_buffer import EpisodeBuffer

EXPERT_ACTION = "expert_action"
"""Key in a data set's ``infos`` for the policy's own action. Row ``i`` goes with row ``i``
of the observations; the last one, in which nothing is played any more, is NaN if it can be."""


_UNFINISHED = ".recording-"
_SPARE = 2**18
"""Upper bound of an episode's bytes in an HDF5 file beside its arrays."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Transitions:
    """All transitions of a data set, in order."""

    observations: npt.NDArray[Any]
    """(N, ...)"""
    next_observations: npt.NDArray[Any]
    """(N, ...)"""
    actions: npt.NDArray[Any]
    """(N, ...) played actions."""
    expert_actions: npt.NDArray[Any]
    """(N, ...) the policy's own actions; the played ones if the data set has none."""
    rewards: npt.NDArray[np.float64]
    """(N,)"""
    terminations: npt.NDArray[np.bool_]
    """(N,)"""
    truncations: npt.NDArray[np.bool_]
    """(N,)"""

    def __len__(self) -> int:
        return len(self.rewards)

    @classmethod
    def of(cls, dataset: MinariDataset | str) -> Transitions:
        """Read the transitions of a data set, given or by name.

        Raises:
            ConfigError: If there is none, it is damaged or empty, or its observations or actions
                are no plain arrays.
        """
        dataset = open_dataset(dataset)
        for space in (dataset.observation_space, dataset.action_space):
            if not isinstance(space, gym.spaces.Box):
                raise ConfigError(
                    f"Data set {dataset.id!r} has the space {space}: expected a Box, of "
                    "observations and of actions."
                )
        with reading(dataset.id, Path(dataset.storage.data_path).parent):
            episodes = list(dataset.iterate_episodes())
            for episode in episodes:
                _check_rows(dataset, episode)
        if not episodes:
            raise ConfigError(f"Data set {dataset.id!r} is empty: expected at least one episode.")
        parts = {
            "observations": [e.observations[:-1] for e in episodes],
            "next_observations": [e.observations[1:] for e in episodes],
            "expert_actions": [_expert_actions(e) for e in episodes],
            **{
                name: [getattr(e, name) for e in episodes]
                for name in ("actions", "rewards", "terminations", "truncations")
            },
        }
        return cls(**{name: np.concatenate(arrays) for name, arrays in parts.items()})


def open_dataset(dataset: MinariDataset | str, root: Path | None = None) -> MinariDataset:
    """Open a data set by name in the folder ``root``; return an open one unchanged.

    Raises:
        ConfigError: If there is none of that name, or it cannot be read.
        MissingPackageError: If Minari is not installed.
    """
    if not isinstance(dataset, str):
        return dataset
    require_minari()
    import minari

    place = dataset_folder(dataset, root)
    if not os.path.isdir(place):
        known = "" if root else f" ({', '.join(minari.list_local_datasets()) or 'none'})"
        raise ConfigError(
            f"There is no data set {dataset!r} in '{root or dataset_root()}': expected one of "
            f"those there{known}; 'sb3-piano record' writes one."
        )
    with reading(dataset, place):
        _check_claims(place / "data")
        return minari.MinariDataset(place / "data")


def _check_claims(folder: Path) -> None:
    """Raise an error if a data set claims more episodes than its files hold."""
    claimed = json.loads(read_file(folder / "metadata.json"))["total_episodes"]
    file = folder / "main_data.hdf5"
    episodes = check_hdf5(file) if os.path.exists(file) else len(os.listdir(folder))
    if claimed > episodes:
        raise ValueError(f"it has {episodes} episodes, not {claimed} as its metadata.json says")


@contextlib.contextmanager
def reading(dataset_id: str, place: Path | None = None) -> Iterator[None]:
    """Re-raise errors of Minari and HDF5 with the name and folder of the data set.

    Raises:
        ConfigError: In place of any error in the block that is none of this package's.
    """
    try:
        yield
    except SB3PianoError:  # the environment's own, which says enough
        raise
    except Exception as error:
        raise ConfigError(
            f"Data set {dataset_id!r} in '{place or dataset_folder(dataset_id)}' cannot be read "
            f"({one_line(error)}): expected what Minari wrote."
        ) from error


def _check_rows(dataset: MinariDataset, episode: EpisodeData) -> None:
    """Raise an error unless an episode's arrays are numbers with equal rows."""
    steps = len(episode.rewards)
    for name, array, shape in (
        ("observations", episode.observations, (steps + 1, *dataset.observation_space.shape)),
        ("actions", episode.actions, (steps, *dataset.action_space.shape)),
        ("rewards", episode.rewards, (steps,)),
        (EXPERT_ACTION, _expert_actions(episode), (steps, *dataset.action_space.shape)),
        ("terminations", episode.terminations, (steps,)),
        ("truncations", episode.truncations, (steps,)),
    ):
        if np.shape(array) != shape:
            raise ValueError(
                f"{name} of episode {episode.id} have the shape {np.shape(array)}, not {shape}"
            )
        if np.asarray(array).dtype.kind not in "biuf":
            raise ValueError(f"{name} of episode {episode.id} are no numbers")


def dataset_root() -> Path:
    """Return the folder of all data sets: MINARI_DATASETS_PATH, or Minari's default."""
    from minari.storage import get_dataset_path

    return get_dataset_path()


def dataset_folder(dataset_id: str, root: Path | None = None) -> Path:
    """Return the folder of a data set, which need not exist.

    Raises:
        ConfigError: If it is no valid name.
    """
    from minari.dataset.minari_dataset import DATASET_ID_RE

    match = DATASET_ID_RE.fullmatch(dataset_id)
    if match is None or match["version"] is None:
        raise ConfigError(
            f"Data set name {dataset_id!r} is not valid: expected letters, digits, - and _ in "
            "parts divided by /, two or more before the last one, and a version at the end, such "
            "as robopianist/twinkle/planned-v0."
        )
    return (root or dataset_root()) / dataset_id


def require_minari() -> None:
    """Raise an ImportError with the install command if Minari is missing.

    Raises:
        MissingPackageError: If Minari, or the library for its files, cannot be imported.
    """
    try:
        import h5py  # noqa: F401
        import minari  # noqa: F401
    except ImportError as error:
        raise MissingPackageError(
            "Data sets need the packages minari and h5py, which are not both installed: "
            f"{install_command('demonstrations')}"
        ) from error


def _expert_actions(episode: EpisodeData) -> npt.NDArray[Any]:
    labels = (episode.infos or {}).get(EXPERT_ACTION)
    return episode.actions if labels is None else np.asarray(labels)[:-1]


class DatasetWriter:
    """Write a data set episode by episode; :meth:`finish` puts it in place as a whole.

    Minari's own ``DataCollector`` is not used: it needs JAX to append numbers to lists, and records
    one action a step, where there are two here, what was played and what would have been right. Use
    it in a ``with`` statement.

    Args:
        dataset_id: Name of the data set, such as ``robopianist/twinkle/planned-v0``.
        env: The recorded environment.
        env_spec: Spec to make it again.
        overwrite: Whether a data set of this name is replaced.
        root: An existing folder for it; by default that of :func:`dataset_root`.

    Raises:
        ConfigError: If it is no valid name, or there is such a data set.
        MissingPackageError: If Minari is not installed.
        RunError: If another process records it, or the folder cannot be written.
    """

    def __init__(
        self,
        dataset_id: str,
        env: gym.Env[Any, Any],
        env_spec: EnvSpec | None = None,
        *,
        overwrite: bool = False,
        root: Path | None = None,
    ) -> None:
        require_minari()
        from minari.dataset.minari_storage import MinariStorage

        self._id, self._root = dataset_id, root
        self._place = dataset_folder(dataset_id, root)
        place = root or dataset_root()
        with contextlib.ExitStack() as held:
            if not overwrite:
                lock = place / f".{dataset_id.replace('/', '-')}{LOCK_SUFFIX}"
                busy = f"A data set {dataset_id!r} is being recorded"
                held.enter_context(hold(lock, busy, "a new name, or to wait for it."))
            if self._place.exists() and not overwrite:
                raise ConfigError(
                    f"There is a data set {dataset_id!r} already, in '{self._place}': expected a "
                    "new name, or overwrite=True (--overwrite)."
                )
            self._made = held.enter_context(partial_folder(place, _UNFINISHED))
            new = self._made / "new"
            new.mkdir()
            self._storage = MinariStorage.new(
                new / "data",
                observation_space=env.observation_space,
                action_space=env.action_space,
                env_spec=env_spec,
                jpeg_encoding=False,
            )
            (self._file,) = (new / "data").glob("*.hdf5")
            self._file.write_bytes(_empty_file())
            self._held = held.pop_all()
        self._count = 0

    def __enter__(self) -> DatasetWriter:
        return self

    def __exit__(self, *error: object) -> None:
        self._held.close()

    def add(self, episode: EpisodeBuffer, notes: Mapping[str, float]) -> None:
        """Write an episode and its notes, such as ``f1``.

        Raises:
            OSError: If the disk is full.
        """
        names = ("observations", "actions", "rewards", "terminations", "truncations")
        arrays = [*(getattr(episode, name) for name in names), *(episode.infos or {}).values()]
        with ctrl_c_deferred():  # which would leave half an episode in the file
            self._reserve(sum(np.asarray(array).nbytes for array in arrays))
            self._storage.update_episodes([episode])
            self._reserve(0)
            self._storage.update_episode_metadata([dict(notes)], [self._count])
            self._count += 1

    def _reserve(self, size: int) -> None:
        """Reserve disk space for arrays, as HDF5 ends the process on a full disk."""
        if hasattr(os, "posix_fallocate"):
            with self._file.open("r+b") as file:
                end = file.seek(0, os.SEEK_END)
                # Chunks of an array are whole; HDF5 gives back what it does not take.
                os.posix_fallocate(file.fileno(), end, 2 * size + _SPARE)

    def finish(self, metadata: Mapping[str, Any]) -> MinariDataset:
        """Move the data set to its final folder; its notes have JSON's types."""
        import minari

        notes = {"dataset_id": self._id, "minari_version": minari.__version__, **metadata}
        self._storage.update_metadata(notes)
        if self._root is None:
            _make_namespace(self._id)
        self._place.parent.mkdir(parents=True, exist_ok=True)
        for path in (self._made / "new").rglob("*"):
            sync_folder(path)  # or file
        # Ctrl-C between the two would leave neither: both are in the folder that __exit__ deletes.
        with ctrl_c_deferred():
            if self._place.exists():
                self._place.rename(self._made / "old")
            (self._made / "new").rename(self._place)
        sync_folder(self._place.parent)
        return open_dataset(self._id, self._root)


def forget_unfinished(root: Path) -> None:
    """Delete unfinished data sets of killed processes."""
    delete_unowned(root.glob(f"{_UNFINISHED}*"))


def _empty_file() -> bytes:
    """Return an empty HDF5 file, as HDF5 cannot read an empty file that was extended."""
    import h5py

    content = io.BytesIO()
    h5py.File(content, "w", track_order=True).close()
    return content.getvalue()


def _make_namespace(dataset_id: str) -> None:
    """Register the folders around a data set as Minari's namespaces."""
    from minari.namespace import create_namespace, list_local_namespaces

    namespace = dataset_id.rpartition("/")[0]
    if namespace and namespace not in list_local_namespaces():
        with contextlib.suppress(ValueError):  # another process has just made it
            create_namespace(namespace)
