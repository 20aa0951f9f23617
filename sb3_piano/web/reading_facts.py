"""Numbers of a scene from which the page reads a piece and makes the hands' observation."""

from __future__ import annotations

from typing import Any

import numpy as np

from sb3_piano.envs.actions import hand_action_unit
from sb3_piano.exceptions import ConfigError
from sb3_piano.reading import HandKinematics, KeyPlaces, both_hands
from sb3_piano.simulation import SIDES, PianoScene


def reading_facts(scene: PianoScene) -> dict[str, Any]:
    """Return what ``reading.json`` holds: `ReadingFacts` of the page, plain numbers and lists.

    Lengths are in m, angles in rad. Positions, velocities and geoms are addresses in MuJoCo's
    ``qpos``, ``qvel`` and ``geom_xpos``, in the order of the observation "hands".

    Raises:
        ConfigError: If the scene has not both hands.
    """
    if scene.sides != SIDES:
        raise ConfigError(
            f"The scene has the hands {scene.sides}: the page plays with both, {SIDES}."
        )
    keys, hands = KeyPlaces.of(scene), both_hands(scene)
    right = hands[0]
    along = right.index("forearm_tx")
    return {
        "keys": {
            "y": keys.y.tolist(),
            "top": keys.top.tolist(),
            "hinge": keys.hinge.tolist(),
            "max_angle": keys.max_angle.tolist(),
        },
        "hands": [_hand(scene, hand) for hand in hands],
        "slider": int(np.argmax(right.joint_of_actuator[:, along])),
        "slope": float(right.arm_slope[along]),
        "actuators": {
            "low": scene.ctrl_low.tolist(),
            "high": scene.ctrl_high.tolist(),
            "unit": hand_action_unit(scene).tolist(),
        },
    }


def _hand(scene: PianoScene, hand: HandKinematics) -> dict[str, Any]:
    tips = scene.fingertip_geom.reshape(len(scene.sides), -1)[hand.hand]
    return {
        "sign": hand.sign,
        "middle": hand.middle,
        "radius": hand.radius.tolist(),
        "tip_along": hand.tip_along.tolist(),
        "positions": scene.joint_qpos[hand.hand].tolist(),
        "velocities": scene.model.jnt_dofadr[scene.joints[hand.hand]].tolist(),
        "tip_geoms": tips.tolist(),
    }
