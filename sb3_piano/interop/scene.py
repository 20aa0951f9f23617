"""The scene as dm_control's own types."""

from __future__ import annotations

import importlib
import os
from types import ModuleType
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from sb3_piano.simulation import find_gl_backend, scene_parts

if TYPE_CHECKING:
    from dm_control import mjcf


DM_CONTROL_NEEDED = (
    "pip install 'dm-control>=1.0.50' 'mujoco<4', on Python 3.11 or 3.12 (it requires labmaze, "
    "which cannot be installed on Python 3.13)"
)
"""Installation of a dm_control that works, for messages."""


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


# What MJCF calls otherwise than MuJoCo's specification does.
_INERTIAL = {"pos": "ipos", "quat": "iquat", "diaginertia": "inertia"}
_MESH = {"vertex": "uservert"}


def scene_mjcf(**options: Any) -> mjcf.RootElement:
    """Return the scene as an MJCF tree that may be changed, attached and compiled with dm_control.

    It compiles to the model of :func:`~sb3_piano.simulation.compile_scene`. Attach it to a
    composer arena by ``dm_control.composer.ModelWrapperEntity``, or to an MJCF tree by ``attach``.

    Args:
        **options: Those of :func:`~sb3_piano.simulation.compile_scene`.

    Raises:
        ConfigError: If the physics profile is unknown, or there are no such keys.
        ImportError: If dm_control is not installed.
    """
    world, *parts = (_to_mjcf(spec) for spec in scene_parts(**options))
    world.visual.remove()
    for part in parts:
        world.attach(part)
    return world


def _to_mjcf(spec: mujoco.MjSpec) -> mjcf.RootElement:
    root = import_dm_control("mjcf").from_xml_string(spec.to_xml())
    kinds = {
        "body": spec.bodies[1:],  # without the world
        "joint": spec.joints,
        "geom": spec.geoms,
        "site": spec.sites,
        "light": spec.lights,
        "actuator": spec.actuators,
        "mesh": spec.meshes,
    }
    for kind, elements in kinds.items():
        for written, exact in zip(root.find_all(kind), elements, strict=True):
            _put_back_digits(written, exact, _MESH)
            if kind == "body" and written.inertial is not None:
                _put_back_digits(written.inertial, exact, _INERTIAL)
    return root


def _put_back_digits(written: Any, exact: Any, names: dict[str, str]) -> None:
    """Undo that MuJoCo writes numbers with six digits."""
    for name, value in written.get_attributes().items():
        if isinstance(value, float | np.ndarray):
            digits = np.ravel(getattr(exact, names.get(name, name)))
            setattr(written, name, digits[: np.size(value)].reshape(np.shape(value)))
