"""A window on the screen that shows the scene: MuJoCo's viewer."""

from __future__ import annotations

import math
import os
import sys
import time
import warnings
from collections.abc import Iterable
from typing import Any

import mujoco

from sb3_piano.exceptions import RenderingError
from sb3_piano.simulation import PianoScene
from sb3_piano.viewing.film import Moment, pose
from sb3_piano.viewing.frame_renderer import geom_colors

_EXPECTED = (
    "Expected a screen: the machine's own, 'ssh -X', or a virtual one by xvfb-run. A video needs "
    "no screen."
)
_VIEW_DISTANCE = 0.8
"""Distance from the camera of the point around which the mouse turns the view, m."""


class SceneWindow:
    """Shows a scene in a window, in which the mouse turns and zooms the view.

    Use it as a context, or call :meth:`close`::

        with SceneWindow(scene) as window:
            for moment in moments(scene, performance, qpos):
                window.show(moment)

    Raises:
        RenderingError: If there is no screen; the message says what to do.
    """

    def __init__(self, scene: PianoScene, *, camera: str = "overview"):
        """Open the window, at first with the view of a camera of the scene."""
        check_screen()
        from mujoco import viewer  # here, because without a screen it may fail already

        self._scene = scene.copy()
        self._colors = scene.model.geom_rgba.copy()
        self._data = mujoco.MjData(self._scene.model)
        model = self._scene.model
        model.vis.global_.fovy = model.camera(camera).fovy[0]
        try:
            self._viewer: Any = viewer.launch_passive(
                model, self._data, show_left_ui=False, show_right_ui=False
            )
        except RuntimeError as error:  # macOS demands another Python
            raise RenderingError(f"Cannot open a window: {error}.") from error
        self._look_from(camera)

    @property
    def is_running(self) -> bool:
        """Whether the window is open: nobody has closed it."""
        return bool(self._viewer.is_running())

    @property
    def model(self) -> mujoco.MjModel:
        """The model that is shown, with the colours of the last moment; a copy of the scene's."""
        return self._scene.model

    def show(self, moment: Moment) -> None:
        """Show a moment; does nothing once the window is closed."""
        if not self.is_running:
            return
        model = self._scene.model
        with self._viewer.lock():
            pose(self._scene, self._data, moment.qpos)
            model.geom_rgba[:] = self._colors
            colors = geom_colors(
                self._scene, due=moment.due, fingers=moment.fingers, sounding=moment.sounding
            )
            for geom, color in colors.items():
                model.geom_rgba[geom] = color
        self._viewer.sync()

    def replay(self, seen: Iterable[Moment], period: float) -> None:
        """Show moments, each for ``period`` s, until they are over or somebody closes the window.

        A slow machine falls behind; none is left out.
        """
        start = time.monotonic()
        for k, moment in enumerate(seen):
            time.sleep(max(start + k * period - time.monotonic(), 0.0))
            if not self.is_running:
                return
            self.show(moment)

    def close(self) -> None:
        """Close the window; safe to call twice."""
        self._viewer.close()

    def __enter__(self) -> SceneWindow:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _look_from(self, camera: str) -> None:
        """Put the free camera where one of the scene's is, so that the mouse can move it."""
        mujoco.mj_camlight(self._scene.model, self._data)
        placed = self._data.camera(camera)
        ahead = -placed.xmat.reshape(3, 3)[:, 2]
        with self._viewer.lock():
            view = self._viewer.cam
            view.type = mujoco.mjtCamera.mjCAMERA_FREE
            view.distance = _VIEW_DISTANCE
            view.lookat[:] = placed.xpos + _VIEW_DISTANCE * ahead
            view.elevation = math.degrees(math.asin(ahead[2]))
            view.azimuth = math.degrees(math.atan2(ahead[1], ahead[0]))


def check_screen() -> None:
    """Refuse to go on where no window can be opened; MuJoCo would wait for ever.

    Raises:
        RenderingError: If there is no screen, or it cannot draw.
    """
    linux = sys.platform.startswith("linux")
    if linux and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise RenderingError(
            "Cannot open a window: there is no screen (neither DISPLAY nor WAYLAND_DISPLAY is "
            f"set). {_EXPECTED}"
        )
    if sys.platform == "darwin":
        return  # a window may only be opened by MuJoCo's own Python
    import glfw

    with warnings.catch_warnings(record=True) as reasons:  # that is how glfw tells its errors
        warnings.simplefilter("always")
        glfw.init()
        glfw.window_hint(glfw.VISIBLE, glfw.FALSE)
        trial = glfw.create_window(64, 64, "", None, None)
        glfw.default_window_hints()
    if not trial:
        reason = str(reasons[0].message) if reasons else "no reason was given"
        raise RenderingError(f"Cannot open a window: {reason}. {_EXPECTED}")
    glfw.destroy_window(trial)
