"""Draw pictures of a performance: the stage, falling notes and a caption."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from sb3_piano.arrays import FloatArray
from sb3_piano.engine import mujoco
from sb3_piano.music import PianoRoll
from sb3_piano.music.catalogue import shown_title
from sb3_piano.simulation import PianoScene
from sb3_piano.viewing.caption import legend_height, write_caption
from sb3_piano.viewing.frame_renderer import Area, FrameRenderer
from sb3_piano.viewing.moment import FINGER_COLORS, Color, Moment, geom_colors
from sb3_piano.viewing.note_bars import NoteBars, draw_notes, finger_plates
from sb3_piano.viewing.stage import FURNITURE, HANDS, HIDDEN, KEYS, sheet_points, staged
from sb3_piano.viewing.views import SHOTS, View, place_camera

_AROUND = 6
"""Width of an area around what moves, pixels."""
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
        self._stage = staged(scene).copy()
        self._size = width, height
        self._shot = SHOTS[view]
        self._data = mujoco.MjData(self._stage.model)
        self._renderer = FrameRenderer(self._stage, width=width, height=height, lean=True)
        # Behind falling notes and under the keys the furniture would be as good as black.
        self._seen = [KEYS] if self._shot.foot is not None else [KEYS, FURNITURE]
        self._bars: NoteBars | None = None
        self._still: npt.NDArray[np.uint8] | None = None
        self._foot, self._places, self._pixels = 0, np.zeros(88), 1.0
        self._end = np.array([width, height - legend_height(width, height)])
        model = self._stage.model
        self._hands = np.flatnonzero((model.geom_group == HANDS) & (model.geom_rgba[:, 3] > 0))
        self._columns = np.zeros(88), np.zeros(88)
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
        area = None if self._still is None else self._moving(colors)
        self._show_keys(area)
        self._renderer.look(self._data, [HANDS, *self._seen])
        plates = finger_plates(stage, self._data, moment)
        picture = self._renderer.draw(self._tints | colors, plates, area)
        if area is not None and self._still is not None:
            part, picture = picture, self._still.copy()
            area.of(picture)[:] = part
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
        self._show_keys(None)
        has_sheet = self._shot.foot is not None
        self._renderer.look(self._data, self._seen)
        still = self._renderer.draw({})
        columns = self._corners(self._stage.key_geom)[..., 0]
        self._columns = columns.min(axis=1), columns.max(axis=1)
        if has_sheet:
            key_y = self._stage.key_boxes[0][:, 1]
            columns, rows = self._renderer.project(sheet_points(key_y)).T
            self._foot = max(int(rows[0]) + 1, 0)
            self._places = columns[1:89]
            self._pixels = float(np.ptp(self._places) / np.ptp(key_y))
            still[: self._foot] = _SHEET
            lanes = columns[89:].round().astype(int)
            still[: self._foot, lanes[(lanes >= 0) & (lanes < still.shape[1])]] = _LANE
        return still

    def _moving(self, colors: dict[int, Color]) -> Area:
        """Return the area of the drawing with the hands and the keys that moved or have colours."""
        stage, data = self._stage, self._data
        moved = np.abs(data.qpos[stage.key_qpos]) > _STILL_ANGLE
        keys = stage.key_geom[stage.moving_keys][moved]
        geoms = np.unique(np.concatenate([self._hands, keys, list(colors)])).astype(int)
        seen = self._corners(geoms).reshape(-1, 2)
        first, end = np.array([0, self._foot]), self._end
        low = np.clip(np.floor(seen.min(axis=0)) - _AROUND, np.minimum(first, end - 1), end - 1)
        high = np.clip(np.ceil(seen.max(axis=0)) + _AROUND, low + 1, end)
        return Area(*(int(edge) for edge in (*low, *high)))

    def _corners(self, geoms: npt.NDArray[np.integer[Any]]) -> FloatArray:
        """Return the columns and rows, (n, 8, 2), of the corners of geoms' boxes."""
        box, data = self._stage.model.geom_aabb[geoms], self._data
        corners = box[:, None, :3] + _CORNERS * box[:, None, 3:]
        turned = corners @ data.geom_xmat[geoms].reshape(-1, 3, 3).transpose(0, 2, 1)
        points = (turned + data.geom_xpos[geoms][:, None]).reshape(-1, 3)
        return self._renderer.project(points).reshape(-1, 8, 2)

    def _show_keys(self, area: Area | None) -> None:
        """Hide the keys beside an area, which takes less time to draw then."""
        beside, (left, right) = np.zeros(88, dtype=bool), self._columns
        if area is not None:
            beside = (right < area.left - _AROUND) | (left > area.right + _AROUND)
        self._stage.model.geom_group[self._stage.key_geom] = np.where(beside, HIDDEN, KEYS)


_CORNERS = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])


def pose(scene: PianoScene, data: mujoco.MjData, qpos: FloatArray) -> None:
    """Set joint positions, (nq,), and compute the poses of bodies, cameras and lights."""
    data.qpos[:] = qpos
    mujoco.mj_kinematics(scene.model, data)
    mujoco.mj_camlight(scene.model, data)
