"""Draw the pictures of takes, from their recorded motion."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from sb3_piano.metrics import frame_f1
from sb3_piano.viewing.moment import Moment
from sb3_piano.viewing.performance_renderer import PerformanceRenderer
from sb3_piano.viewing.views import DEFAULT_PICTURE, Picture

if TYPE_CHECKING:
    from sb3_piano.viewing.take import Take


def moments(take: Take) -> Iterator[Moment]:
    """Yield the moments of a take: its start, and the end of each control step.

    The first moment shows the first step's due keys, each later one those of the step just played.
    """
    scene, roll = take.scene, take.piano.roll
    played = take.piano.key_active
    for k, positions in enumerate(take.qpos):
        due, fingers = roll.due(max(k - 1, 0))
        sounding = scene.clipped_key_angle(positions[scene.key_slice]) >= scene.key_sounding_angle
        judged = take.judged
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
    """Draw a take as the environment's ``render`` draws every step.

    Returns:
        t + 1 pictures, (height, width, 3) uint8; picture k shows time ``k * take.period``.

    Raises:
        RenderingError: If this machine cannot draw; the message says what to install.
    """
    renderer = PerformanceRenderer(
        take.scene, width=picture.width, height=picture.height, view=picture.view
    )
    roll, title = take.piano.roll, take.piano.title

    def frames() -> Generator[npt.NDArray[np.uint8], None, None]:
        try:
            for seen in moments(take):
                yield renderer.render(roll, title, seen)
        finally:
            renderer.close()

    return frames()
