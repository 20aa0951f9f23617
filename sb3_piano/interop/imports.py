"""dm_control, imported where it is needed: it is heavy, and not to be had on every Python."""

from __future__ import annotations

import importlib
import os
from types import ModuleType

from sb3_piano.simulation import find_gl_backend

DM_CONTROL_NEEDED = (
    "pip install 'dm-control>=1.0.50' 'mujoco<4', on Python 3.11 or 3.12 (it requires labmaze, "
    "which cannot be installed on Python 3.13)"
)
"""How to get a dm_control that works, for messages."""


def import_dm_control(name: str) -> ModuleType:
    """Import a module of dm_control, also on a machine without OpenGL.

    Importing dm_control loads a rendering library at once: without a screen it warns, and without
    any OpenGL library it may fail. It reads ``MUJOCO_GL`` only while it is imported, so the
    variable is set for that long, unless the user has set it.

    Args:
        name: Such as ``"mjcf"``.

    Raises:
        ImportError: If dm_control is not installed.
    """
    chosen = os.environ.get("MUJOCO_GL")
    os.environ["MUJOCO_GL"] = chosen or find_gl_backend() or "disable"
    try:
        return importlib.import_module(f"dm_control.{name}")
    except ImportError as error:
        raise ImportError(f"This needs dm_control ({error}): {DM_CONTROL_NEEDED}") from error
    finally:
        if chosen is None:
            del os.environ["MUJOCO_GL"]
        else:
            os.environ["MUJOCO_GL"] = chosen
