"""Reading a piece: what a roll with fingers asks of two hands, state by state.

A roll becomes presses (:func:`presses_of_hand`, :func:`time_presses`), these become targets of the
fingertips (:func:`key_frames`), places of the arms (:func:`wanted_places`) and a line between them.
:func:`read_piece` does all of it. Planners, observations and players start from here; nothing is
optimised or simulated.
"""

from sb3_piano.music.presses import Press, presses_of_hand
from sb3_piano.reading.arms import bounds_of, dividing_line, wanted_places
from sb3_piano.reading.key_frames import KeyFrames, key_frames
from sb3_piano.reading.keyboard import KeyPlaces
from sb3_piano.reading.kinematics import HandKinematics, both_hands
from sb3_piano.reading.piece import HandReading, Reading, read_piece
from sb3_piano.reading.presses import TimedPress, time_presses

__all__ = [
    "HandKinematics",
    "HandReading",
    "KeyFrames",
    "KeyPlaces",
    "Press",
    "Reading",
    "TimedPress",
    "both_hands",
    "bounds_of",
    "dividing_line",
    "key_frames",
    "presses_of_hand",
    "read_piece",
    "time_presses",
    "wanted_places",
]
