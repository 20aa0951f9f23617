"""Pictures of the scene, drawn off screen: fingertips and due keys coloured by finger."""

from __future__ import annotations

import atexit
import importlib
import weakref
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from sb3_piano.exceptions import RenderingError
from sb3_piano.simulation import PianoScene, find_gl_backend

# Okabe and Ito's palette, which people with colour-blindness can tell apart, without its greens:
# green says that a key sounds.
_THUMB_TO_LITTLE = (
    (0.84, 0.37, 0.00, 1.0),  # vermillion
    (0.00, 0.45, 0.70, 1.0),  # blue
    (0.94, 0.89, 0.26, 1.0),  # yellow
    (0.80, 0.47, 0.65, 1.0),  # reddish purple
    (0.34, 0.71, 0.91, 1.0),  # sky blue
)

FINGER_COLORS = _THUMB_TO_LITTLE * 2
"""RGBA of each finger label 0-9: the same for both hands, thumb to little finger."""

UNLABELLED_COLOR = (0.55, 0.55, 0.62, 1.0)
"""RGBA of a key that is due without a finger label."""

PRESSED_COLOR = (0.13, 0.72, 0.25, 1.0)
"""RGBA of a key that sounds."""


Color = tuple[float, float, float, float]


def geom_colors(
    scene: PianoScene,
    *,
    due: npt.NDArray[np.intp],
    fingers: npt.NDArray[np.integer[Any]],
    sounding: npt.NDArray[np.bool_],
) -> dict[int, Color]:
    """Return the RGBA of fingertips, due keys and sounding keys by the id of their geom.

    What is due and what sounds is as in :class:`~sb3_piano.viewing.Moment`.
    """
    colors = {
        geom: FINGER_COLORS[finger]
        for geom, finger in zip(scene.fingertip_geom.tolist(), scene.fingers.tolist(), strict=True)
    }
    for key, finger in zip(due, fingers, strict=True):
        color = FINGER_COLORS[finger] if finger >= 0 else UNLABELLED_COLOR
        colors[int(scene.key_geom[key])] = color
    for key in np.flatnonzero(sounding):
        colors[int(scene.key_geom[key])] = PRESSED_COLOR
    return colors


_HOW_TO_INSTALL = (
    "Install an OpenGL library, for instance with 'apt-get install libosmesa6' or 'apt-get install "
    "libegl1' on Debian, and choose it with MUJOCO_GL=osmesa or MUJOCO_GL=egl if both are there. "
    "Everything but pictures works without."
)


class FrameRenderer:
    """Draws a scene into RGB arrays.

    Raises:
        RenderingError: If this machine cannot draw; the message says what to install.
    """

    def __init__(
        self, scene: PianoScene, *, width: int, height: int, camera: str, plain: bool = False
    ):
        """Open a drawing context of so many pixels for a camera of the scene.

        Plain pictures, without shadows and with jagged edges, take a seventh of the time without a
        graphics card.
        """
        self._scene = scene
        self._rect = mujoco.MjrRect(0, 0, width, height)
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        self._camera.fixedcamid = scene.model.camera(camera).id
        self._option = mujoco.MjvOption()
        self._gl = _gl_context(width, height)
        self._gl.make_current()
        quality = scene.model.vis.quality
        samples, quality.offsamples = quality.offsamples, 0 if plain else quality.offsamples
        try:
            font = mujoco.mjtFontScale.mjFONTSCALE_150.value
            self._context = mujoco.MjrContext(scene.model, font)
        finally:
            quality.offsamples = samples
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._drawn = mujoco.MjvScene(scene.model, maxgeom=scene.model.ngeom + 100)
        self._drawn.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = not plain
        # At exit the context must be freed before MuJoCo's own exit hook ends EGL: hooks run last
        # in, first out, and that one was registered while the context was opened.
        self._close = weakref.finalize(self, _free, self._context, self._gl)
        atexit.register(self._close)

    def render(
        self,
        data: mujoco.MjData,
        *,
        due: npt.NDArray[np.intp],
        fingers: npt.NDArray[np.integer[Any]],
        sounding: npt.NDArray[np.bool_],
    ) -> npt.NDArray[np.uint8]:
        """Draw one picture, (height, width, 3) uint8, of a state of the simulation.

        Args:
            data: The state.
            due: (n,) keys that should be down.
            fingers: (n,) finger label of each of them, -1 where unknown.
            sounding: (88,) bool, keys that sound.
        """
        self._gl.make_current()
        model, everything = self._scene.model, mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(
            model, data, self._option, None, self._camera, everything, self._drawn
        )
        colors = geom_colors(self._scene, due=due, fingers=fingers, sounding=sounding)
        for geom in self._drawn.geoms[: self._drawn.ngeom]:  # the model itself keeps its colours
            if geom.objtype == int(mujoco.mjtObj.mjOBJ_GEOM) and geom.objid in colors:
                geom.rgba[:] = colors[geom.objid]
        mujoco.mjr_render(self._rect, self._drawn, self._context)
        pixels = np.empty((self._rect.height, self._rect.width, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(pixels, None, self._rect, self._context)
        return np.ascontiguousarray(np.flipud(pixels))

    def close(self) -> None:
        """Free the drawing context; safe to call twice."""
        atexit.unregister(self._close)
        self._close()


def _gl_context(width: int, height: int) -> Any:
    """Return an OpenGL context of the backend that this machine offers."""
    backend = find_gl_backend()
    if backend not in ("egl", "osmesa", "glfw"):
        reason = "no OpenGL library was found" if backend is None else f"MUJOCO_GL is {backend!r}"
        raise RenderingError(f"Cannot draw the scene: {reason}. {_HOW_TO_INSTALL}")
    try:
        return importlib.import_module(f"mujoco.{backend}").GLContext(width, height)
    except Exception as error:  # each backend fails in its own way: ImportError, OSError, ...
        raise RenderingError(
            f"Cannot draw the scene with the OpenGL backend {backend!r} ({error}). "
            f"{_HOW_TO_INSTALL}"
        ) from error


def _free(context: mujoco.MjrContext, gl: Any) -> None:
    gl.make_current()
    context.free()
    gl.free()
