"""Which fingers can be on the keys of a slice: all ways that a hand can be laid on them."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from sb3_piano.music.constants import FINGERS_PER_HAND, THUMB

Shape = tuple[tuple[bool, int], ...]
"""For each key from the thumb's side: whether it is struck now (else held), its known finger."""

States = NDArray[np.intp]
"""(states, keys): the finger, 0 (thumb) to 4, on each key."""


@lru_cache(maxsize=4096)
def finger_states(shape: Shape, in_order: bool = True) -> States:
    """Return every way to lay fingers on the keys, in a definite order.

    Each key has a finger of its own, and fingers follow the order of the keys. Two exceptions:
    the thumb may have passed under fingers that hold keys, or fingers over a thumb that does;
    and labels stay as they are, even if two contradict each other.

    Args:
        shape: The keys.
        in_order: Whether fingers follow the order of the keys.

    Returns:
        (states, keys); no states if the labels leave no finger for another key.
    """
    found: list[tuple[int, ...]] = []
    _extend(shape, in_order, (), found)
    return np.array(found, dtype=np.intp).reshape(len(found), len(shape))


def _extend(
    shape: Shape, in_order: bool, fingers: tuple[int, ...], found: list[tuple[int, ...]]
) -> None:
    place = len(fingers)
    if place == len(shape):
        found.append(fingers)
        return
    struck, label = shape[place]
    for finger in range(FINGERS_PER_HAND) if label < 0 else (label,):
        if all(
            _fit(shape[below], fingers[below], (struck, label), finger, in_order)
            for below in range(place)
        ):
            _extend(shape, in_order, (*fingers, finger), found)


def _fit(
    lower: tuple[bool, int], low: int, upper: tuple[bool, int], high: int, in_order: bool
) -> bool:
    if lower[1] >= 0 and upper[1] >= 0:
        return True
    if low == high or not in_order:
        return low != high
    both_struck = lower[0] and upper[0]
    return low < high or (high == THUMB and not both_struck)


@lru_cache(maxsize=4096)
def playable(shape: Shape) -> tuple[tuple[int, ...], bool]:
    """Return the places of the keys that get a finger, and whether fingers follow their order.

    A struck key goes without a finger only if more than five are struck: then the outer ones come
    first. Fingers leave the order of the keys only where labels give them no other way.
    """
    labelled = [place for place, (_, label) in enumerate(shape) if label >= 0]
    free = [place for place, (_, label) in enumerate(shape) if label < 0]
    for count in range(min(len(free), FINGERS_PER_HAND), 0, -1):
        # Turn by turn from both ends.
        outer = [free[turn // 2 if turn % 2 == 0 else -1 - turn // 2] for turn in range(count)]
        places = tuple(sorted([*labelled, *outer]))
        chosen = tuple(shape[place] for place in places)
        for in_order in (True, False):
            if len(finger_states(chosen, in_order)):
                return places, in_order
    return tuple(labelled), True
