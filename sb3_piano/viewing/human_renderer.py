"""Show a performance in a window, MuJoCo's viewer."""

from __future__ import annotations

import atexit
import os
import sys
import threading
import time
import warnings
from typing import Any

from sb3_piano.engine import mujoco
from sb3_piano.exceptions import RenderingError
from sb3_piano.music import PianoRoll
from sb3_piano.simulation import PianoScene
from sb3_piano.viewing.frame_renderer import add_bars
from sb3_piano.viewing.moment import Moment, geom_colors
from sb3_piano.viewing.note_bars import NoteBars, finger_plates
from sb3_piano.viewing.performance_renderer import pose
from sb3_piano.viewing.stage import staged
from sb3_piano.viewing.views import WINDOW_SHOTS, View, place_camera

_EXPECTED = (
    "Expected a screen: the machine's own, 'ssh -X', or a virtual one by xvfb-run. A video needs "
    "no screen."
)
_one_window = threading.Lock()
"""Held while a window is open: GLFW crashes if two threads have one each."""

_ASPECT = 16 / 9
"""Approximate ratio of the window's width to its height."""


class HumanRenderer:
    """Shows moments of performances of one scene in MuJoCo's viewer, in real time.

    The mouse turns and zooms the view. A slow machine falls behind; nothing is left out. After the
    user has closed the window, nothing is shown.

    Args:
        scene: The scene to show; it is copied.
        fps: Moments a second.
        view: The initial view.

    Raises:
        RenderingError: If there is no screen, or another window is open; the message gives the
            remedy.
    """

    def __init__(self, scene: PianoScene, *, fps: float, view: View = "stage"):
        self._stage = staged(scene).copy()
        self._colors = self._stage.model.geom_rgba.copy()
        self._data = mujoco.MjData(self._stage.model)
        self._bars: NoteBars | None = None
        self._view: View = view
        self._period, self._due = 1 / fps, 0.0
        if not _one_window.acquire(blocking=False):
            raise RenderingError(
                "Cannot open a window: another one is open. Expected one environment with "
                "render_mode='human' at a time; close() closes its window."
            )
        before = set(threading.enumerate())
        try:
            self._viewer = self._launch()
        except BaseException:
            _one_window.release()
            raise
        self._is_open = True
        self._threads = set(threading.enumerate()) - before
        atexit.register(self.close)  # MuJoCo's thread crashes if the interpreter ends before it

    def _launch(self) -> Any:
        check_screen()
        from mujoco import viewer  # noqa: TID251  here, as importing it may fail without a screen

        try:
            return viewer.launch_passive(
                self._stage.model, self._data, show_left_ui=False, show_right_ui=False
            )
        except RuntimeError as error:  # macOS needs another Python, mjpython
            raise RenderingError(f"Cannot open a window: {error}.") from error

    @property
    def is_running(self) -> bool:
        """Whether the window is open."""
        return bool(self._viewer.is_running())

    @property
    def model(self) -> mujoco.MjModel:
        """The shown model, with the colours of the last moment."""
        return self._stage.model

    def render(self, roll: PianoRoll, title: str, moment: Moment) -> None:
        """Show a moment, ``1 / fps`` s after the one before; same arguments as other renderers."""
        del title
        if not self.is_running:
            return
        time.sleep(max(self._due - time.monotonic(), 0.0))
        self._due = max(self._due, time.monotonic()) + self._period
        with self._viewer.lock():
            self._draw(roll, moment)
        self._viewer.sync()

    def close(self) -> None:
        """Close the window; safe to call twice."""
        if not self._is_open:
            return
        self._is_open = False
        atexit.unregister(self.close)
        self._viewer.close()
        for thread in self._threads:
            thread.join()
        _one_window.release()

    def _draw(self, roll: PianoRoll, moment: Moment) -> None:
        if self._bars is None or self._bars.roll is not roll:
            is_first, self._bars = self._bars is None, NoteBars.over(self._stage, roll)
            if is_first:
                place_camera(self._viewer.cam, WINDOW_SHOTS[self._view], self._bars.whole, _ASPECT)
        model = self._stage.model
        pose(self._stage, self._data, moment.qpos)
        model.geom_rgba[:] = self._colors
        colors = geom_colors(
            self._stage, due=moment.due, fingers=moment.fingers, sounding=moment.sounding
        )
        for geom, color in colors.items():
            model.geom_rgba[geom] = color
        if (drawn := self._viewer.user_scn) is not None:
            drawn.ngeom = 0
            add_bars(drawn, finger_plates(self._stage, self._data, moment))
            add_bars(drawn, self._bars.at(moment.step, moment.sounding))


def check_screen() -> None:
    """Check that a window can be opened, as MuJoCo would wait for ever.

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
        return  # only MuJoCo's own Python may open a window
    import glfw

    with warnings.catch_warnings(record=True) as reasons:  # glfw reports errors as warnings
        warnings.simplefilter("always")
        glfw.init()
        glfw.window_hint(glfw.VISIBLE, glfw.FALSE)
        trial = glfw.create_window(64, 64, "", None, None)
        glfw.default_window_hints()
    if not trial:
        reason = str(reasons[0].message) if reasons else "no reason was given"
        raise RenderingError(f"Cannot open a window: {reason}. {_EXPECTED}")
    glfw.destroy_window(trial)
