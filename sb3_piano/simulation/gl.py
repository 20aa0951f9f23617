"""Search for an OpenGL library that this machine can draw with, without loading any."""

from __future__ import annotations

import ctypes.util
import os
import sys


def find_gl_backend() -> str | None:
    """Return the name of a usable MuJoCo rendering backend.

    The environment variable ``MUJOCO_GL`` decides if it is set. Otherwise a screen means
    ``"glfw"``, and a Linux machine without one means ``"egl"`` or ``"osmesa"``, whichever library
    is installed.

    Returns:
        ``"glfw"``, ``"egl"``, ``"osmesa"``, another value of ``MUJOCO_GL``, or ``None`` if nothing
        can be drawn.
    """
    chosen = os.environ.get("MUJOCO_GL", "").lower().strip()
    if chosen:
        return chosen
    if not sys.platform.startswith("linux"):
        return "glfw"
    if os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        return "glfw"
    for backend, library in (("egl", "EGL"), ("osmesa", "OSMesa")):
        if ctypes.util.find_library(library) is not None:
            return backend
    return None
