"""The search: the fingers of a hand that cost the least over a whole piece, for any model of costs.

An order-k Viterbi search (Viterbi 1967). A *state* is a way to lay fingers on all keys that are
down from one onset to the next; a cost depends on the states of an onset and of the k before it.
The search is exact unless the number of states that are followed is limited. Time and memory grow
with the number of onsets.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

States = NDArray[np.intp]
"""(states, keys): the finger, 0 (thumb) to 4, on each key."""

Table = NDArray[np.float64]

K = TypeVar("K")


@dataclass(slots=True)
class Onset(Generic[K]):
    """Keys that are down from one onset to the next."""

    down: list[K]
    """What is held and what is struck."""
    states: States
    """(states, down) ways to lay fingers on them."""


S = TypeVar("S", bound=Onset)


class CostModel(Protocol[K, S]):
    """What a hand can do, and what its fingers cost."""

    def held(self, down: list[K], struck: list[K]) -> tuple[list[K], list[K]]:
        """Return what of `down` stays when others are struck, and what has to be let go.

        What stays is in the order in which it is let go if no state can be reached with it.
        """

    def lay(self, path: Sequence[S], held: list[K], struck: list[K]) -> S:
        """Return the ways to lay fingers on what is held and what is struck."""

    def costs(self, path: Sequence[S], onset: S) -> Table:
        """Return what the states of an onset cost after those before, infinity if impossible.

        Returns:
            (..., states of the last onset, states), or what broadcasts to it.
        """


@dataclass(frozen=True)
class Fingering(Generic[K]):
    """The cheapest fingers of a hand."""

    fingers: dict[K, int]
    """The finger, 0 (thumb) to 4, of each key that is struck."""
    cost: float
    released: list[K]
    """What is let go before its end."""


def search(
    chords: Iterable[list[K]], model: CostModel[K, S], order: int, most_states: int | None = None
) -> Fingering[K]:
    """Find the fingers that cost the least, for what is struck at each onset, in order of time.

    A cost depends on ``order`` earlier onsets. Of an onset ``most_states`` states are followed, the
    cheapest; by default all.
    """
    path: list[S] = []
    backs: list[States] = []  # for the states of the last onsets: that of the one before them
    best: Table = np.zeros((1,) * order)
    released: list[K] = []
    for struck in chords:
        held, gone = model.held(path[-1].down if path else [], struck)
        released += gone
        while True:
            onset = model.lay(path, held, struck)
            total = best[..., None] + model.costs(path, onset)
            reached, back = total.min(0), total.argmin(0)
            if np.isfinite(reached).any():
                break
            assert held, "What is struck alone can always be reached."
            released.append(held.pop(0))
        if most_states is not None:
            cheapest = reached.reshape(-1, len(onset.states)).min(0).argsort(kind="stable")
            kept = cheapest[:most_states]
            onset.states, reached, back = onset.states[kept], reached[..., kept], back[..., kept]
        best = reached
        path.append(onset)
        backs.append(back)
    fingers: dict[K, int] = {}
    state = np.unravel_index(int(best.argmin()), best.shape)
    for onset, back in zip(reversed(path), reversed(backs), strict=True):
        fingers.update(zip(onset.down, onset.states[state[-1]].tolist(), strict=True))
        state = (back[state], *state[:-1])
    return Fingering(fingers, float(best.min()), released)
