"""``dm_control.mjcf``, imported so that a machine without OpenGL can still simulate.

Importing dm_control loads a rendering library at once: without a screen it warns, and without any
OpenGL library it may fail. It reads ``MUJOCO_GL`` only while it is imported, so the variable is set
for that long, unless the user has set it.
"""

from __future__ import annotations

import os

from sb3_piano.simulation.gl import find_gl_backend

if "MUJOCO_GL" in os.environ:
    from dm_control import mjcf
else:
    os.environ["MUJOCO_GL"] = find_gl_backend() or "disable"
    try:
        from dm_control import mjcf
    finally:
        del os.environ["MUJOCO_GL"]

__all__ = ["mjcf"]
