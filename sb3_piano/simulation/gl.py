"""Search for a usable OpenGL library without loading one."""

from __future__ import annotations

import ctypes.util
import os
import sys


def find_gl_backend() -> str | None:
    """Return a usable MuJoCo rendering backend, or ``None``.

    The environment variable ``MUJOCO_GL`` decides if set. Otherwise the backend is ``"glfw"`` with
    a screen, and on Linux without one ``"egl"`` or ``"osmesa"``, the first whose library is
    installed.
    """
    chosen = os.environ.get("MUJOCO_GL", "").lower().strip()
    if chosen:
        return chosen
    has_screen = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if has_screen or not sys.platform.startswith("linux"):
        return "glfw"
    libraries = {"egl": "EGL", "osmesa": "OSMesa"}
    return next((gl for gl, name in libraries.items() if ctypes.util.find_library(name)), None)
