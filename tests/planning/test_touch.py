"""Dynamics of the planner: strikes as loud as the notes' velocities ask for."""

import dataclasses

import numpy as np
import pytest
from short_pieces import BUFFER, QUICK, five_fingers, piano, planned

from sb3_piano.music import Score
from sb3_piano.music.dynamics import velocity_of
from sb3_piano.players.planned import PlannedPianist

ORDER = (0, 2, 1, 3, 2, 4, 3, 1, 0, 2)
ASKED = (45, 85, 55, 95, 45, 70, 95, 50, 80, 60)
PLAIN = five_fingers(length=0.3, order=ORDER)
LOUD = Score(
    notes=[
        dataclasses.replace(note, velocity=velocity)
        for note, velocity in zip(PLAIN.notes, ASKED, strict=True)
    ],
    title="five fingers, soft and loud",
)


def played(score, **settings):
    """Return the velocities of the strikes, one for each note, and F1."""
    env = piano(score, fingering="robot")
    player = PlannedPianist(env, dataclasses.replace(QUICK, **settings))
    observation, _ = env.reset(seed=0)
    over, info = False, {}
    while not over:
        action, _ = player.predict(observation)
        observation, _, _, over, info = env.step(action)
    found = env.performance
    assert len(found.presses.key) == len(score.notes), "each note is struck once"
    return list(map(velocity_of, found.strike_speed, found.presses.key)), info["f1"]


@pytest.mark.slow
def test_strikes_are_as_loud_as_asked():
    struck, f1 = played(LOUD, dynamics=1)
    flat, flat_f1 = played(LOUD)
    assert np.corrcoef(struck, ASKED)[0, 1] > 0.95
    assert np.abs(np.subtract(struck, ASKED)).mean() < 0.5 * np.abs(np.subtract(flat, ASKED)).mean()
    assert f1 > flat_f1 - 0.02


def test_without_dynamics_velocities_change_nothing():
    (one, other) = (planned(score) for score in (PLAIN, LOUD))
    assert np.array_equal(one.commands, other.commands)
    assert one.passes == other.passes == 0


def test_the_roll_has_the_velocity_of_each_strike():
    roll = planned(LOUD).roll
    assert roll.onset_velocity.tolist() == list(ASKED)
    key = LOUD.notes[1].key
    first = round((BUFFER + LOUD.notes[1].onset) / roll.control_timestep)
    assert roll.velocity[first, key] == ASKED[1]
    assert np.count_nonzero(roll.velocity) == len(ASKED)
    earlier = roll.a_step_earlier()
    assert earlier.velocity[first - 1, key] == ASKED[1]
