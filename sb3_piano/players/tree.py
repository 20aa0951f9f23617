"""Monte Carlo tree search over actions: nodes, visits and values."""

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
"""Siblings whose values differ by no more count as equal (the paper's 1e-8)."""

_NOTHING = np.zeros(0, dtype=np.float32)


@settings
class TreeSettings:
    """Size and shape of a search tree.

    Raises:
        ConfigError: If a value is out of range.
    """

    simulations: Count = 64
    """Simulations in each control step."""
    depth: Count = 8
    """Control steps from the root at which nodes have no children."""
    exploration: NotNegative = 1.0
    """Weight of the exploration bonus for rarely visited children."""
    widening: Positive = 1.0
    """A node of N visits gets a new child while it has fewer than this times N to the power
    ``widening_exponent``."""
    widening_exponent: Annotated[Number, Gt(0), Le(1)] = 0.5
    """See ``widening``; above 0, at most 1."""

    @classmethod
    def parse(cls, text: str) -> TreeSettings:
        """Parse "64x8", simulations and depth, or "64x8x0.5" with ``widening``.

        Raises:
            ConfigError: If the text has another form.
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
    """Result of a control step that was tried."""

    observation: Any
    """Observation after it."""
    reward: float
    """Its reward."""
    moment: Any
    """State after it, for further steps."""
    terminal: bool
    """Whether it ended the episode."""


class World(Protocol):
    """Simulated environment of a tree search."""

    gamma: float
    """Discount of a control step."""

    def go_back(self, moment: Any) -> None:
        """Restore a state."""

    def step(self, moment: Any, action: Float32Array) -> Step:
        """Try an action in a state."""

    def judge(self, observation: Any) -> tuple[float, Float32Array]:
        """Return the value of the present state, and the policy's action there.

        It is not called after an episode's end.
        """

    def propose(self, observation: Any, mode: Float32Array) -> Sequence[Float32Array]:
        """Propose actions other than the policy's own."""


class Edge(NamedTuple):
    """Action that was tried, with its reward and the next node."""

    action: Float32Array
    reward: float
    child: Node


@dataclass(eq=False, slots=True, kw_only=True)
class Node:
    """State in a search tree, with its statistics."""

    observation: Any
    moment: Any
    depth: int
    """Control steps from the root."""
    terminal: bool
    value: float
    """Value without further lookahead; 0 after the episode's end."""
    mode: Float32Array
    """The policy's own action, which is tried first; empty after the episode's end."""
    visits: int = 0
    """Number of simulations through this node."""
    total: float = 0.0
    """Sum of their returns from this node."""
    edges: list[Edge] = field(default_factory=list)
    proposals: list[Float32Array] = field(default_factory=list)
    """Other actions not yet tried."""


class Found(NamedTuple):
    """Result of a search."""

    action: Float32Array
    """Most visited action at the root; in a tie the one with the higher value."""
    root: Node
    """Root of the tree."""
    deepest: int
    """Depth of its deepest node, in control steps."""
    visit_share: float
    """Share of the simulations that went to the action with the highest value."""


class Tree:
    """Monte Carlo tree search for the next action.

    Each simulation descends from the root. A node with fewer children than ``widening`` allows gets
    a new child, first for the policy's own action and then for samples of it. The new node's value
    is the critics' value of the policy's action there, or 0 after the episode's end. From any other
    node the simulation descends to the child with the greatest sum of value and exploration bonus,
    down to ``depth``. Then its return is added to all nodes on its path.

    Source: "Curriculum Strategies for Bimanual Dexterous Piano Playing in RoboPianist", appendix A:
    UCT (Kocsis and Szepesvári 2006) with values scaled to the range of siblings, and progressive
    widening.
    """

    def __init__(self, world: World, shape: TreeSettings):
        """Take the world to search in and the tree's settings."""
        self._world = world
        self._shape = shape

    def search(self, observation: Any, moment: Any) -> Found:
        """Search the best action in a state with an observation."""
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
        """Compute the mean return of an action, including its own reward."""
        return edge.reward + self._world.gamma * edge.child.total / edge.child.visits

    def _simulate(self, root: Node) -> int:
        """Run one simulation and add its return along the path; return the depth reached."""
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
        # No action follows an episode's end.
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
