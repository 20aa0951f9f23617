"""The pictures of a performance, drawn afterwards from how everything moved."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass

import mujoco
import numpy as np
import numpy.typing as npt

from sb3_piano.exceptions import ConfigError
from sb3_piano.performance import Performance
from sb3_piano.simulation import PianoScene
from sb3_piano.viewing.frame_renderer import FrameRenderer

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Moment:
    """State of the scene at one time, as a picture shows it."""

    qpos: FloatArray
    """(nq,) joint positions, rad or m."""
    due: npt.NDArray[np.intp]
    """(n,) keys that should be down."""
    fingers: npt.NDArray[np.int8]
    """(n,) finger label of each of them, -1 where unknown."""
    sounding: npt.NDArray[np.bool_]
    """(88,) keys to be shown as sounding."""


def moments(
    scene: PianoScene, performance: Performance, qpos: FloatArray, *, mark_sounding: bool = True
) -> Iterator[Moment]:
    """Return the moments of a performance: its start, and the end of each control step.

    At the start the keys of the first step are due, later those of the step just played.

    Args:
        scene: The scene in which it was played.
        performance: What was played in t control steps.
        qpos: (t + 1, nq) joint positions at the start and after each control step, rad or m.
        mark_sounding: Whether keys that sound are shown as such.

    Raises:
        ConfigError: If the positions are not those of the scene and the performance.
    """
    expected = (len(performance) + 1, scene.model.nq)
    if qpos.shape != expected:
        raise ConfigError(
            f"The motion has shape {qpos.shape}: expected {expected}, the joint positions of this "
            "scene at the start and after each control step of the performance."
        )
    return _moments(scene, performance, qpos, mark_sounding)


def film(
    scene: PianoScene,
    performance: Performance,
    qpos: FloatArray,
    *,
    width: int = 640,
    height: int = 360,
    camera: str = "overview",
    mark_sounding: bool = True,
) -> Generator[npt.NDArray[np.uint8], None, None]:
    """Draw a performance as the environment's ``render`` would have drawn it at every step.

    Args:
        scene: The scene in which it was played.
        performance: What was played in t control steps; due keys have their finger's colour.
        qpos: (t + 1, nq) joint positions at the start and after each control step, rad or m.
        width: Pixels, at most 1920.
        height: Pixels, at most 1080.
        camera: "overview" or "topdown".
        mark_sounding: Whether keys that sound are green, due or not.

    Returns:
        t + 1 pictures, (height, width, 3) uint8; picture k shows time ``k * control_timestep``.

    Raises:
        ConfigError: If the positions are not those of the scene and the performance.
        RenderingError: If this machine cannot draw; the message says what to install.
    """
    seen = moments(scene, performance, qpos, mark_sounding=mark_sounding)
    renderer = FrameRenderer(scene, width=width, height=height, camera=camera)
    return _frames(scene, seen, renderer)


def pose(scene: PianoScene, data: mujoco.MjData, qpos: FloatArray) -> None:
    """Put everything in its place for joint positions, (nq,); cameras and lights too."""
    data.qpos[:] = qpos
    mujoco.mj_kinematics(scene.model, data)
    mujoco.mj_camlight(scene.model, data)


def _moments(
    scene: PianoScene, performance: Performance, qpos: FloatArray, mark_sounding: bool
) -> Iterator[Moment]:
    for k, positions in enumerate(qpos):
        due, fingers = performance.roll.due(max(k - 1, 0))
        sounding = (scene.key_angle_at(positions) >= scene.key_sounding_angle) & mark_sounding
        yield Moment(qpos=positions, due=due, fingers=fingers, sounding=sounding)


def _frames(
    scene: PianoScene, seen: Iterator[Moment], renderer: FrameRenderer
) -> Generator[npt.NDArray[np.uint8], None, None]:
    try:
        data = mujoco.MjData(scene.model)
        for moment in seen:
            pose(scene, data, moment.qpos)
            yield renderer.render(
                data, due=moment.due, fingers=moment.fingers, sounding=moment.sounding
            )
    finally:
        renderer.close()
