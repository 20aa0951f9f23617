"""Loudness of notes: the speed of a key as MIDI's velocity."""

import pytest

from sb3_piano.music.dynamics import velocity_of


def test_each_doubling_of_the_speed_adds_the_same():
    assert [velocity_of(speed) for speed in (0.5, 1.0, 2.0, 4.0)] == [37, 62, 87, 112]


@pytest.mark.parametrize(("speed", "velocity"), [(-1.0, 1), (0.0, 1), (1e-9, 1), (1e3, 127)])
def test_speeds_beyond_the_range_have_its_ends(speed, velocity):
    assert velocity_of(speed) == velocity
