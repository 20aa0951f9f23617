"""What saves the tests of plans half of their time."""

from __future__ import annotations

import pytest

from sb3_piano.planning import hand_plan
from sb3_piano.planning.posture import resting_posture

_found = {}


def _remembered_posture(kinematics, keys, settings):
    key = (kinematics.hand, kinematics.names, settings)
    if key not in _found:
        _found[key] = resting_posture(kinematics, keys, settings)
    return _found[key]


@pytest.fixture(autouse=True)
def each_posture_is_sought_once(monkeypatch):
    """Remember the hands' resting postures: they depend on no piece and on no physics."""
    monkeypatch.setattr(hand_plan, "resting_posture", _remembered_posture)
