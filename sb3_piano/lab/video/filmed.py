"""Landmarks of our own players as a camera would see them: a truth for fingering from video."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Lt

from sb3_piano.arrays import FloatArray
from sb3_piano.lab.video.landmarks import N_POINTS, TIPS, Landmarks
from sb3_piano.music import MIN_PITCH, Note, Score
from sb3_piano.settings import NotNegative, Number, Positive, Share, Whole, settings
from sb3_piano.take import Take


@settings
class Camera:
    """A camera over the keyboard, and what a detector makes of its pictures.

    Raises:
        ConfigError: If a value is out of range.
    """

    height: Positive = 1.2
    """Height over the keys, m."""
    tilt: Annotated[Number, Ge(0), Lt(80)] = 15.0
    """Angle between its view and straight down, degrees; it stands on the pianist's side."""
    field: Annotated[Number, Gt(10), Lt(120)] = 60.0
    """Width of its view, degrees."""
    width: Annotated[Whole, Ge(64)] = 1280
    """Pixels."""
    rate: Positive = 30.0
    """Pictures a second."""
    distortion: Annotated[Number, Ge(-0.3), Lt(0.3)] = 0.0
    """Radial distortion of the lens: ``r (1 + k r^2)`` with r = 1 at the picture's left edge."""
    noise: NotNegative = 0.0
    """Standard deviation of a fingertip's error along each axis, mm on the keys, new each time."""
    jitter: NotNegative = 0.0
    """The same of errors that last: they change over half a second."""
    dropout: Share = 0.0
    """Share of the pictures in which a hand is not found."""


def filmed_landmarks(take: Take, camera: Camera, seed: int = 0) -> Landmarks:
    """Project the fingertips of a take into a camera's pictures.

    Fingertips between control steps are interpolated. Other points of the hands are not seen.

    Raises:
        RunError: If the take is of no piano.
    """
    generator = np.random.default_rng(seed)
    period = take.piano.roll.control_timestep
    assert take.motion is not None, "a piano's take has one"
    tips = take.motion.fingertips
    time = np.arange(0.0, (len(tips) - 1) * period, 1 / camera.rate)
    step = np.minimum((time / period).astype(int), len(tips) - 2)
    part = (time / period - step)[:, None, None]
    world = tips[step] * (1 - part) + tips[step + 1] * part  # (T, 10, 3)
    mm = camera.noise * generator.standard_normal((len(time), 10, 2))
    mm += camera.jitter * _slow(generator, len(time), 0.5 * camera.rate)
    world[..., :2] += mm / 1000
    pixels = project(world, camera)
    points = np.full((len(time), 2, N_POINTS, 2), np.nan)
    points[:, :, list(TIPS)] = pixels.reshape(len(time), 2, 5, 2)
    confidence = np.where(generator.random((len(time), 2)) < camera.dropout, 0.0, 1.0)
    points[confidence == 0] = np.nan
    return Landmarks(time, points, confidence)


def _slow(generator: np.random.Generator, n: int, lasts: float) -> FloatArray:
    """Return (n, 10, 2) standard normal numbers that change over ``lasts`` pictures."""
    keep = math.exp(-1 / lasts)
    numbers = generator.standard_normal((n, 10, 2))
    for k in range(1, n):
        numbers[k] = keep * numbers[k - 1] + math.sqrt(1 - keep**2) * numbers[k]
    return numbers


def project(world: FloatArray, camera: Camera) -> FloatArray:
    """Project (..., 3) points of the scene, m, to (..., 2) pixels of a camera."""
    tilt = math.radians(camera.tilt)
    target = np.array([0.0, 0.0, 0.02])
    # The scene's x points from the keys to the pianist, its y along them, its z up.
    back = np.array([math.sin(tilt), 0.0, math.cos(tilt)])  # from the keys to the camera
    eye = target + back * camera.height / math.cos(tilt)
    right, up = np.array([0.0, 1.0, 0.0]), np.array([-math.cos(tilt), 0.0, math.sin(tilt)])
    ray = world - eye
    depth = -(ray @ back)
    flat = np.stack([ray @ right, ray @ up], axis=-1) / depth[..., None]
    flat = flat / math.tan(math.radians(camera.field / 2))  # 1 at the left and right edge
    flat = flat * (1 + camera.distortion * (flat**2).sum(axis=-1, keepdims=True))
    half = camera.width / 2
    return np.stack([half * (1 + flat[..., 0]), half * (0.5625 - flat[..., 1])], axis=-1)


def corners(camera: Camera) -> FloatArray:
    """Return the four corners of the keys, (4, 2) pixels, front left first."""
    return project(_CORNERS, camera)


def played_score(take: Take) -> Score:
    """Return the notes that were struck, each with the finger that was nearest to its key."""
    played = take.piano
    presses = played.presses
    notes = [
        Note(
            onset=float(struck),
            offset=max(float(released), float(struck) + 0.01),
            pitch=MIN_PITCH + int(key),
            finger=int(played.press_finger[first, key]),
        )
        for struck, released, key, first in zip(
            played.strike_time, played.release_time, presses.key, presses.first, strict=True
        )
    ]
    return Score(notes=notes, title=take.title)


_CORNERS = np.array(
    [
        (0.075, -0.611, 0.0225),
        (0.075, 0.611, 0.0225),
        (-0.075, 0.611, 0.0225),
        (-0.075, -0.611, 0.0225),
    ]
)
"""The keys' corners in the scene, m: front left, front right, back right, back left."""
