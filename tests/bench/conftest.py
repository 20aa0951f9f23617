"""What the tests of the benchmark share: settings that take a moment."""

from __future__ import annotations

import pytest

from sb3_piano.bench import BenchSettings

SHORT = {
    "rounds": 1,
    "slots": (1, 2),
    "episode_steps": 3,
    "transitions": 4,
    "updates": 2,
    "training_steps": 3,
}


@pytest.fixture
def short():
    """Return a function that makes settings of a benchmark that is over in seconds."""

    def make(**changes):
        return BenchSettings(**{**SHORT, **changes})

    return make
