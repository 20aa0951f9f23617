"""Apply a fingering method to a whole score."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

from sb3_piano.exceptions import ConfigError, near_names
from sb3_piano.hands import HandSpec, find_hand
from sb3_piano.music.constants import FINGERS_PER_HAND, UNKNOWN_FINGER
from sb3_piano.music.fingering.ergonomic import finger_hand
from sb3_piano.music.fingering.labels import read_labels
from sb3_piano.music.fingering.robot import robot_fingers
from sb3_piano.music.fingering.robot_hands import robot_hands
from sb3_piano.music.fingering.split import assign_hands
from sb3_piano.music.hands import HANDS, finger_of
from sb3_piano.music.score import Score

FINGERINGS = ("ergonomic", "robot", "keep", "optimal-transport")
"""Fingering methods, besides a file with labels."""

DEFAULT_TIMESTEP = 0.05
"""Default length of a control step for the robot's fingers, s."""


def apply_fingering(
    score: Score,
    fingering: str | os.PathLike[str],
    control_timestep: float = DEFAULT_TIMESTEP,
    *,
    change_hands: bool = True,
    robot: HandSpec | None = None,
) -> Score:
    """Choose the fingers of a score by one of several methods.

    Args:
        score: The score.
        fingering: ``"ergonomic"``: each note without a finger gets one; known fingers stay.
            ``"robot"``: hands, then fingers are changed where others suit the simulated hands
            better. ``"keep"``: nothing changes. ``"optimal-transport"``: no note has a finger or
            a hand, so that the reward uses the fingers nearest to the keys. Or the path of a file
            whose labels are put on the notes.
        control_timestep: Length of a control step for the robot's fingers, s.
        change_hands: Whether ``"robot"`` may change known hands.
        robot: Model of the hands, Shadow's by default. If a note has a finger that it lacks, all
            notes get fingers that suit it.

    Raises:
        ConfigError: If there is no such method or file.
        ScoreError: If the file's labels do not fit the score.
    """
    robot = robot or find_hand()
    if fingering == "optimal-transport":
        return without_fingers(score, keep_hands=False)
    if fingering not in FINGERINGS:
        score = read_labels(labels_file(fingering), score)
    if fingering == "robot" and change_hands:
        score = robot_hands(score, control_timestep, robot)
    unknown = any(note.finger == UNKNOWN_FINGER for note in score.notes)
    if fingering in ("ergonomic", "robot") and unknown:
        score = finger_score(score)
    if fingering == "robot" or _lacks_fingers(score, robot):
        score = robot_fingers(score, control_timestep, robot)
    return score


def _lacks_fingers(score: Score, robot: HandSpec) -> bool:
    """Return whether a note has a finger that the hands do not have."""
    known = (note.finger for note in score.notes if note.finger != UNKNOWN_FINGER)
    return any(finger % FINGERS_PER_HAND >= len(robot.fingers) for finger in known)


def finger_score(score: Score) -> Score:
    """Give each note of a score a finger.

    Known fingers and hands stay; `assign_hands` finds the other hands. At most ten fingers are on
    keys at a time, each on one key. A hand may have too many keys to hold, as when a sustain pedal
    is written out as long notes. It then releases the key held longest first: that note keeps its
    length, but its finger moves on. If a hand strikes more than five keys together, the outer five
    get a finger; the others get their hand and no finger (-1). Notes keep their times, pitches and
    velocities.
    """
    score = assign_hands(score)
    notes = list(score.notes)
    for hand in HANDS:
        indices = [index for index, note in enumerate(notes) if note.hand == hand]
        found = finger_hand([notes[index] for index in indices], hand)
        for index, finger in zip(indices, found.fingers, strict=True):
            if notes[index].finger == UNKNOWN_FINGER != finger:
                notes[index] = replace(notes[index], finger=finger_of(hand, finger + 1))
    return replace(score, notes=tuple(notes))


def without_fingers(score: Score, *, keep_hands: bool) -> Score:
    """Remove all fingers from a score, and hands unless they are kept."""
    notes = [
        replace(note, finger=UNKNOWN_FINGER, hand=note.hand if keep_hands else None)
        for note in score.notes
    ]
    return replace(score, notes=tuple(notes))


def labels_file(fingering: str | os.PathLike[str]) -> Path:
    """Return the path of a labels file given as a fingering.

    Raises:
        ConfigError: If there is no such file.
    """
    if not isinstance(fingering, str | os.PathLike) or not os.path.isfile(fingering):
        near = near_names(fingering, FINGERINGS) if isinstance(fingering, str) else ""
        raise ConfigError(
            f"Fingering {fingering!r} is not valid.{near} Expected "
            f"{', '.join(map(repr, FINGERINGS))} or the path of a file with labels."
        )
    return Path(fingering)
