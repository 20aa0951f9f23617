"""Trees of what may be played next, searched by trying it: nodes, visits and values."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, NamedTuple, Protocol

import numpy as np
from annotated_types import Gt, Le

from sb3_piano.arrays import Float32Array
from sb3_piano.exceptions import ConfigError
from sb3_piano.settings import Count, NotNegative, Number, Positive, settings

_EQUAL = 1e-8
"""Values of siblings that are no further apart are not told from each other (the paper's 1e-8)."""

_NOTHING = np.zeros(0, dtype=np.float32)


@settings
class TreeSettings:
    """Size and shape of a tree.

    Raises:
        ConfigError: If a value is out of range.
    """

    simulations: Count = 64
    """Simulations in each control step."""
    depth: Count = 8
    """Control steps from the root at which nodes have no children."""
    exploration: NotNegative = 1.0
    """Weight of what draws the search to children that were visited seldom."""
    widening: Positive = 1.0
    """A node of N visits gets a new child while it has fewer than this times N to the power
    ``widening_exponent``."""
    widening_exponent: Annotated[Number, Gt(0), Le(1)] = 0.5
    """See ``widening``; above 0, at most 1."""

    @classmethod
    def parse(cls, text: str) -> TreeSettings:
        """Return what "64x8" stands for, simulations and depth, or "64x8x0.5" with ``widening``.

        Raises:
            ConfigError: If the text is no such thing.
        """
        try:
            simulations, depth, *widening = text.split("x")
            shape = {"widening": float(*widening)} if widening else {}
            return cls(simulations=int(simulations), depth=int(depth), **shape)
        except (ValueError, TypeError):
            raise ConfigError(
                f"A tree cannot be {text!r}: expected simulations and depth such as '64x8', or "
                "with the widening, '64x8x0.5'."
            ) from None

    def __str__(self) -> str:
        default = type(self)
        widening = "" if self.widening == default.widening else f"x{self.widening:g}"
        return f"{self.simulations}x{self.depth}{widening}"


class Step(NamedTuple):
    """A control step that was tried."""

    observation: Any
    """What is observed after it."""
    reward: float
    """What it earned."""
    moment: Any
    """Where it led, to go on from there."""
    terminal: bool
    """Whether the episode ended with it."""


class World(Protocol):
    """What a tree is searched in."""

    gamma: float
    """Discount of a control step."""

    def go_back(self, moment: Any) -> None:
        """Go to a moment."""

    def step(self, moment: Any, action: Float32Array) -> Step:
        """Try an action in a moment."""

    def judge(self, observation: Any) -> tuple[float, Float32Array]:
        """Return what is still to be expected where the world is now, and the policy's action.

        It is not asked where the episode has ended.
        """

    def propose(self, observation: Any, mode: Float32Array) -> Sequence[Float32Array]:
        """Return some actions other than the policy's own."""


class Edge(NamedTuple):
    """An action that was tried, and where it led."""

    action: Float32Array
    reward: float
    child: Node


@dataclass(eq=False, slots=True, kw_only=True)
class Node:
    """A state, and what was found out about it."""

    observation: Any
    moment: Any
    depth: int
    """Control steps from the root."""
    terminal: bool
    value: float
    """What is expected without looking further ahead; 0 where the episode has ended."""
    mode: Float32Array
    """The policy's own action, the first that is tried; empty where the episode has ended."""
    visits: int = 0
    """How many simulations came here."""
    total: float = 0.0
    """Sum of the returns from here that they found."""
    edges: list[Edge] = field(default_factory=list)
    proposals: list[Float32Array] = field(default_factory=list)
    """Other actions that are yet to be tried."""


class Found(NamedTuple):
    """Result of a search."""

    action: Float32Array
    """The action at the root that was tried most, of equals the one with the higher value."""
    root: Node
    """The whole tree."""
    deepest: int
    """Depth of its deepest node, in control steps."""
    visit_share: float
    """Share of the simulations that went to the action with the highest value."""


class Tree:
    """Searches what to do in a world, by trying it.

    Each simulation goes down from the root. A node with fewer children than ``widening`` allows
    gets one more, the policy's own action first and then samples of it: the new node's value is
    what the critics expect of the policy's action there, or 0 where the episode has ended. From any
    other node it goes on to the child with the greatest sum of value and of what draws it to seldom
    visited ones, down to ``depth``. Then the return that it found is added to all nodes on its way.

    Source: "Curriculum Strategies for Bimanual Dexterous Piano Playing in RoboPianist", appendix A:
    UCT (Kocsis and Szepesvári 2006) with values between the least and the greatest of siblings, and
    progressive widening.
    """

    def __init__(self, world: World, shape: TreeSettings):
        """Choose where and how to search."""
        self._world = world
        self._shape = shape

    def search(self, observation: Any, moment: Any) -> Found:
        """Return what to do in a moment in which something is observed."""
        self._world.go_back(moment)
        root = self._node(observation, moment, depth=0, terminal=False)
        deepest = 0
        for _ in range(self._shape.simulations):
            deepest = max(deepest, self._simulate(root))
        visits = [edge.child.visits for edge in root.edges]
        values = [self.edge_value(edge) for edge in root.edges]
        best = max(range(len(visits)), key=lambda index: (visits[index], values[index]))
        return Found(
            action=root.edges[best].action,
            root=root,
            deepest=deepest,
            visit_share=visits[int(np.argmax(values))] / root.visits,
        )

    def edge_value(self, edge: Edge) -> float:
        """Return the mean return that was found behind an action, its own reward included."""
        return edge.reward + self._world.gamma * edge.child.total / edge.child.visits

    def _simulate(self, root: Node) -> int:
        """Go down once, and tell all on the way what was found; return how deep it went."""
        path, node = list[Edge](), root
        while not node.terminal and node.depth < self._shape.depth:
            edge = self._new_edge(node) if self._widens(node) else self._chosen_edge(node)
            path.append(edge)
            node = edge.child
            if not node.visits:
                break
        found = node.value
        node.visits += 1
        node.total += found
        for edge, parent in zip(
            reversed(path), reversed([root, *(e.child for e in path[:-1])]), strict=True
        ):
            found = edge.reward + self._world.gamma * found
            parent.visits += 1
            parent.total += found
        return node.depth

    def _widens(self, node: Node) -> bool:
        allowed = self._shape.widening * node.visits**self._shape.widening_exponent
        return not node.edges or len(node.edges) < allowed

    def _new_edge(self, node: Node) -> Edge:
        if not node.edges:
            action = node.mode
        else:
            if not node.proposals:
                node.proposals = list(self._world.propose(node.observation, node.mode))
            action = node.proposals.pop(0)
        step = self._world.step(node.moment, action)
        child = self._node(step.observation, step.moment, node.depth + 1, step.terminal)
        node.edges.append(Edge(action, step.reward, child))
        return node.edges[-1]

    def _node(self, observation: Any, moment: Any, depth: int, terminal: bool) -> Node:
        # Where the episode has ended nothing is played any more.
        value, mode = (0.0, _NOTHING) if terminal else self._world.judge(observation)
        return Node(
            observation=observation,
            moment=moment,
            depth=depth,
            terminal=terminal,
            value=value,
            mode=mode,
        )

    def _chosen_edge(self, node: Node) -> Edge:
        values = [self.edge_value(edge) for edge in node.edges]
        least, greatest = min(values), max(values)
        spread = greatest - least
        log = math.log(node.visits + 1)

        def appeal(index: int) -> float:
            share = (values[index] - least) / spread if spread > _EQUAL else 0.0
            child = node.edges[index].child
            return share + self._shape.exploration * math.sqrt(log / child.visits)

        return node.edges[max(range(len(values)), key=appeal)]
