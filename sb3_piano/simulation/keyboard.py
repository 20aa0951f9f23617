"""Keyboard: 88 hinged boxes with springs, and the beam behind them."""

from __future__ import annotations

import functools
import json
from pathlib import Path
from typing import Any

from sb3_piano.engine import mujoco
from sb3_piano.music.constants import NUM_KEYS
from sb3_piano.simulation.physics import PhysicsProfile

KEY_COLORS = {"white": (0.92, 0.92, 0.9, 1.0), "black": (0.12, 0.12, 0.13, 1.0)}
"""RGBA of a key at rest, by the key's colour."""

_BASE_COLOR = (0.18, 0.15, 0.14, 1.0)
_GRAVITY = 9.81  # MuJoCo's default, m/s^2

ALL_KEYS_MOVE = (0, NUM_KEYS - 1)
"""Lowest and highest moving key without rigid keys."""

# Servos of driven keys, with our own constants: the stiffness (N m/rad) holds a key down against
# its spring within 5 % of its travel; the damping (N m s/rad) prevents bouncing. The damping is the
# joint's, as MuJoCo integrates that implicitly.
_SERVO_STIFFNESS, _DRIVEN_DAMPING = 50.0, 0.5


@functools.cache
def table() -> dict[str, Any]:
    """Load the dimensions and constants of the 88 keys; callers must not modify them.

    The numbers are from the public RoboPianist simulation (version 1.0.10, MuJoCo 3.17.0), and a
    model built from them has the same dynamics. Other settings are MuJoCo's defaults.
    """
    file = Path(__file__).with_name("keyboard.json")
    found: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return found


def build_keyboard(
    profile: PhysicsProfile, *, gravity: bool, moving_keys: tuple[int, int], driven: bool
) -> mujoco.MjSpec:
    """Make the specification of the keyboard, to attach to a scene.

    Key ``i`` (0 = A0, 87 = C8) has the geom ``<color>_key_<i>`` and, if it moves, the joint
    ``<color>_joint_<i>``, whose angle is 0 at rest and grows as the key goes down.

    Args:
        profile: Physics profile, for ``balanced_keys`` and ``key_rebound``.
        gravity: Whether the scene has gravity, which balanced springs then balance.
        moving_keys: Lowest and highest moving key; the others are rigid, but collide as usual.
        driven: Give each moving key a position servo, ``<color>_actuator_<i>``, with a control
            range from up to fully down.
    """
    numbers = table()
    assert len(numbers["keys"]) == NUM_KEYS, "keyboard.json must describe all 88 keys"
    spec = mujoco.MjSpec()
    spec.modelname = "piano"
    spec.compiler.degree = False
    kind = mujoco.mjtGeom.mjGEOM_BOX
    box = {"type": kind, "contype": 0, "conaffinity": 1, **numbers["contact"]}
    base = numbers["base"]
    spec.worldbody.add_geom(
        name="base", **box, rgba=_BASE_COLOR, size=base["half_size"], pos=base["pos"]
    )
    joints = {color: _joint(numbers, numbers[color], profile, gravity) for color in KEY_COLORS}
    if driven:
        joints = {color: {**joint, "damping": _DRIVEN_DAMPING} for color, joint in joints.items()}
    first, last = moving_keys
    for index, key in enumerate(numbers["keys"]):
        color, kind = key["color"], numbers[key["color"]]
        body = spec.worldbody.add_body(
            name=f"{color}_key_{index}", pos=[kind["body_x"], key["y"], kind["body_z"]]
        )
        if first <= index <= last:
            body.add_joint(
                name=f"{color}_joint_{index}",
                type=mujoco.mjtJoint.mjJNT_HINGE,
                axis=[0, 1, 0],
                pos=[kind["hinge_x"], 0, 0],
                **joints[color],
            )
            if driven:
                servo = spec.add_actuator(
                    name=f"{color}_actuator_{index}",
                    target=f"{color}_joint_{index}",
                    trntype=mujoco.mjtTrn.mjTRN_JOINT,
                    ctrlrange=[0.0, kind["max_angle"]],
                )
                servo.set_to_position(kp=_SERVO_STIFFNESS)
        body.add_geom(
            name=body.name, **box, rgba=KEY_COLORS[color], size=kind["half_size"], mass=kind["mass"]
        )
    return spec


def pedal_threshold() -> float:
    """Return the pedal command, in [0, 1], at and above which the sustain pedal is down."""
    return float(table()["pedal_threshold"])


def _joint(
    numbers: dict[str, Any], kind: dict[str, Any], profile: PhysicsProfile, gravity: bool
) -> dict[str, Any]:
    """Compute the joint settings of keys of one colour."""
    joint, max_angle = numbers["joint"], kind["max_angle"]
    if not profile.balanced_keys:
        return {**joint, "range": [0, max_angle]}
    # The weight acts at the key's centre. Over a key's travel of about 5 degrees its torque about
    # the hinge (N m) is constant to 0.4 %.
    weight_torque = kind["mass"] * _GRAVITY * -kind["hinge_x"]
    torque_when_down = joint["stiffness"] * (max_angle - joint["springref"]) - weight_torque
    stiffness = torque_when_down / max_angle
    return {
        **joint,
        "range": [-profile.key_rebound, max_angle],
        "stiffness": stiffness,
        "springref": -weight_torque / stiffness if gravity else 0.0,
    }
