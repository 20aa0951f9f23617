"""Robot hands as data: a folder with MJCF and the roles of its parts is a hand."""

from sb3_piano.hands.spec import DEFAULT_HAND, HandSpec, find_hand

__all__ = ["DEFAULT_HAND", "HandSpec", "find_hand"]
