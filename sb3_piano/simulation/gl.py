"""Search for a usable OpenGL library without loading one."""

from __future__ import annotations

import ctypes.util
import os
import sys


def find_gl_backend() -> str | None:
    """Find a usable MuJoCo rendering backend.

    The environment variable ``MUJOCO_GL`` decides if set. Otherwise the backend is ``"glfw"`` with
    a screen, and on Linux without one ``"egl"`` or ``"osmesa"``, the first whose library is
    installed.

    Returns:
        ``"glfw"``, ``"egl"``, ``"osmesa"``, another value of ``MUJOCO_GL``, or ``None`` if no
        backend is usable.
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
