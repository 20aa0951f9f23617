"""Loudness of notes: the speed of a key as MIDI's velocity."""

import numpy as np
import pytest

from sb3_piano.music.constants import KEY_IS_BLACK
from sb3_piano.music.dynamics import TRAVEL, speed_of, velocity_of
from sb3_piano.simulation.keyboard import table

WHITE, BLACK = 39, 40


def test_each_doubling_of_the_speed_adds_the_same():
    assert [velocity_of(speed, WHITE) for speed in (0.5, 1.0, 2.0, 4.0)] == [23, 48, 73, 98]


def test_keys_that_take_as_long_for_their_travel_are_equally_loud():
    for key in (WHITE, BLACK):
        assert [velocity_of(TRAVEL[key] / s, key) for s in (1 / 16, 1 / 32, 1 / 64)] == [
            50,
            75,
            100,
        ]


def test_the_travels_are_those_of_the_keyboard():
    of = {bool(black): float(travel) for black, travel in zip(KEY_IS_BLACK, TRAVEL, strict=True)}
    numbers = table()
    assert of == {False: numbers["white"]["max_angle"], True: numbers["black"]["max_angle"]}
    assert np.shape(TRAVEL) == (88,)


@pytest.mark.parametrize("key", [WHITE, BLACK])
def test_speeds_and_velocities_are_inverse(key):
    velocities = list(range(1, 128))
    assert [velocity_of(speed_of(velocity, key), key) for velocity in velocities] == velocities


@pytest.mark.parametrize(("speed", "velocity"), [(-1.0, 1), (0.0, 1), (1e-9, 1), (1e3, 127)])
def test_speeds_beyond_the_range_have_its_ends(speed, velocity):
    assert velocity_of(speed, WHITE) == velocity
