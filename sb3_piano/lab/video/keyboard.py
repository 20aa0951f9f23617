"""The keyboard in a picture: a homography between pixels and the plane of the keys.

The plane's coordinates are ``u`` along the keyboard, in widths of white keys from the left edge of
A0 (0) to the right edge of C8 (52), and ``v`` across it, from the keys' front edge (0) to their
back (1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from sb3_piano.arrays import FloatArray
from sb3_piano.exceptions import ConfigError, MissingPackageError, install_command
from sb3_piano.music.constants import KEY_IS_BLACK, NUM_KEYS
from sb3_piano.viewing.video import Frame

# A white key begins where those before it end, and a black one is in the middle of such a place.
CENTERS: FloatArray = np.cumsum(~KEY_IS_BLACK) - np.where(KEY_IS_BLACK, 0.0, 0.5)
"""(88,) u of the keys' middles."""

KEY_LENGTH = 6.4
"""Length of a white key in widths of a white key: 150 and 23.5 mm."""

BLACK_FRONT = 0.38
"""v of the black keys' front; between 0.36 and 0.40 on most pianos."""

_ENOUGH_KEYS = 15  # black keys of three octaves
_FIT = 0.2  # key widths: a black key further from its place does not fit


def import_cv2() -> Any:
    """Import OpenCV.

    Raises:
        MissingPackageError: If it is not installed.
    """
    try:
        import cv2
    except ImportError as error:
        raise MissingPackageError(
            f"Fingering from video needs OpenCV: {install_command('video-fingering')}"
        ) from error
    return cv2


@dataclass(frozen=True, eq=False)
class KeyboardPlane:
    """Homography from pixels to the plane of the keys."""

    matrix: FloatArray
    """(3, 3) maps homogeneous pixels to homogeneous (u, v)."""

    @classmethod
    def of_corners(
        cls, corners: Sequence[Sequence[float]], first: int = 0, last: int = NUM_KEYS - 1
    ) -> KeyboardPlane:
        """Compute the plane from four corners of the keys in a picture.

        Args:
            corners: (4, 2) pixels: front left, front right, back right and back left, as the
                pianist sees them.
            first: The key (0 to 87) whose left edge is between the left corners.
            last: The key whose right edge is between the right corners.

        Raises:
            ConfigError: If the corners are not a convex quadrangle in this order, or a key is none
                or black.
        """
        points = np.asarray(corners, dtype=float)
        for key in (first, last):
            if not 0 <= key < NUM_KEYS or KEY_IS_BLACK[key]:
                raise ConfigError(
                    f"The keyboard is said to end with key {key}: expected white keys of 0 to 87."
                )
        if points.shape != (4, 2) or not np.isfinite(points).all():
            raise ConfigError(f"Corners {points.tolist()}: expected four pairs of pixels.")
        sides = np.roll(points, -1, axis=0) - points
        after = np.roll(sides, -1, axis=0)
        turns = sides[:, 0] * after[:, 1] - sides[:, 1] * after[:, 0]
        if first >= last or not (np.all(turns > 1) or np.all(turns < -1)):
            raise ConfigError(
                f"Corners {points.tolist()} are no quadrangle: expected front left, front right, "
                "back right and back left of the keys, in pixels."
            )
        low, high = CENTERS[first] - 0.5, CENTERS[last] + 0.5
        plane = np.array([(low, 0), (high, 0), (high, 1), (low, 1)], dtype=np.float32)
        return cls(import_cv2().getPerspectiveTransform(points.astype(np.float32), plane))

    def to_keys(self, points: npt.ArrayLike) -> FloatArray:
        """Map (..., 2) pixels to (..., 2) coordinates u and v."""
        return _mapped(self.matrix, np.asarray(points, dtype=float))

    def to_pixels(self, places: npt.ArrayLike) -> FloatArray:
        """Map (..., 2) coordinates u and v to (..., 2) pixels."""
        return _mapped(np.linalg.inv(self.matrix).astype(float), np.asarray(places, dtype=float))

    def outline(self, key: int) -> FloatArray:
        """Return the (4, 2) corners of a key (0 to 87) in pixels."""
        half, front = (0.29, BLACK_FRONT) if KEY_IS_BLACK[key] else (0.5, 0.0)
        u = CENTERS[key]
        return self.to_pixels(
            [(u - half, front), (u + half, front), (u + half, 1.0), (u - half, 1.0)]
        )


def _mapped(matrix: FloatArray, points: FloatArray) -> FloatArray:
    raised = np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1) @ matrix.T
    return raised[..., :2] / raised[..., 2:]


