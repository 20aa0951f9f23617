"""What a benchmark refuses to measure."""

from __future__ import annotations

import pytest

from sb3_piano.bench import BenchSettings
from sb3_piano.bench.settings import ENV_ID
from sb3_piano.envs import DEBUG_IDS
from sb3_piano.exceptions import ConfigError


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"rounds": 0}, "rounds is 0: expected 1 or more."),
        ({"num_threads": 0}, "num_threads is 0: expected 1 or more."),
        ({"episode_steps": 0}, "episode_steps is 0: expected 1 or more."),
        ({"transitions": 0}, "transitions is 0: expected 1 or more."),
        ({"updates": 0}, "updates is 0: expected 1 or more."),
        ({"training_steps": 0}, "training_steps is 0: expected 1 or more."),
        ({"slots": (1, 0)}, "slots is (1, 0): expected numbers from 1 on."),
        ({"parts": ("memory", "speed")}, "parts has 'speed': expected some of simulation, learn"),
        (
            {"parts": ("memory",), "peer_python": "python"},
            "peer_python is 'python', but the simulation is not measured: expected 'simulation'",
        ),
    ],
)
def test_values_out_of_range_are_refused(settings, message):
    with pytest.raises(ConfigError) as caught:
        BenchSettings(**settings)
    assert message in str(caught.value)


def test_the_piece_is_one_that_robopianist_has_too():
    assert ENV_ID in DEBUG_IDS
