"""Constants of a scene for the web page's sight-reader and its observations."""

from __future__ import annotations

from typing import Any

import numpy as np

from sb3_piano.exceptions import ConfigError
from sb3_piano.reading import KeyPlaces, both_hands
from sb3_piano.simulation import PianoScene
from sb3_piano.simulation.scene import SIDES


def reading_facts(scene: PianoScene) -> dict[str, Any]:
    """Return the content of ``reading.json``: plain numbers and lists, in m and rad.

    The names are those of ``ReadingFacts`` in ``web/src/reading/facts.ts``.

    Raises:
        ConfigError: If the scene does not have both hands.
    """
    if scene.sides != SIDES:
        raise ConfigError(
            f"The scene has the hands {scene.sides}: expected both, {SIDES}, since the page plays "
            "with both."
        )
    keys, hands = KeyPlaces.of(scene), both_hands(scene)
    right = hands[0]
    along = right.along
    return {
        "keys": {
            "y": keys.y.tolist(),
            "top": keys.top.tolist(),
            "hinge": keys.hinge.tolist(),
            "maxAngle": keys.max_angle.tolist(),
        },
        "hands": [
            {
                "sign": hand.sign,
                "middle": hand.middle,
                "radius": hand.radius.tolist(),
                "tipAlong": hand.tip_along.tolist(),
            }
            for hand in hands
        ],
        "slider": int(np.argmax(right.joint_of_actuator[:, along])),
        "slope": right.slope,
    }
