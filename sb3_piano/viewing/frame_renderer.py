"""Draw pictures of a scene without a screen."""

from __future__ import annotations

import atexit
import importlib
import warnings
import weakref
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

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

_HOW_TO_INSTALL = (
    "Install an OpenGL library, for instance with 'apt-get install libosmesa6' or 'apt-get install "
    "libegl1' on Debian, and choose it with MUJOCO_GL=osmesa or MUJOCO_GL=egl if both are there. "
    "Everything except pictures works without it."
)


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
        self._drawn.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = not plain
        # At exit the context must be freed before MuJoCo's own exit hook ends EGL: hooks run last
        # in, first out, and that one was registered while the context was opened.
        self._close = weakref.finalize(self, _free, self._context, self._gl)
        atexit.register(self._close)

    def render(
        self, data: mujoco.MjData, colors: Mapping[int, Color], bars: Sequence[Bar] = ()
    ) -> npt.NDArray[np.uint8]:
        """Draw a picture, (height, width, 3) uint8, of a state of the simulation.

        Args:
            data: The state.
            colors: RGBA by the id of a geom; other geoms keep their own colours.
            bars: Falling notes to add.
        """
        drawn, everything = self._drawn, mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(
            self._scene.model, data, self._option, None, self.camera, everything, drawn
        )
        for geom in drawn.geoms[: drawn.ngeom]:  # does not change the model's own colours
            if geom.objtype == int(mujoco.mjtObj.mjOBJ_GEOM) and geom.objid in colors:
                geom.rgba[:] = colors[geom.objid]
                geom.emission = _GLOW
        add_bars(drawn, bars)
        pixels = np.empty((self._rect.height, self._rect.width, 3), dtype=np.uint8)
        # Not earlier, as a garbage-collected renderer makes its own context current.
        self._gl.make_current()
        mujoco.mjr_render(self._rect, drawn, self._context)
        mujoco.mjr_readPixels(pixels, None, self._rect, self._context)
        return np.ascontiguousarray(np.flipud(pixels))

    def close(self) -> None:
        """Free the drawing context; safe to call twice."""
        atexit.unregister(self._close)
        self._close()


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
            np.eye(3).ravel(),
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
    usual, quality.offsamples = quality.offsamples, samples
    with warnings.catch_warnings(record=True) as said:  # GLFW fails silently after a warning
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
