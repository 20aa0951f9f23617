"""Checkpoints from which a training resumes."""

from __future__ import annotations

import dataclasses
import os
import pickle
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback

from sb3_piano.callbacks.own_env import with_nested
from sb3_piano.callbacks.replay_segments import SEGMENT_PATTERN, ReplayManifest, ReplaySegments
from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.files import read_json, write_atomically, write_bytes, write_json
from sb3_piano.links import make_folder
from sb3_piano.settings import Count, checked
from sb3_piano.unfinished import PARTIAL_SUFFIX

CHECKPOINT_FILE = "checkpoint.json"
DEFAULT_EVERY = 10_000
"""Environment steps between two checkpoints."""
SAVED_AFTER = "saved_after_timesteps"
"""Attribute of a ``VecNormalize`` in a file: the steps of the model that was saved with it."""
_PATTERNS = ("model-*.zip", "vecnormalize-*.pkl", SEGMENT_PATTERN, f"*{PARTIAL_SUFFIX}")

CallbackStates = Mapping[str, Sequence[Mapping[str, Any]]]
"""States of callbacks by the import path of their class, those of a class in their order."""


@runtime_checkable
class KeepsState(Protocol):
    """A callback with a state that checkpoints save and restore."""

    def state_dict(self) -> Mapping[str, Any]:
        """Return the state, in JSON's types."""

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restore a state; called before the training starts.

        Raises:
            ConfigError: If it is none of this class.
        """


@dataclass(frozen=True, kw_only=True)
class Checkpoint:
    """Content of ``checkpoint.json``: the files of a checkpoint and its step count."""

    num_timesteps: int
    """Environment steps of the model and the replay buffer."""
    model: str
    """Name of the model's file."""
    vec_normalize: str | None = None
    """Name of the file with the statistics of ``VecNormalize``, if the run uses it."""
    replay: ReplayManifest | None = None
    """The replay buffer, if the algorithm has one."""
    labels: Mapping[str, str] = field(default_factory=dict)
    """Identity of the run, as given to :class:`ResumableCheckpoint`."""
    callbacks: CallbackStates = field(default_factory=dict)
    """States of the callbacks given to :class:`ResumableCheckpoint`, if they have any."""

    @property
    def files(self) -> frozenset[str]:
        """Names of all files needed to resume."""
        segments = () if self.replay is None else self.replay.segments
        names = {self.model, self.vec_normalize, *(segment.file for segment in segments)}
        return frozenset(name for name in names if name is not None)

    @classmethod
    def save(
        cls,
        model: BaseAlgorithm,
        folder: Path,
        labels: Mapping[str, str],
        replay: ReplayManifest | None = None,
        callbacks: CallbackStates | None = None,
    ) -> Checkpoint:
        """Save a model beside its replay buffer as the folder's valid checkpoint."""
        steps = model.num_timesteps
        name, normalization = f"model-{steps}.zip", f"vecnormalize-{steps}.pkl"
        write_atomically(folder / name, model.save)
        normalizes = write_normalization(model, folder / normalization)
        saved = cls(
            num_timesteps=steps,
            model=name,
            vec_normalize=normalization if normalizes else None,
            replay=replay,
            labels=labels,
            callbacks=callbacks or {},
        )
        write_json(folder / CHECKPOINT_FILE, dataclasses.asdict(saved))
        return saved

    def restore_callbacks(self, callbacks: Iterable[BaseCallback]) -> None:
        """Restore the states of callbacks at any depth of nesting.

        The first callback of a class gets the first state of that class, and so on. A callback
        beyond that begins anew.

        Raises:
            RunError: If a state is damaged.
        """
        for name, several in _with_state(callbacks).items():
            for callback, state in zip(several, self.callbacks.get(name, ()), strict=False):
                try:
                    callback.load_state_dict(state)
                except ConfigError as error:
                    raise RunError(
                        f"{CHECKPOINT_FILE} has a state of {name} that is unusable: {error}"
                    ) from error

    def copy_model(self, folder: Path, copy: Path) -> None:
        """Copy the model to a path, with the statistics of ``VecNormalize`` beside it.

        What is the same already is left as it is.
        """
        copies = {self.model: copy, self.vec_normalize: copy.with_name("vecnormalize.pkl")}
        for name, path in copies.items():
            content = None if name is None else (folder / name).read_bytes()
            if content is not None and not (os.path.isfile(path) and path.read_bytes() == content):
                write_bytes(path, content)

    @classmethod
    def read(cls, folder: Path) -> Checkpoint | None:
        """Return the folder's valid checkpoint, or ``None`` if it has none.

        Raises:
            RunError: If the file is damaged, or one that it names is missing.
        """
        path = folder / CHECKPOINT_FILE
        saved = read_json(path, cls, "expected the file that ResumableCheckpoint wrote.")
        if saved is None:
            return None
        missing = sorted(name for name in saved.files if not os.path.isfile(folder / name))
        if missing:
            raise RunError(
                f"Checkpoint '{path}' names '{missing[0]}', which is not there: expected all "
                f"{len(saved.files)} of its files in one folder."
            )
        return saved


