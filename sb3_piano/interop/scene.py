"""The scene as ``dm_control.mjcf``, for composer worlds."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from sb3_piano.interop.imports import import_dm_control
from sb3_piano.simulation import scene_parts

if TYPE_CHECKING:
    from dm_control import mjcf

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
