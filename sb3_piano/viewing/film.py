"""A take: a performance with its motion, and its pictures, drawn afterwards from how all moved."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass
from typing import Annotated, Literal

import mujoco
import numpy as np
import numpy.typing as npt
from annotated_types import Ge, Le, MultipleOf

from sb3_piano.exceptions import ConfigError
from sb3_piano.music import Score
from sb3_piano.performance import Performance
from sb3_piano.settings import Unit, Whole, settings
from sb3_piano.simulation import PianoScene
from sb3_piano.viewing.frame_renderer import FrameRenderer

FloatArray = npt.NDArray[np.float64]

Camera = Literal["overview", "topdown"]
"""Name of a camera of the scene."""

_EVEN = Unit("pixels, even as the video's format demands")


@settings
class Picture:
    """Size and camera of a video.

    Raises:
        ConfigError: If a value is out of range.
    """

    width: Annotated[Whole, Ge(2), Le(1920), MultipleOf(2), _EVEN] = 640
    """Pixels, even, at most 1920."""
    height: Annotated[Whole, Ge(2), Le(1080), MultipleOf(2), _EVEN] = 360
    """Pixels, even, at most 1080."""
    camera: Camera = "overview"
    """Camera of the scene: "overview" or "topdown"."""


DEFAULT_PICTURE = Picture()
"""A small video from behind the keyboard."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Take:
    """A performance with all that is needed to hear and see it.

    Raises:
        ConfigError: If the positions are not those of the scene and the performance.
    """

    scene: PianoScene
    """The scene in which it was played."""
    performance: Performance
    """The performance, of t control steps, with the roll that should have been played."""
    qpos: FloatArray
    """(t + 1, nq) joint positions at the start and after each control step, rad or m."""
    score: Score | None
    """The notes that are heard; ``None`` if no key was pressed."""
    mark_sounding: bool = True
    """Whether keys that sound are green in pictures."""

    def __post_init__(self) -> None:
        expected = (len(self.performance) + 1, self.scene.model.nq)
        if self.qpos.shape != expected:
            raise ConfigError(
                f"The motion has shape {self.qpos.shape}: expected {expected}, the joint positions "
                "of this scene at the start and after each control step of the performance."
            )

    @classmethod
    def of(cls, scene: PianoScene, performance: Performance, qpos: FloatArray) -> Take:
        """Return a take of what was really played."""
        return cls(scene=scene, performance=performance, qpos=qpos, score=performance.to_score())

    @property
    def period(self) -> float:
        """Time from one picture to the next, s."""
        return self.performance.roll.control_timestep

    @property
    def duration(self) -> float:
        """Duration of its pictures, s."""
        return len(self.qpos) * self.period


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


def moments(take: Take) -> Iterator[Moment]:
    """Return the moments of a take: its start, and the end of each control step.

    At the start the keys of the first step are due, later those of the step just played.
    """
    scene, roll = take.scene, take.performance.roll
    for k, positions in enumerate(take.qpos):
        due, fingers = roll.due(max(k - 1, 0))
        sounding = scene.key_angle_at(positions) >= scene.key_sounding_angle
        sounding &= take.mark_sounding
        yield Moment(qpos=positions, due=due, fingers=fingers, sounding=sounding)


def film(
    take: Take, picture: Picture = DEFAULT_PICTURE
) -> Generator[npt.NDArray[np.uint8], None, None]:
    """Draw a take as the environment's ``render`` would have drawn it at every step.

    Returns:
        t + 1 pictures, (height, width, 3) uint8; picture k shows time ``k * take.period``.

    Raises:
        RenderingError: If this machine cannot draw; the message says what to install.
    """
    scene = take.scene
    renderer = FrameRenderer(
        scene, width=picture.width, height=picture.height, camera=picture.camera
    )

    def frames() -> Generator[npt.NDArray[np.uint8], None, None]:
        try:
            data = mujoco.MjData(scene.model)
            for seen in moments(take):
                pose(scene, data, seen.qpos)
                yield renderer.render(
                    data, due=seen.due, fingers=seen.fingers, sounding=seen.sounding
                )
        finally:
            renderer.close()

    return frames()


def pose(scene: PianoScene, data: mujoco.MjData, qpos: FloatArray) -> None:
    """Put everything in its place for joint positions, (nq,); cameras and lights too."""
    data.qpos[:] = qpos
    mujoco.mj_kinematics(scene.model, data)
    mujoco.mj_camlight(scene.model, data)