def find_keyboard(picture: Frame) -> KeyboardPlane:
    """Find the keyboard by its black keys.

    A line of pixels that crosses the black keys is dark 36 times. The gaps between the groups of
    two and three say which keys they are. The keyboard may be turned by up to 10 degrees.

    Args:
        picture: (height, width, 3) RGB; best the median of many pictures, which has no hands.

    Raises:
        ConfigError: If no keyboard is found, or it is not sure which of its keys are in view.
    """
    cv2 = import_cv2()
    grey = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY).astype(float)
    height, width = grey.shape
    best = _NO_FIT
    for angle in (0, -3, 3, -6, 6, -9, 9):
        if len(best.keys) == np.count_nonzero(KEY_IS_BLACK):
            break
        turn = cv2.getRotationMatrix2D((width / 2, height / 2), angle, 1.0)
        turned = cv2.warpAffine(grey, turn, (width, height), borderValue=0)
        fits = [_fit_line(turned, y) for y in range(2, height - 2, max(height // 120, 1))]
        found = max(fits, key=lambda fit: len(fit.keys))
        if len(found.keys) > len(best.keys) + 1:
            best, upright = replace(found, turn=np.vstack([turn, (0, 0, 1)])), turned
    if len(best.keys) < _ENOUGH_KEYS:
        raise ConfigError(
            f"No keyboard is found: only {len(best.keys)} black keys are in a line, expected "
            f"{_ENOUGH_KEYS} or more, seen from above. Give its corners with --corners."
        )
    if best.ambiguous:
        raise ConfigError(
            f"{len(best.keys)} black keys are found, but they fit several octaves: expected all 88 "
            "keys in view. Give the corners with --corners and the keys between with --keys."
        )
    pixels, places = _ends(upright, best)
    scale = np.array([1.0, KEY_LENGTH])  # so that errors along and across the keys count alike
    matrix, _ = cv2.findHomography(pixels, places * scale, cv2.RANSAC, _FIT)
    matrix = np.diag([1.0, 1 / KEY_LENGTH, 1.0]) @ matrix
    return KeyboardPlane(matrix @ best.turn)


@dataclass(frozen=True, eq=False)
class _Fit:
    """The black keys that a line of pixels crosses."""

    x: FloatArray
    """(n,) middles of dark runs, pixels."""
    keys: npt.NDArray[np.int_]
    """(n,) their keys, 0 to 87."""
    y: int
    """The line."""
    ambiguous: bool
    """Whether they may be other keys, octaves away."""
    turn: FloatArray
    """(3, 3) turn of the picture before."""


_NO_TURN = np.eye(3)
_NO_FIT = _Fit(np.empty(0), np.empty(0, int), 0, False, _NO_TURN)
_BLACK_U = CENTERS[KEY_IS_BLACK].astype(int)
_LAST_BLACK = int(_BLACK_U[-1])


def _fit_line(grey: FloatArray, y: int) -> _Fit:
    """Match the dark runs of a line of pixels with black keys."""
    line = grey[y - 1 : y + 2].mean(axis=0)
    bright = np.percentile(line, 80)
    if bright < 60:
        return _NO_FIT
    edges = np.diff(np.concatenate([[0], (line < 0.55 * bright).astype(int), [0]]))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    lengths = ends - starts
    usual = np.median(lengths[lengths >= 2]) if (lengths >= 2).any() else 0
    alike = (lengths >= max(0.5 * usual, 2)) & (lengths <= 2 * usual)
    x = ((starts + ends - 1) / 2)[alike]
    if not _ENOUGH_KEYS <= len(x) <= 60:
        return _NO_FIT
    # A gap is one or two widths of a white key, or more where a key is hidden. Its neighbours tell
    # how long a width is there.
    gaps = np.diff(x)
    unit = np.array([gaps[max(k - 2, 0) : k + 3].min() for k in range(len(gaps))])
    u = np.concatenate([[0], np.cumsum(np.round(gaps / unit))]).astype(int)
    places = [s for s in range(1, _LAST_BLACK + 1 - u[-1]) if np.isin(u + s, _BLACK_U).all()]
    if not places:
        return _NO_FIT
    u += places[0]
    # Along a line, a perspective view is a fraction of linear functions.
    equations = np.stack([x, np.ones_like(x), -u * x], axis=1)
    (a, b, c), *_ = np.linalg.lstsq(equations, u, rcond=None)
    if np.abs((a * x + b) / (1 + c * x) - u).max() > _FIT:
        return _NO_FIT
    return _Fit(
        x, np.flatnonzero(KEY_IS_BLACK)[np.searchsorted(_BLACK_U, u)], y, len(places) > 1, _NO_TURN
    )


def _ends(grey: FloatArray, fit: _Fit) -> tuple[FloatArray, FloatArray]:
    """Return pixels of the black keys' fronts and of backs between them, and their u and v."""
    between, u = (fit.x[:-1] + fit.x[1:]) / 2, CENTERS[fit.keys]
    bright = np.median([grey[fit.y, round(x)] for x in between])
    half = max(round(float(np.diff(fit.x).min()) * 0.25), 1)

    def travel(x: float, step: int, dark: bool) -> tuple[float, float]:
        y = fit.y
        while 0 <= y + step < len(grey):
            y += step
            columns = np.arange(max(round(x) - half, 0), min(round(x) + half + 1, grey.shape[1]))
            alike = columns[(grey[y, columns] < 0.6 * bright) == dark]
            if 2 * len(alike) < len(columns):
                break
            x = alike.mean() if len(alike) < len(columns) else x  # keys may lean in the picture
        return float(x), float(y)

    pixels = [travel(x, 1, dark=True) for x in fit.x] + [travel(x, -1, dark=False) for x in between]
    places = [(each, BLACK_FRONT) for each in u] + [(each, 1.0) for each in (u[:-1] + u[1:]) / 2]
    return np.array(pixels), np.array(places)
