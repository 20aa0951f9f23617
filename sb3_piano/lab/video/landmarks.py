"""Landmarks of hands in a video, and the file that holds them.

Any detector may write the file: the package's :mod:`~sb3_piano.lab.video.detect_hands` runs
MediaPipe, which needs an environment of its own.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from sb3_piano.array_files import read_arrays
from sb3_piano.arrays import FloatArray
from sb3_piano.exceptions import ConfigError, one_line
from sb3_piano.files import write_atomically

TIPS = (4, 8, 12, 16, 20)
"""MediaPipe's numbers of the fingertips, thumb to little finger."""

N_POINTS = 21
"""Points of a hand."""

_EXPECTED = (
    "expected an .npz file with the arrays time (T,), points (T, 2, 21, 2) and confidence (T, 2)"
)


@dataclass(frozen=True, eq=False)
class Landmarks:
    """Points of the right (0) and left (1) hand in T pictures of a video."""

    time: FloatArray
    """(T,) time of each picture, s; growing, at any distance."""
    points: FloatArray
    """(T, 2, 21, 2) pixels, in MediaPipe's order; NaN where a point is not seen."""
    confidence: FloatArray
    """(T, 2) how sure the detector is of a hand, 0 to 1; 0 where it is not seen."""

    def check(self) -> None:
        """Check that the arrays fit together and show a hand.

        Raises:
            ConfigError: If they do not, or no hand is ever seen.
        """
        n = len(self.time) if self.time.ndim == 1 else 0
        if n == 0 or self.points.shape != (n, 2, N_POINTS, 2) or self.confidence.shape != (n, 2):
            raise ConfigError(
                f"Landmarks have shapes {self.time.shape}, {self.points.shape} and "
                f"{self.confidence.shape}: {_EXPECTED}."
            )
        if not np.isfinite(self.time).all() or (np.diff(self.time) <= 0).any():
            raise ConfigError(
                "Times of landmarks do not grow: expected those of a video's pictures."
            )
        if not ((self.confidence >= 0) & (self.confidence <= 1)).all():
            raise ConfigError("A confidence of the landmarks is out of range: expected 0 to 1.")
        if not self.seen.any():
            raise ConfigError(
                f"No hand is found in {n} pictures: expected a video of both hands from above, in "
                "good light, or landmarks of another detector."
            )

    @property
    def seen(self) -> FloatArray:
        """(2,) share of the pictures in which each hand is seen."""
        tips = np.isfinite(self.points[:, :, list(TIPS)]).all(axis=-1).any(axis=-1)
        return (tips & (self.confidence > 0)).mean(axis=0)

    def tips(self) -> FloatArray:
        """Return the fingertips in the order of finger labels, (T, 10, 2) pixels."""
        return self.points[:, :, list(TIPS)].reshape(len(self.time), 10, 2)

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the file; an existing one is replaced.

        Raises:
            OSError: If it cannot be written.
        """
        write_atomically(Path(path), lambda file: np.savez_compressed(file, **vars(self)))

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Landmarks:
        """Read a file of landmarks.

        Raises:
            ConfigError: If there is none, it is damaged, or its arrays do not fit.
        """
        try:
            arrays = read_arrays(path, [one.name for one in fields(cls)])
            found = cls(**{name: np.asarray(a, dtype=float) for name, a in arrays.items()})
        except Exception as error:  # zipfile and NumPy raise any error for a damaged archive
            said = one_line(error).rstrip(".")
            raise ConfigError(f"'{path}' has no landmarks: {said}; {_EXPECTED}.") from error
        found.check()
        return found
