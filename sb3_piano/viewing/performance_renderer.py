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
from sb3_piano.viewing.frame_renderer import Area, FrameRenderer
from sb3_piano.viewing.moment import FINGER_COLORS, Color, Moment, geom_colors
from sb3_piano.viewing.note_bars import NoteBars, draw_notes, finger_plates
from sb3_piano.viewing.stage import FAR_END, FELT, HALF_WHITE, HANDS, LANES, PANEL_GROUP, staged
from sb3_piano.viewing.views import LARGEST, SHOTS, View, place_camera

_FINER = 1.5
_GRID = 6
"""Areas begin at multiples of it, pixels of the larger drawing: whole pixels of the picture."""
_AROUND = 9
"""Width of an area around what moves, pixels of the larger drawing."""
_STILL_ANGLE = 0.003
"""Keys that have moved less do not seem to move, rad."""

_SHEET, _LANE = (16, 17, 21), (36, 37, 42)


class PerformanceRenderer:
    """Draws moments of performances of one scene.

    In views that stay in place, only the hands and the keys that move are drawn anew.

    Raises:
        RenderingError: If this machine cannot draw; the message says what to install.
    """

    def __init__(self, scene: PianoScene, *, width: int, height: int, view: View):
        """Open a drawing context of the given size."""
        self._stage = staged(scene)
        self._size = width, height
        self._shot = SHOTS[view]
        self._data = mujoco.MjData(self._stage.model)
        # Drawing larger and scaling down is as smooth as four samples a pixel, and takes two thirds
        # of the time without a graphics card; the size of the drawing context is limited.
        large = round(_FINER * width), round(_FINER * height)
        finer = large[0] <= LARGEST[0] and large[1] <= LARGEST[1]
        self._scale, samples = (_FINER, 0) if finer else (1.0, 4)
        size = large if finer else self._size
        self._whole = Area(0, 0, *size)
        self._renderer = FrameRenderer(
            self._stage, width=size[0], height=size[1], samples=samples, lean=True
        )
        self._bars: NoteBars | None = None
        self._still: npt.NDArray[np.uint8] | None = None
        self._foot, self._places, self._pixels = 0, np.zeros(88), 1.0
        model = self._stage.model
        self._hands = np.flatnonzero((model.geom_group == HANDS) & (model.geom_rgba[:, 3] > 0))
        self._tints = self._phalanges()

    def render(self, roll: PianoRoll, title: str, moment: Moment) -> npt.NDArray[np.uint8]:
        """Draw a picture, (height, width, 3) uint8.

        Args:
            roll: The roll that is due; faster if it is the one of the last picture.
            title: Title of the score.
            moment: The moment to show.
        """
        if self._bars is None or self._bars.roll is not roll:
            self._bars, self._still = NoteBars.over(self._stage, roll), None
        notes, shot, stage = self._bars, self._shot, self._stage
        if self._still is None:
            stretch = notes.followed(moment.step) if shot.follows else notes.whole
            place_camera(self._renderer.camera, shot, stretch, self._size[0] / self._size[1])
            if not shot.follows:
                self._still = self._draw_still()
        pose(stage, self._data, moment.qpos)
        colors = geom_colors(
            stage, due=moment.due, fingers=moment.fingers, sounding=moment.sounding
        )
        self._renderer.look(self._data, {HANDS: True})
        area = self._whole if self._still is None else self._moving(colors)
        plates = finger_plates(stage, self._data, moment)
        part = self._shrunk(self._renderer.draw(self._tints | colors, plates, area))
        if self._still is None:
            picture = part
        else:
            picture = self._still.copy()
            Area(*(round(edge / self._scale) for edge in area)).of(picture)[:] = part
        if shot.foot is not None:
            falling = notes.falling(moment.step, moment.sounding)
            draw_notes(picture[: self._foot], falling, self._places, self._pixels)
        write_caption(picture, shown_title(title), moment.f1, moment.pedal)
        return picture

    def close(self) -> None:
        """Free the drawing context; safe to call twice."""
        self._renderer.close()

    def _phalanges(self) -> dict[int, Color]:
        """Return paler colours of the fingers for the links before their fingertips."""
        model, tints = self._stage.model, {}
        tips = model.geom_bodyid[self._stage.fingertip_geom]
        for body, finger in zip(model.body_parentid[tips], self._stage.fingers, strict=True):
            red, green, blue, _ = FINGER_COLORS[finger]
            for geom in self._hands[model.geom_bodyid[self._hands] == body].tolist():
                tints[geom] = (0.4 + red / 2, 0.4 + green / 2, 0.4 + blue / 2, 1.0)
        return tints

    def _draw_still(self) -> npt.NDArray[np.uint8]:
        """Draw all that does not move."""
        pose(self._stage, self._data, self._stage.model.qpos0)
        has_sheet = self._shot.foot is not None
        self._renderer.look(self._data, {HANDS: False, PANEL_GROUP: not has_sheet})
        still = self._shrunk(self._renderer.draw({}, (), self._whole))
        if has_sheet:
            key_y = self._stage.key_boxes[0][:, 1]
            ends = np.array([FELT, *[FAR_END] * (88 + len(LANES))])
            ends[1:, 1] = [*key_y, *(key_y[list(LANES)] - HALF_WHITE)]
            self._renderer.look(self._data)
            columns, rows = self._renderer.project(ends).T / self._scale
            grid = round(_GRID / self._scale)
            self._foot = max(int(rows[0] / grid + 1) * grid, 0)
            self._places = columns[1:89]
            self._pixels = float(np.ptp(self._places) / np.ptp(key_y))
            still[: self._foot] = _SHEET
            lanes = columns[89:].round().astype(int)
            still[: self._foot, lanes[(lanes >= 0) & (lanes < still.shape[1])]] = _LANE
        return still

    def _moving(self, colors: dict[int, Color]) -> Area:
        """Return the area of the drawing with the hands and the keys that moved or have colours."""
        stage, data, model = self._stage, self._data, self._stage.model
        moved = np.abs(data.qpos[stage.key_qpos]) > _STILL_ANGLE
        keys = stage.key_geom[stage.moving_keys][moved]
        geoms = np.unique(np.concatenate([self._hands, keys, list(colors)])).astype(int)
        box = model.geom_aabb[geoms]
        corners = box[:, None, :3] + _CORNERS * box[:, None, 3:]
        turned = corners @ data.geom_xmat[geoms].reshape(-1, 3, 3).transpose(0, 2, 1)
        seen = self._renderer.project((turned + data.geom_xpos[geoms][:, None]).reshape(-1, 3))
        low = np.floor((seen.min(axis=0) - _AROUND) / _GRID) * _GRID
        high = np.ceil((seen.max(axis=0) + _AROUND) / _GRID) * _GRID
        _, _, *end = self._whole
        first = 0, round(self._foot * self._scale)
        low, high = np.clip(low, first, np.array(end) - 2 * _GRID), np.clip(high, first, end)
        left, top, right, bottom = (int(edge) for edge in (*low, *np.maximum(high, low + _GRID)))
        return Area(left - left % _GRID, top - top % _GRID, right, bottom)

    def _shrunk(self, drawn: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
        """Scale a drawing down to the size of the picture."""
        if self._scale == 1.0:
            return drawn
        from PIL import Image  # here, to keep importing environments fast

        size = round(drawn.shape[1] / self._scale), round(drawn.shape[0] / self._scale)
        return np.array(Image.fromarray(drawn).resize(size, Image.Resampling.BOX))


_CORNERS = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])


def pose(scene: PianoScene, data: mujoco.MjData, qpos: FloatArray) -> None:
    """Set joint positions, (nq,), and compute the poses of bodies, cameras and lights."""
    data.qpos[:] = qpos
    mujoco.mj_kinematics(scene.model, data)
    mujoco.mj_camlight(scene.model, data)
