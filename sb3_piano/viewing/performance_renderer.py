"""Draw pictures of a performance: the stage, falling notes and a caption."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from sb3_piano.arrays import FloatArray
from sb3_piano.engine import mujoco
from sb3_piano.music import PianoRoll
from sb3_piano.music.catalogue import shown_title
from sb3_piano.simulation import PianoScene
from sb3_piano.viewing.caption import write_caption
from sb3_piano.viewing.frame_renderer import FrameRenderer
from sb3_piano.viewing.moment import Moment, geom_colors
from sb3_piano.viewing.note_bars import NoteBars
from sb3_piano.viewing.stage import staged
from sb3_piano.viewing.views import SHOTS, View, place_camera

_FINER = 1.5
_LARGEST = (1920, 1080)


class PerformanceRenderer:
    """Draws moments of performances of one scene.

    Raises:
        RenderingError: If this machine cannot draw; the message says what to install.
    """

    def __init__(self, scene: PianoScene, *, width: int, height: int, view: View):
        """Open a drawing context of the given size."""
        self._stage = staged(scene)
        self._size = width, height
        self._aspect = width / height
        self._view: View = view
        self._data = mujoco.MjData(self._stage.model)
        # Drawing larger and scaling down is as smooth as four samples a pixel, and takes two thirds
        # of the time without a graphics card; the size of the drawing context is limited.
        large = round(_FINER * width), round(_FINER * height)
        finer = large[0] <= _LARGEST[0] and large[1] <= _LARGEST[1]
        size, samples = (large, 0) if finer else (self._size, 4)
        self._renderer = FrameRenderer(self._stage, width=size[0], height=size[1], samples=samples)
        self._bars: NoteBars | None = None

    def render(self, roll: PianoRoll, title: str, moment: Moment) -> npt.NDArray[np.uint8]:
        """Draw a picture, (height, width, 3) uint8.

        Args:
            roll: The roll that is due; faster if it is the one of the last picture.
            title: Title of the score.
            moment: The moment to show.
        """
        if self._bars is None or self._bars.roll is not roll:
            self._bars = NoteBars.over(self._stage, roll)
        notes = self._bars
        stretch = notes.followed(moment.step) if SHOTS[self._view].follows else notes.whole
        place_camera(self._renderer.camera, self._view, stretch, self._aspect)
        pose(self._stage, self._data, moment.qpos)
        colors = geom_colors(
            self._stage, due=moment.due, fingers=moment.fingers, sounding=moment.sounding
        )
        bars = notes.at(moment.step, moment.sounding) if SHOTS[self._view].bars else ()
        drawn = self._renderer.render(self._data, colors, bars)
        if drawn.shape[1::-1] != self._size:
            from PIL import Image  # here, to keep importing environments fast

            smaller = Image.fromarray(drawn).resize(self._size, Image.Resampling.BILINEAR)
            drawn = np.array(smaller)
        write_caption(drawn, shown_title(title), moment.f1)
        return drawn

    def close(self) -> None:
        """Free the drawing context; safe to call twice."""
        self._renderer.close()


def pose(scene: PianoScene, data: mujoco.MjData, qpos: FloatArray) -> None:
    """Set joint positions, (nq,), and compute the poses of bodies, cameras and lights."""
    data.qpos[:] = qpos
    mujoco.mj_kinematics(scene.model, data)
    mujoco.mj_camlight(scene.model, data)
