"""The tree: who is tried, how often, and what is believed of it."""

import math

import numpy as np
import pytest

from sb3_piano.exceptions import ConfigError
from sb3_piano.players.tree import Edge, Node, Step, Tree, TreeSettings


class Line:
    """Walk on a line, where an action is added to where one stands, and it pays to be at 1.

    Actions that are proposed are drawn; the policy's own is 0. What is expected anywhere is 0.
    """

    gamma = 0.9

    def __init__(self, length=10**6, value=lambda position: 0.0):
        self._random = np.random.default_rng(4)
        self._length, self._value = length, value
        self.judged = []

    def step(self, moment, action):
        position, steps = moment[0] + float(action[0]), moment[1] + 1
        return Step(position, -abs(position - 1), (position, steps), steps >= self._length)

    def go_back(self, moment):
        pass

    def judge(self, observation):
        self.judged.append(observation)
        return self._value(observation), np.zeros(1, dtype=np.float32)

    def propose(self, observation, mode):
        return list(self._random.uniform(-0.5, 0.5, (3, 1)).astype(np.float32))


def search(world=None, **shape):
    return Tree(world or Line(), TreeSettings(**shape)).search(0.0, (0.0, 0))


def all_nodes(node):
    return [node, *(inner for edge in node.edges for inner in all_nodes(edge.child))]


def test_sixty_four_simulations_try_eight_actions_at_the_root_the_policys_own_first():
    found = search(simulations=64, depth=8)
    assert found.root.visits == 64
    assert len(found.root.edges) == 8
    assert found.root.edges[0].action == 0
    narrow = search(simulations=64, widening=0.5)  # fewer children make deeper trees
    assert found.deepest < narrow.deepest <= 8
    assert len({float(edge.action[0]) for edge in found.root.edges}) == 8


@pytest.mark.parametrize("depth", [1, 3, 8])
def test_visits_and_values_add_up(depth):
    world = Line(length=5, value=lambda position: 0.3 + position)
    found = search(world, simulations=120, depth=depth)
    for node in all_nodes(found.root):
        below = sum(edge.child.visits for edge in node.edges)
        # A node that was new, or at which a way ends, was visited itself as well.
        ends = node.terminal or node.depth == depth
        own = 0 if node is found.root else node.visits if ends else 1
        assert node.visits == below + own
        returns = [
            edge.child.visits * edge.reward + world.gamma * edge.child.total for edge in node.edges
        ]
        assert node.total == pytest.approx(own * node.value + sum(returns), abs=1e-9)
        assert node.value == (0 if node.terminal else pytest.approx(0.3 + node.observation))
    assert found.deepest == max(node.depth for node in all_nodes(found.root)) <= min(depth, 5)


def test_a_node_has_as_many_children_as_widening_allows():
    for widening, exponent in ((1.0, 0.5), (0.5, 0.5), (2.0, 0.3)):
        shape = TreeSettings(simulations=200, widening=widening, widening_exponent=exponent)
        found = Tree(Line(), shape).search(0.0, (0.0, 0))
        for node in all_nodes(found.root):
            if node.depth < shape.depth and node.visits > 1:
                # It was last asked before its last visit.
                allowed = max(1, math.ceil(widening * (node.visits - 1) ** exponent))
                assert len(node.edges) == min(allowed, node.visits - (node is not found.root))


def test_one_step_ahead_what_earns_more_is_tried_more_and_the_most_tried_is_played():
    found = search(simulations=400, depth=1, exploration=0.3)
    edges = sorted(found.root.edges, key=lambda edge: edge.reward)
    visits = [edge.child.visits for edge in edges]
    assert sum(visits[-5:]) > 2 * sum(visits[:-5])  # of twenty
    assert found.action == max(edges, key=lambda edge: edge.child.visits).action
    assert found.visit_share == visits[-1] / 400


@pytest.mark.parametrize(("exploration", "chosen"), [(2.8, 0), (3.1, 1)])
def test_children_are_chosen_by_value_and_by_how_seldom_they_were_visited(exploration, chosen):
    """By hand: 1 + c sqrt(ln 4 / 2) against 0 + c sqrt(ln 4 / 1), which are equal at c = 2.9."""

    def node(visits, **more):
        place = {"observation": 0, "moment": 0, "depth": 1, "terminal": False}
        return Node(**place, value=0.0, mode=np.zeros(1), visits=visits, **more)

    edges = [Edge(np.zeros(1), 7.0, node(2)), Edge(np.ones(1), 3.0, node(1))]
    tree = Tree(Line(), TreeSettings(exploration=exploration))
    assert tree._chosen_edge(node(3, edges=edges)) is edges[chosen]


def test_looking_ahead_finds_what_pays_later():
    class Delayed(Line):
        """A step to the right costs, and pays in the next one."""

        def step(self, moment, action):
            right = float(action[0]) > 0
            reward = (-1.0 if right else 0.0) + (5.0 if moment[0] > 0 else 0.0)
            return Step(right, reward, (float(right), moment[1] + 1), False)

    assert search(Delayed(), simulations=100, depth=1).action <= 0
    assert search(Delayed(), simulations=100, depth=2).action > 0


def test_nothing_is_expected_after_the_end():
    hopeful = Line(length=1, value=lambda position: 1000.0)
    found = search(hopeful, simulations=30, depth=4)
    assert found.deepest == 1
    assert all(edge.child.value == 0 for edge in found.root.edges)
    assert hopeful.judged == [0.0], "the root, which a player is asked about, and no end"


def test_a_tree_may_be_written_in_short():
    assert TreeSettings.parse("64x8") == TreeSettings(simulations=64, depth=8)
    assert TreeSettings.parse("256x8x0.5") == TreeSettings(simulations=256, depth=8, widening=0.5)
    for text in ("64x8", "256x8x0.5"):
        assert str(TreeSettings.parse(text)) == text
    for text in ("64", "64x", "x8", "64x8x", "ax8", "64x8x1x2", "6.5x8"):
        with pytest.raises(ConfigError, match="expected simulations and depth such as '64x8'"):
            TreeSettings.parse(text)
    for text in ("0x8", "64x0", "64x8x0", "64x8xnan"):
        with pytest.raises(ConfigError, match="expected"):
            TreeSettings.parse(text)
