"""The scene as dm_control's own types."""

from __future__ import annotations

import importlib
import os
from types import ModuleType
from typing import TYPE_CHECKING, Any

from sb3_piano.simulation.compiling import scene_parts
from sb3_piano.simulation.exact_xml import exact_xml
from sb3_piano.simulation.gl import find_gl_backend

if TYPE_CHECKING:
    from dm_control import mjcf


DM_CONTROL_NEEDED = (
    "pip install 'dm-control>=1.0.50' 'mujoco<4', on Python 3.11 or 3.12 (it requires labmaze, "
    "which cannot be installed on Python 3.13)"
)
"""Installation command of dm_control, for messages."""


def import_dm_control(name: str) -> ModuleType:
    """Import a module of dm_control, such as "mjcf", also on a machine without OpenGL.

    Importing dm_control loads a rendering library at once: without a screen it warns, and without
    any OpenGL library it may fail. It reads ``MUJOCO_GL`` only while it is imported, so the
    variable is set for that long, unless the user has set it.

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


def scene_mjcf(**options: Any) -> mjcf.RootElement:
    """Return the scene as an MJCF tree of dm_control, to edit, attach and compile.

    It compiles to the model of :func:`~sb3_piano.simulation.compile_scene`. Attach it to a
    composer arena by ``dm_control.composer.ModelWrapperEntity``, or to an MJCF tree by ``attach``.

    Args:
        **options: Those of :func:`~sb3_piano.simulation.compile_scene`.

    Raises:
        ConfigError: If the physics profile is unknown, or there are no such keys.
        ImportError: If dm_control is not installed.
    """
    mjcf = import_dm_control("mjcf")
    world, *parts = (mjcf.from_xml_string(exact_xml(spec)) for spec in scene_parts(**options))
    world.visual.remove()
    for part in parts:
        world.attach(part)
    return world
