"""Reading of a piece: targets of both hands, state by state, from a piano roll with fingers.

A roll becomes presses (:func:`presses_of_hand`, :func:`time_presses`); these become targets of the
fingertips (:func:`key_frames`), places of the arms (:func:`wanted_places`) and a line between them.
:func:`read_piece` does all of it. Planners, observations and players use the result. Nothing is
optimised or simulated.
"""

from sb3_piano.reading.key_frames import KeyPlaces
from sb3_piano.reading.piece import Reading, both_hands, read_piece

__all__ = ["KeyPlaces", "Reading", "both_hands", "read_piece"]
