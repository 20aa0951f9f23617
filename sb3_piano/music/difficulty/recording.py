"""The file of a recorded performance: everything that moved, as a NumPy archive.

An ``.npz`` file with these arrays, for an episode of T control steps:

- ``title``: what the piece is called, text;
- ``actions`` (T, n) float32: what was done in each step, in the environment's action space;
- ``qpos`` (T + 1, nq) float64: all joint positions at the start and after each step, rad or m;
- ``hand_qpos`` (m,) int: where in a row of ``qpos`` the hands' joints stand (the others are keys);
- ``fingertips`` (T + 1, 10, 3) float64: world positions of the fingertips at the same times, in the
  order of finger labels, m.

``sb3-piano evaluate RUN --motion`` writes them.
"""

from __future__ import annotations

import os
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from sb3_piano.exceptions import ConfigError
from sb3_piano.files import write_atomically
from sb3_piano.music.difficulty.motion import MotionFeatures, motion_features

_ARRAYS = ("title", "actions", "qpos", "hand_qpos", "fingertips")


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionRecording:
    """A recorded performance; the arrays are those of the file."""

    title: str
    actions: npt.NDArray[np.float32]
    qpos: npt.NDArray[np.float64]
    hand_qpos: npt.NDArray[np.intp]
    fingertips: npt.NDArray[np.float64]

    def features(self) -> MotionFeatures:
        """Return how much moved.

        Raises:
            ConfigError: If the arrays do not fit together.
        """
        if self.qpos.ndim != 2 or not _points_into(self.hand_qpos, self.qpos.shape[1]):
            raise ConfigError(
                f"The hands' joints {self.hand_qpos} are not all in joint positions of shape "
                f"{self.qpos.shape}: expected indices of its columns."
            )
        return motion_features(self.actions, self.qpos[:, self.hand_qpos], self.fingertips)


def write_motion(recording: MotionRecording, path: str | os.PathLike[str]) -> None:
    """Write a recorded performance, whole or not at all.

    Raises:
        ConfigError: If the file cannot be written.
    """
    path = Path(path)
    arrays: dict[str, Any] = {name: getattr(recording, name) for name in _ARRAYS}
    try:
        write_atomically(path, lambda file: np.savez_compressed(file, **arrays))
    except OSError as error:
        raise ConfigError(
            f"Cannot write {str(path)!r}: {error.strerror}; expected a file in a writable folder."
        ) from error


def read_motion(path: str | os.PathLike[str]) -> MotionRecording:
    """Read a recorded performance.

    Raises:
        ConfigError: If there is no such file, or it is no such recording.
    """
    path = Path(path)
    if not path.is_file():
        raise ConfigError(f"There is no recording {str(path)!r}: expected an existing .npz file.")
    try:
        with np.load(path, allow_pickle=False) as content:
            arrays = {name: content[name] for name in _ARRAYS}
    except (OSError, ValueError, KeyError, EOFError, TypeError, zipfile.BadZipFile) as error:
        raise _no_recording(path, str(error)) from error
    if arrays["title"].ndim != 0 or arrays["title"].dtype.kind != "U":
        raise _no_recording(path, "its title is no text")
    recording = MotionRecording(**{**arrays, "title": str(arrays["title"])})
    try:
        recording.features()
    except (ConfigError, TypeError) as error:
        raise _no_recording(path, str(error)) from error
    return recording


def _points_into(addresses: npt.NDArray[np.intp], width: int) -> bool:
    if addresses.ndim != 1 or addresses.dtype.kind not in "iu" or addresses.size == 0:
        return False
    return bool(addresses.min() >= 0 and addresses.max() < width)


def _no_recording(path: Path, reason: str) -> ConfigError:
    return ConfigError(
        f"{str(path)!r} is no recording of a performance: {reason}. Expected a file that "
        "'sb3-piano evaluate RUN --motion' wrote."
    )