class ResumableCheckpoint(BaseCallback):
    """Save a checkpoint at fixed intervals of environment steps.

    A checkpoint has the model with its optimizers, the replay buffer (see
    :mod:`~sb3_piano.callbacks.replay_segments`), the statistics of ``VecNormalize`` and the states
    of callbacks (:class:`KeepsState`). Files get new names; replacing ``checkpoint.json`` makes
    them valid, and only then are the former ones deleted. A process killed at any time leaves a
    folder that can be resumed.

    It saves between two rollouts, when each counted step is in the replay buffer and all its
    updates are done: at the first such moment at or after each multiple of ``every``, and at the
    end.

    Args:
        folder: Where to save; created when training starts.
        every: Environment steps (over all environments together) between two checkpoints.
        model_copy: A path at which a copy of the newest model is kept, for those who only want to
            play; statistics of ``VecNormalize`` go beside it as ``vecnormalize.pkl``.
        labels: Written into the checkpoint, to recognise the run by.
        resumed: The checkpoint from which the model was restored, if it was.
        callbacks: Callbacks of the training whose states are saved.

    Raises:
        ConfigError: If ``every`` is less than 1.
        RunError: When training starts, if the replay buffer cannot be saved.
    """

    def __init__(
        self,
        folder: str | Path,
        every: int = DEFAULT_EVERY,
        *,
        model_copy: str | Path | None = None,
        labels: Mapping[str, str] | None = None,
        resumed: Checkpoint | None = None,
        callbacks: Iterable[BaseCallback] = (),
    ) -> None:
        super().__init__()
        self._folder = Path(folder)
        self._every = checked("every", every, Count)
        self._model_copy = None if model_copy is None else Path(model_copy)
        self._labels = dict(labels or {})
        self._saved_at = 0 if resumed is None else resumed.num_timesteps
        self._resumed = resumed
        self._callbacks = tuple(callbacks)
        self._segments: ReplaySegments | None = None

    def _init_callback(self) -> None:
        make_folder(self._folder)
        buffer = getattr(self.model, "replay_buffer", None)
        if buffer is not None:
            saved = None if self._resumed is None else self._resumed.replay
            self._segments = ReplaySegments(self._folder, buffer, saved)

    def _on_rollout_start(self) -> None:
        if self.model.num_timesteps // self._every > self._saved_at // self._every:
            self.save()

    def _on_step(self) -> bool:
        if self._segments is not None:
            self._segments.observe()
        return True

    def _on_training_end(self) -> None:
        self.save()

    def save(self) -> None:
        """Save now, unless no step was taken since the last checkpoint."""
        if self.model.num_timesteps == self._saved_at:
            return
        replay = None if self._segments is None else self._segments.write()
        states = {
            name: [callback.state_dict() for callback in several]
            for name, several in _with_state(self._callbacks).items()
        }
        checkpoint = Checkpoint.save(self.model, self._folder, self._labels, replay, states)
        self._saved_at = checkpoint.num_timesteps
        if self._segments is not None and replay is not None:
            self._segments.committed(replay)
        if self._model_copy is not None:
            checkpoint.copy_model(self._folder, self._model_copy)
        self._delete_all_but(checkpoint.files)

    def _delete_all_but(self, files: frozenset[str]) -> None:
        for pattern in _PATTERNS:
            for path in self._folder.glob(pattern):
                if path.name not in files:
                    path.unlink(missing_ok=True)


def _with_state(callbacks: Iterable[BaseCallback]) -> dict[str, list[KeepsState]]:
    """Return the callbacks that keep a state by the import path of their class."""
    found: dict[str, list[KeepsState]] = defaultdict(list)
    for callback in with_nested(callbacks):
        if isinstance(callback, KeepsState):
            kind = type(callback)
            found[f"{kind.__module__}.{kind.__qualname__}"].append(callback)
    return found


def write_normalization(model: BaseAlgorithm, path: Path) -> bool:
    """Write the statistics of a model's ``VecNormalize``; return whether it has one.

    The file carries the model's steps, by which two of one checkpoint are known.
    """
    normalization = model.get_vec_normalize_env()
    if normalization is not None:
        setattr(normalization, SAVED_AFTER, model.num_timesteps)
        write_atomically(path, lambda file: pickle.dump(normalization, file))
    return normalization is not None
