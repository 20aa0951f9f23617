"""MuJoCo, also where ``MUJOCO_GL`` asks for what this machine cannot draw with.

MuJoCo loads an OpenGL library while it is imported, and some ways in which that fails end the
import. Whoever plays or trains draws nothing, so here it is imported without one then; what draws
says what is missing.
"""

from __future__ import annotations

import os

try:
    import mujoco
except Exception:  # each library fails in its own way: RuntimeError, AttributeError, ...
    chosen = os.environ.get("MUJOCO_GL", "")
    os.environ["MUJOCO_GL"] = "disable"
    try:
        import mujoco
    finally:
        os.environ["MUJOCO_GL"] = chosen
from mujoco.batch import Batch

__all__ = ["Batch", "mujoco"]
