"""What the tests of the report share: performances written down press by press."""

import dataclasses
import math

import numpy as np
from short_scores import score_of

from sb3_piano.metrics import presses_of
from sb3_piano.music import MIN_PITCH, PianoRoll
from sb3_piano.music.constants import NUM_KEYS
from sb3_piano.performance import Performance

STEP = 0.05
C4, D4, E4 = 39, 41, 43  # keys


def note(key, onset, offset, finger=-1):
    return onset, offset, key + MIN_PITCH, finger


def performance(notes, presses, *, steps=None, pedals=(), pedal_steps=(), title="study", roll=None):
    """Return a performance.

    Args:
        notes: What is due.
        presses: What was played: (key, strike s, release s, finger) each.
        steps: Control steps of the episode; by default those of the piece.
        pedals: (onset, offset) s of each press of the pedal that is due.
        pedal_steps: The control steps at which it was down.
        title: The piece's.
        roll: What is due in place of notes and pedals.
    """
    if roll is None:
        roll = PianoRoll.from_score(score_of(*notes, pedals=pedals, title=title), STEP)
    steps = len(roll) if steps is None else steps
    key_active = np.zeros((steps, NUM_KEYS), dtype=bool)
    press_finger = np.full((steps, NUM_KEYS), -1, dtype=np.int8)
    order = []
    for key, strike, release, finger in presses:
        # what sounds at the end of a step: it ends a step after it begins
        sounds = slice(math.ceil(strike / STEP - 1e-9) - 1, math.ceil(release / STEP - 1e-9) - 1)
        key_active[sounds, key] = True
        press_finger[sounds, key] = finger
        order.append((sounds.start, key, strike, release))
    order.sort()
    found = presses_of(key_active)
    assert list(zip(found.first, found.key, strict=True)) == [row[:2] for row in order]
    sustain = np.zeros(steps, dtype=bool)
    sustain[list(pedal_steps)] = True
    return Performance(
        roll=roll,
        key_active=key_active,
        sustain=sustain,
        strike_time=np.array([row[2] for row in order]),
        strike_speed=np.ones(len(order)),
        release_time=np.array([row[3] for row in order]),
        press_finger=press_finger,
        title=title,
    )


def three_notes(title="study", **options):
    """Return C4 hit with another finger and 20 ms late, D4 missed, E4 struck late, F4 wrong."""
    return performance(
        [note(C4, 0.5, 1.0, 0), note(D4, 1.0, 1.5, 1), note(E4, 1.5, 2.0, 7)],
        [(C4, 0.52, 0.98, 1), (E4, 1.62, 2.0, 7), (E4 + 1, 0.72, 0.81, 9)],
        pedals=[(0.5, 1.0)],
        pedal_steps=range(15, 25),
        title=title,
        **options,
    )


def metrics_of(played):
    """Return all that an environment would tell of a performance."""
    returns = {"return_key_press": 10.5, "return_energy": -1.25}
    total = {"return": 9.25, "length": float(len(played)), "normalized_return": 0.5}
    return {**played.metrics(), **returns, **total}


def resting(played):
    """Return the same piece with nothing played."""
    silent = performance([], [], steps=len(played), roll=played.roll)
    return dataclasses.replace(silent, title=played.title)


def long_performance(count):
    """Return so many notes, all over the keyboard, half of them played."""
    rng = np.random.default_rng(0)
    keys, fingers = rng.integers(0, NUM_KEYS, count), rng.integers(-1, 10, count)
    notes = [
        note(int(key), 0.1 * i, 0.1 * i + 0.3, int(finger))
        for i, (key, finger) in enumerate(zip(keys, fingers, strict=True))
    ]
    roll = PianoRoll.from_score(score_of(*notes, title="long"), STEP)
    key, first, end = presses_of(roll.active & (rng.random(roll.active.shape) < 0.5))
    times = zip(key.tolist(), (first + 0.5) * STEP, (end + 0.5) * STEP, strict=True)
    return performance([], [(*press, 3) for press in times], roll=roll, title="long")
