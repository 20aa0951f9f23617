"""Robot hands as data: folders with MJCF files and the roles of the hand's parts."""

from sb3_piano.hands.spec import DEFAULT_HAND, HandSpec, find_hand

__all__ = ["DEFAULT_HAND", "HandSpec", "find_hand"]
