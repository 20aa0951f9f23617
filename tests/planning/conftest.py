"""What saves the tests of plans half of their time."""

from __future__ import annotations

import pytest

from sb3_piano.planning import hand

_found = {}
_seek = hand.resting_posture


def _remembered(kinematics, keys):
    key = (kinematics.hand, kinematics.names)
    if key not in _found:
        _found[key] = _seek(kinematics, keys)
    return _found[key]


@pytest.fixture(autouse=True)
def each_posture_is_sought_once(monkeypatch):
    """Remember the hands' resting postures: they depend on no piece and on no physics."""
    monkeypatch.setattr(hand, "resting_posture", _remembered)
