"""MJCF export with all digits of the numbers; MuJoCo itself writes six."""

from __future__ import annotations

from typing import Any
from xml.etree import ElementTree

import numpy as np

from sb3_piano.engine import mujoco

# Attributes of MJCF with other names in MjSpec.
_INERTIAL = {"pos": "ipos", "quat": "iquat", "diaginertia": "inertia"}
_MESH = {"vertex": "uservert"}


def exact_xml(spec: mujoco.MjSpec) -> str:
    """Export a specification as MJCF that compiles to exactly the same model.

    Six digits are exact to a millionth only. With many contacts, a performance then differs after
    seconds.
    """
    root = ElementTree.fromstring(spec.to_xml())
    parts = {
        "worldbody//body": spec.bodies[1:],  # without the world
        "worldbody//joint": spec.joints,
        "worldbody//geom": spec.geoms,
        "worldbody//site": spec.sites,
        "worldbody//light": spec.lights,
        "asset/mesh": spec.meshes,
        "actuator/*": spec.actuators,
    }
    for path, elements in parts.items():
        for written, exact in zip(root.findall(path), elements, strict=True):
            _put_back_digits(written, exact, _MESH)
            for inertial in written.findall("inertial"):
                _put_back_digits(inertial, exact, _INERTIAL)
    return ElementTree.tostring(root, encoding="unicode")


def _put_back_digits(written: ElementTree.Element, exact: Any, names: dict[str, str]) -> None:
    for name, text in written.attrib.items():
        try:
            rounded = [float(number) for number in text.split()]
        except ValueError:  # a name
            continue
        digits = np.ravel(getattr(exact, names.get(name, name)))[: len(rounded)]
        if not np.array_equal(digits, rounded):
            written.set(name, " ".join(repr(float(number)) for number in digits))
