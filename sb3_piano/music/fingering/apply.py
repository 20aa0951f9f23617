"""The one door through which the fingers of a score are chosen."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

from sb3_piano.exceptions import ConfigError, near_names
from sb3_piano.music.constants import UNKNOWN_FINGER
from sb3_piano.music.score import Score

FINGERINGS = ("ergonomic", "robot", "keep", "optimal-transport")
"""Ways to choose the fingers, beside a file with labels."""


DEFAULT_TIMESTEP = 0.05
"""Length of a control step for which fingers are chosen unless one says otherwise, s."""


def apply_fingering(
    score: Score, fingering: str | os.PathLike[str], control_timestep: float = DEFAULT_TIMESTEP
) -> Score:
    """Return the score with fingers chosen in one of several ways.

    Args:
        score: The score.
        fingering: ``"ergonomic"``: each note that has no finger gets one, those that have keep
            theirs. ``"robot"``: the same, then fingers are changed where others suit the simulated
            hands better. ``"keep"``: nothing is changed. ``"optimal-transport"``: no note has a
            finger or a hand, so that the reward takes whichever fingers are nearest to the keys.
            Or the path of a file whose labels are put on the notes.
        control_timestep: Length of a control step for which the robot's fingers are chosen, s.

    Raises:
        ConfigError: If there is no such way, or no such file.
        ScoreError: If no fingers can be found, or the file's labels do not fit the score.
    """
    # The search and the readers are imported when needed: most scores bring their labels.
    if fingering == "keep":
        return score
    if fingering == "optimal-transport":
        free = [replace(note, finger=UNKNOWN_FINGER, hand=None) for note in score.notes]
        return replace(score, notes=tuple(free))
    if fingering not in FINGERINGS:
        from sb3_piano.music.fingering import read_labels

        return read_labels(labels_file(fingering), score)
    if any(note.finger == UNKNOWN_FINGER for note in score.notes):
        from sb3_piano.music.fingering import finger_score

        score = finger_score(score)
    if fingering == "robot":
        from sb3_piano.music.fingering.robot import robot_fingers

        score = robot_fingers(score, control_timestep)
    return score


def labels_file(fingering: str | os.PathLike[str]) -> Path:
    """Return the file with labels that a way of fingering names.

    Raises:
        ConfigError: If it is none of the other ways either, or there is no such file.
    """
    if not isinstance(fingering, str | os.PathLike) or not os.path.isfile(fingering):
        near = near_names(fingering, FINGERINGS) if isinstance(fingering, str) else ""
        raise ConfigError(
            f"Fingering {fingering!r} is not valid.{near} Expected "
            f"{', '.join(map(repr, FINGERINGS))} or the path of a file with labels."
        )
    return Path(fingering)
