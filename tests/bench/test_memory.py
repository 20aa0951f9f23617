"""The memory of replay buffers, counted by another road."""

from __future__ import annotations

import gymnasium as gym
import pytest

from sb3_piano.bench import BenchSettings
from sb3_piano.bench.memory import memory_rows
from sb3_piano.bench.settings import ENV_ID
from sb3_piano.buffers import CompactReplayBuffer


@pytest.fixture(scope="module")
def rows():
    return memory_rows(BenchSettings(transitions=310))  # two episodes end


@pytest.mark.slow
def test_the_stock_buffer_has_two_observations_an_action_and_three_numbers_a_transition(rows):
    stock = rows[0]
    assert (stock.part, stock.name, stock.unit) == ("memory", "ReplayBuffer(1000000)", "GB")
    assert stock.value == pytest.approx(1e6 * 4 * (2 * 1124 + 39 + 3) / 1e9, rel=1e-12)
    assert stock.ratios == {}


def test_the_compact_buffer_is_as_large_as_one_of_the_full_size(rows):
    compact = rows[1]
    env = gym.make(ENV_ID)
    full = CompactReplayBuffer(1_000_000, env.observation_space, env.action_space, device="cpu")
    assert compact.name == "CompactReplayBuffer(1000000)"
    # Besides its arrays it keeps copies of the last observations of episodes: here 2 in 310, and
    # an observation is more than half of a transition.
    assert compact.value == pytest.approx(full.nbytes / 1e9, rel=0.03)
    assert compact.value > (1 + 2 / 310 / 2) * full.nbytes / 1e9
    assert compact.ratios == {"x of ReplayBuffer": pytest.approx(compact.value / rows[0].value)}
