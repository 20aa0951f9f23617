"""Draw pictures of a scene without a screen."""

from __future__ import annotations

import atexit
import importlib
import threading
import warnings
import weakref
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from sb3_piano.arrays import FloatArray
from sb3_piano.engine import mujoco
from sb3_piano.exceptions import RenderingError, one_line
from sb3_piano.simulation import PianoScene
from sb3_piano.simulation.gl import find_gl_backend
from sb3_piano.viewing.moment import Color
from sb3_piano.viewing.note_bars import Bar

_MOST_BARS = 500
"""Limit of falling notes in one picture; the rest is left out."""

_GLOW = 0.35
"""Emission of coloured keys and bars, so that they stay bright in shadows."""

_one_opening = threading.Lock()
"""Held while a context is opened, as that changes the model for a moment."""

_HOW_TO_INSTALL = (
    "Install an OpenGL library, for instance with 'apt-get install libosmesa6' or 'apt-get install "
    "libegl1' on Debian, and choose it with MUJOCO_GL=osmesa or MUJOCO_GL=egl if both are there. "
    "Everything except pictures works without it."
)


class Area(NamedTuple):
    """A rectangle of a picture, pixels from its upper left corner."""

    left: int
    top: int
    right: int
    bottom: int

    def of(self, picture: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
        """Return this part of a picture."""
        return picture[self.top : self.bottom, self.left : self.right]


class FrameRenderer:
    """Draws a scene as RGB arrays.

    Raises:
        RenderingError: If this machine cannot draw; the message says what to install.
    """

    def __init__(
        self,
        scene: PianoScene,
        *,
        width: int,
        height: int,
        camera: str = "",
        plain: bool = False,
        samples: int = 4,
        lean: bool = False,
    ):
        """Open a drawing context of the given size.

        Args:
            scene: The scene to draw.
            width: Pixels.
            height: Pixels.
            camera: A camera of the scene; without one, place ``self.camera`` freely.
            plain: Draw without shadows and with jagged edges, in a seventh of the time without a
                graphics card.
            samples: Samples of a pixel, unless plain: 4 for smooth edges, or 0.
            lean: Draw without shadows and sky, in half of the time.
        """
        self._scene = scene
        self._rect = mujoco.MjrRect(0, 0, width, height)
        self.camera = mujoco.MjvCamera()
        if camera:
            self.camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
            self.camera.fixedcamid = scene.model.camera(camera).id
        self._option = mujoco.MjvOption()
        self._gl, self._context = _contexts(scene.model, width, height, 0 if plain else samples)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._drawn = mujoco.MjvScene(scene.model, maxgeom=scene.model.ngeom + _MOST_BARS)
        self._drawn.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = not (plain or lean)
        self._drawn.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = not lean
        # At exit the context must be freed before MuJoCo's own exit hook ends EGL: hooks run last
        # in, first out, and that one was registered while the context was opened.
        self._close = weakref.finalize(self, _free, self._context, self._gl)
        atexit.register(self._close)

    def look(self, data: mujoco.MjData, groups: Mapping[int, bool] = MappingProxyType({})) -> None:
        """Set the state to draw, seen from the camera, with groups of geoms visible or not."""
        for group, visible in groups.items():
            self._option.geomgroup[group] = visible
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(
            self._scene.model, data, self._option, None, self.camera, everything, self._drawn
        )

    def project(self, points: FloatArray) -> FloatArray:
        """Return the columns and rows, (n, 2), at which points, (n, 3) m, are seen."""
        eye, other = self._drawn.camera  # the picture is seen from between them
        forward, up = np.array(eye.forward), np.array(eye.up)
        seen = (points - (np.array(eye.pos) + np.array(other.pos)) / 2) @ np.stack(
            [np.cross(forward, up), up, forward]
        ).T
        height = self._rect.height / (eye.frustum_top - eye.frustum_bottom) * eye.frustum_near
        middle = np.array([self._rect.width, self._rect.height]) / 2
        return middle + seen[:, :2] / seen[:, 2:] * [height, -height]

    def render(
        self,
        data: mujoco.MjData,
        colors: Mapping[int, Color],
        bars: Sequence[Bar] = (),
    ) -> npt.NDArray[np.uint8]:
        """Draw a picture, (height, width, 3) uint8, of a state of the simulation.

        Args:
            data: The state.
            colors: RGBA by the id of a geom; other geoms keep their own colours.
            bars: Falling notes to add.
        """
        self.look(data)
        return self.draw(colors, bars)

    def draw(
        self, colors: Mapping[int, Color], bars: Sequence[Bar] = (), area: Area | None = None
    ) -> npt.NDArray[np.uint8]:
        """Draw the state of the last :meth:`look`, or only an area of the picture."""
        drawn = self._drawn
        for geom in drawn.geoms[: drawn.ngeom]:  # does not change the model's own colours
            if geom.objtype == int(mujoco.mjtObj.mjOBJ_GEOM) and geom.objid in colors:
                geom.rgba[:] = colors[geom.objid]
                geom.emission = _GLOW
        add_bars(drawn, bars)
        rect = self._rect
        if area is not None:
            rect = mujoco.MjrRect(0, 0, area.right - area.left, area.bottom - area.top)
            for eye in drawn.camera:
                _narrow(eye, area, self._rect)
        pixels = np.empty((rect.height, rect.width, 3), dtype=np.uint8)
        # Not earlier, as a garbage-collected renderer makes its own context current.
        self._gl.make_current()
        mujoco.mjr_render(rect, drawn, self._context)
        mujoco.mjr_readPixels(pixels, None, rect, self._context)
        return np.ascontiguousarray(np.flipud(pixels))

    def close(self) -> None:
        """Free the drawing context; safe to call twice."""
        atexit.unregister(self._close)
        self._close()


def _narrow(eye: mujoco.MjvGLCamera, area: Area, whole: mujoco.MjrRect) -> None:
    """Let a camera with a picture of a given size see an area of it."""
    pixel = (eye.frustum_top - eye.frustum_bottom) / whole.height
    eye.frustum_center += (area.left + area.right - whole.width) / 2 * pixel
    eye.frustum_width = (area.right - area.left) / 2 * pixel
    eye.frustum_bottom, eye.frustum_top = (
        eye.frustum_top - row * pixel for row in (area.bottom, area.top)
    )


def add_bars(drawn: mujoco.MjvScene, bars: Sequence[Bar]) -> None:
    """Add bars to a drawn scene, up to its limit of geoms."""
    room = drawn.maxgeom - drawn.ngeom
    for bar in bars[:room]:
        geom = drawn.geoms[drawn.ngeom]
        mujoco.mjv_initGeom(
            geom,
            mujoco.mjtGeom.mjGEOM_BOX.value,
            np.array(bar.half),
            np.array(bar.centre),
            bar.turn,
            np.array(bar.color, dtype=np.float32),
        )
        geom.emission = _GLOW
        drawn.ngeom += 1


def _contexts(
    model: mujoco.MjModel, width: int, height: int, samples: int
) -> tuple[Any, mujoco.MjrContext]:
    """Open an OpenGL context with this machine's backend, and MuJoCo's context in it."""
    backend = find_gl_backend()
    if backend not in ("egl", "osmesa", "glfw"):
        reason = "no OpenGL library was found" if backend is None else f"MUJOCO_GL is {backend!r}"
        raise RenderingError(f"Cannot draw the scene: {reason}. {_HOW_TO_INSTALL}")
    quality, font = model.vis.quality, mujoco.mjtFontScale.mjFONTSCALE_150.value
    # GLFW fails silently after a warning.
    with _one_opening, warnings.catch_warnings(record=True) as said:
        usual, quality.offsamples = quality.offsamples, samples
        try:
            gl = importlib.import_module(f"mujoco.{backend}").GLContext(width, height)
            gl.make_current()
            return gl, mujoco.MjrContext(model, font)
        except Exception as error:  # backends raise different errors: ImportError, OSError, ...
            reason = str(said[0].message) if said else one_line(error)
            raise RenderingError(
                f"Cannot draw the scene with the OpenGL backend {backend!r} ({reason}). "
                f"{_HOW_TO_INSTALL}"
            ) from error
        finally:
            quality.offsamples = usual


def _free(context: mujoco.MjrContext, gl: Any) -> None:
    gl.make_current()
    context.free()
    gl.free()
