"""Find the fingers of a hand with the least total cost, for any cost model.

This is an order-k Viterbi search (Viterbi 1967). A *state* assigns fingers to all keys that are
down from one onset to the next; a cost depends on the states of an onset and of the k before it.
The search is exact unless the number of states is limited. Time and memory grow with the onsets.
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
    """Held and struck keys."""
    states: States
    """(states, down) assignments of fingers to them."""


S = TypeVar("S", bound=Onset)


class CostModel(Protocol[K, S]):
    """Model of a hand: possible fingers and their costs."""

    def held(self, down: list[K], struck: list[K]) -> tuple[list[K], list[K]]:
        """Split `down` into keys that stay held at the next strike and keys that are released.

        Held keys are in order of release, for the case that no state can be reached with them.
        """

    def lay(self, path: Sequence[S], held: list[K], struck: list[K]) -> S:
        """Return the assignments of fingers to held and struck keys."""

    def costs(self, path: Sequence[S], onset: S) -> Table:
        """Compute the costs of an onset's states after the path; infinity if impossible.

        Returns:
            (..., states of the last onset, states), or an array that broadcasts to it.
        """


@dataclass(frozen=True)
class Fingering(Generic[K]):
    """The cheapest fingers of a hand."""

    fingers: dict[K, int]
    """The finger, 0 (thumb) to 4, of each struck key."""
    cost: float
    released: list[K]
    """Keys released before their end."""


def search(
    chords: Iterable[list[K]], model: CostModel[K, S], order: int, most_states: int | None = None
) -> Fingering[K]:
    """Find the fingers with the least cost for the keys struck at each onset, in order of time.

    A cost depends on ``order`` earlier onsets. The cheapest ``most_states`` states of an onset are
    kept; by default all.
    """
    path: list[S] = []
    backs: list[States] = []  # for the states of the last onsets, the best state before them
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
