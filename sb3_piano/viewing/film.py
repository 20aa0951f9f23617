"""A take: a performance with its motion, and its pictures, drawn afterwards from how all moved."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sb3_piano.arrays import FloatArray
from sb3_piano.exceptions import ConfigError
from sb3_piano.metrics import frame_f1
from sb3_piano.music import Score
from sb3_piano.performance import Performance
from sb3_piano.simulation import PianoScene
from sb3_piano.viewing.moment import Moment
from sb3_piano.viewing.performance_renderer import PerformanceRenderer
from sb3_piano.viewing.views import DEFAULT_PICTURE, Picture


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
    """Whether pictures tell right from wrong: keys that sound, and the F1 so far."""

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


def moments(take: Take) -> Iterator[Moment]:
    """Return the moments of a take: its start, and the end of each control step.

    At the start the keys of the first step are due, later those of the step just played.
    """
    scene, roll = take.scene, take.performance.roll
    played = take.performance.key_active
    for k, positions in enumerate(take.qpos):
        due, fingers = roll.due(max(k - 1, 0))
        sounding = scene.key_angle_at(positions) >= scene.key_sounding_angle
        judged = take.mark_sounding
        yield Moment(
            qpos=positions,
            step=k,
            due=due,
            fingers=fingers,
            sounding=sounding if judged else None,
            f1=frame_f1(roll.active[:k], played[:k]) if judged and k > 0 else None,
        )


def film(
    take: Take, picture: Picture = DEFAULT_PICTURE
) -> Generator[npt.NDArray[np.uint8], None, None]:
    """Draw a take as the environment's ``render`` would have drawn it at every step.

    Returns:
        t + 1 pictures, (height, width, 3) uint8; picture k shows time ``k * take.period``.

    Raises:
        RenderingError: If this machine cannot draw; the message says what to install.
    """
    renderer = PerformanceRenderer(
        take.scene, width=picture.width, height=picture.height, view=picture.view
    )
    roll, title = take.performance.roll, take.performance.title

    def frames() -> Generator[npt.NDArray[np.uint8], None, None]:
        try:
            for seen in moments(take):
                yield renderer.render(roll, title, seen)
        finally:
            renderer.close()

    return frames()
