"""A window on the screen that shows the scene: MuJoCo's viewer."""

from __future__ import annotations

import os
import sys
import time
import warnings
from collections.abc import Iterable
from typing import Any

from sb3_piano.exceptions import RenderingError
from sb3_piano.music import PianoRoll
from sb3_piano.simulation import PianoScene
from sb3_piano.simulation.engine import mujoco
from sb3_piano.viewing.frame_renderer import add_bars
from sb3_piano.viewing.moment import Moment, geom_colors
from sb3_piano.viewing.note_bars import NoteBars
from sb3_piano.viewing.performance_renderer import pose
from sb3_piano.viewing.stage import staged
from sb3_piano.viewing.views import View, place_camera

_EXPECTED = (
    "Expected a screen: the machine's own, 'ssh -X', or a virtual one by xvfb-run. A video needs "
    "no screen."
)
_ASPECT = 16 / 9
"""Width of the window by its height, about."""


class SceneWindow:
    """Shows a scene in a window, in which the mouse turns and zooms the view.

    Use it as a context, or call :meth:`close`::

        with SceneWindow(take.scene, take.performance.roll) as window:
            for moment in moments(take):
                window.show(moment)

    Raises:
        RenderingError: If there is no screen; the message says what to do.
    """

    def __init__(self, scene: PianoScene, roll: PianoRoll, *, view: View = "stage"):
        """Open the window on a scene in which a roll is played, at first with a view of it."""
        check_screen()
        from mujoco import viewer  # noqa: TID251  here, as without a screen it may fail already

        self._scene = staged(scene).copy()
        self._colors = self._scene.model.geom_rgba.copy()
        self._data = mujoco.MjData(self._scene.model)
        self._bars = NoteBars.over(self._scene, roll)
        try:
            self._viewer: Any = viewer.launch_passive(
                self._scene.model, self._data, show_left_ui=False, show_right_ui=False
            )
        except RuntimeError as error:  # macOS demands another Python
            raise RenderingError(f"Cannot open a window: {error}.") from error
        with self._viewer.lock():
            place_camera(self._viewer.cam, view, self._bars.whole, _ASPECT)

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
            drawn = self._viewer.user_scn
            if drawn is not None:
                drawn.ngeom = 0
                add_bars(drawn, self._bars.at(moment.step, moment.sounding))
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
