"""Short pieces that hands can play, and how they are played."""

import dataclasses
import functools

import numpy as np
from hand_parts import SETTINGS, hand_of, keys_of, over_the_top, scene_of, sounding_share
from short_scores import score_of

from sb3_piano.envs import PianoEnv
from sb3_piano.music import MIN_PITCH, PianoRoll, Score
from sb3_piano.music.presses import presses_of_hand
from sb3_piano.planning import plan

# Enough for these pieces.
QUICK = dataclasses.replace(SETTINGS, rounds=2, iterations=8, dynamic_iterations=4)

TIMESTEP = 0.05
BUFFER = 0.5
RIGHT = (72, 74, 76, 77, 79)  # a pitch for each finger, thumb first
LEFT = (53, 52, 50, 48, 47)


def five_fingers(hand=0, *, length=0.2, order=(0, 1, 2, 3, 4), shift=0):
    """Return a score in which the fingers of a hand play one after the other."""
    pitches = (RIGHT, LEFT)[hand]
    return score_of(
        *(
            (i * length, (i + 1) * length, pitches[finger] + shift, 5 * hand + finger)
            for i, finger in enumerate(order)
        ),
        title="five fingers",
    )


def both_hands(**options):
    """Return a score in which both hands do so."""
    hands = (five_fingers(hand, **options).notes for hand in (0, 1))
    return Score(notes=[note for notes in hands for note in notes], title="both hands")


def roll_of(score):
    return PianoRoll.from_score(score, TIMESTEP, initial_buffer_time=BUFFER)


@functools.cache
def planned(score, settings=QUICK, **options):
    """Return the plan for a score; the same for the same."""
    return plan(roll_of(score), scene_of(**options), settings)


def pressed_tips(made, scene, *, cut=2):
    """Return how far planned fingertips are from where they make their keys sound, note by note.

    Args:
        made: A plan.
        scene: The scene that it was made for.
        cut: How many states at both ends of a note may be given away, if one remains.

    Returns:
        For each note how far its fingertip is off the middle of the key, and how far it is over the
        top that the key has where it begins to sound; the worst of its states, m.
    """
    off = []
    for hand in (0, 1):
        radius = hand_of(scene, hand).radius
        for press in presses_of_hand(made.roll, hand):
            middle = (press.first + press.last) // 2
            first, last = min(press.first + cut, middle), max(press.last - cut, middle)
            across, above = [], []
            for state in range(first, last + 1):
                tip = made.fingertips[state, 5 * hand + press.finger]
                point = tip - [0, 0, radius[press.finger]]
                across.append(abs(tip[1] - keys_of(scene).y[press.key]))
                share = sounding_share(scene, press.key)
                above.append(over_the_top(scene, point, press.key, share))
            off.append((max(across), max(above)))
    return np.array(off)


def piano(score, **options):
    """Return an environment with the settings that planned pianists are measured in."""
    return PianoEnv(
        score,
        **{
            "reduced_action_space": False,
            "initial_buffer_time": BUFFER,
            "physics": "fast",
            "n_steps_lookahead": 0,
            **options,
        },
    )


def key_of(pitch):
    return pitch - MIN_PITCH
