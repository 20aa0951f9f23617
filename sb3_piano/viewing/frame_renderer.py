"""Draw pictures of a scene without a screen."""

from __future__ import annotations

import atexit
import copy
import importlib
import threading
import warnings
import weakref
from collections.abc import Iterable, Mapping, Sequence
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

_TWICE = (0.25, -0.25)
"""Displacement of the two samples of a pixel, in pixels, each to the right and down."""

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
            lean: Draw without shadows and sky, and twice in place of four samples a pixel, in a
                third of the time without a graphics card.
        """
        self._scene = scene
        self._rect = mujoco.MjrRect(0, 0, width, height)
        self.camera = mujoco.MjvCamera()
        if camera:
            self.camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
            self.camera.fixedcamid = scene.model.camera(camera).id
        self._option = mujoco.MjvOption()
        self._shifts = _TWICE if lean else (0.0,)
        samples = 0 if plain or lean else 4
        self._gl, self._context = _contexts(scene.model, width, height, samples)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._drawn = mujoco.MjvScene(scene.model, maxgeom=scene.model.ngeom + _MOST_BARS)
        self._drawn.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = not (plain or lean)
        self._drawn.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = not lean
        # At exit the context must be freed before MuJoCo's own exit hook ends EGL: hooks run last
        # in, first out, and that one was registered while the context was opened.
        self._close = weakref.finalize(self, _free, self._context, self._gl)
        atexit.register(self._close)

    def look(
        self, data: mujoco.MjData, groups: Sequence[int | tuple[int, ...]] = ((0, 1, 2),)
    ) -> None:
        """Set the state to draw, seen from the camera.

        Groups of geoms that are in front come first: hidden parts of later ones take less time.
        """
        model, option, drawn = self._scene.model, self._option, self._drawn
        everything, untouched = mujoco.mjtCatBit.mjCAT_ALL.value, mujoco.MjvPerturb()
        for place, group in enumerate(groups):
            option.geomgroup[:] = np.isin(np.arange(len(option.geomgroup)), group)
            if place == 0:
                mujoco.mjv_updateScene(model, data, option, None, self.camera, everything, drawn)
            else:
                mujoco.mjv_addGeoms(model, data, option, untouched, everything, drawn)
        self._eyes = [copy.copy(eye) for eye in drawn.camera]

    def project(self, points: FloatArray) -> FloatArray:
        """Return the columns and rows, (n, 2), at which points, (n, 3) m, are seen."""
        eye, other = self._eyes  # the picture is seen from between them
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
        drawn, whole, geom_kind = self._drawn, self._rect, int(mujoco.mjtObj.mjOBJ_GEOM)
        for geom in drawn.geoms[: drawn.ngeom]:  # does not change the model's own colours
            if geom.objtype == geom_kind and geom.objid in colors:
                geom.rgba[:] = colors[geom.objid]
                geom.emission = _GLOW
        add_bars(drawn, bars)
        edges = area or Area(0, 0, whole.width, whole.height)
        rect = mujoco.MjrRect(0, 0, edges.right - edges.left, edges.bottom - edges.top)
        samples = []
        # Not earlier, as a garbage-collected renderer makes its own context current.
        self._gl.make_current()
        for shift in self._shifts:
            if area is not None or shift:
                for eye, usual in zip(drawn.camera, self._eyes, strict=True):
                    _narrow(eye, usual, [edge + shift for edge in edges], whole)
            pixels = np.empty((rect.height, rect.width, 3), dtype=np.uint8)
            mujoco.mjr_render(rect, drawn, self._context)
            mujoco.mjr_readPixels(pixels, None, rect, self._context)
            samples.append(np.flipud(pixels))
        one, *other = samples
        # The mean, without a wider type, which would take longer.
        return np.ascontiguousarray((one & other[0]) + ((one ^ other[0]) >> 1) if other else one)

    def close(self) -> None:
        """Free the drawing context; safe to call twice."""
        atexit.unregister(self._close)
        self._close()


def _narrow(eye: Any, usual: Any, edges: Iterable[float], whole: mujoco.MjrRect) -> None:
    """Let a camera see, of its usual picture of a given size, what is within edges as in Area."""
    left, top, right, bottom = edges
    pixel = (usual.frustum_top - usual.frustum_bottom) / whole.height
    eye.frustum_center = usual.frustum_center + (left + right - whole.width) / 2 * pixel
    eye.frustum_width = (right - left) / 2 * pixel
    eye.frustum_bottom, eye.frustum_top = (usual.frustum_top - row * pixel for row in (bottom, top))


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
    largest = model.vis.global_
    # GLFW fails silently after a warning.
    with _one_opening, warnings.catch_warnings(record=True) as said:
        usual = quality.offsamples, largest.offwidth, largest.offheight
        # A buffer that is larger than its pictures takes several times as long to clear.
        quality.offsamples, largest.offwidth, largest.offheight = samples, width, height
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
            quality.offsamples, largest.offwidth, largest.offheight = usual


def _free(context: mujoco.MjrContext, gl: Any) -> None:
    gl.make_current()
    context.free()
    gl.free()
