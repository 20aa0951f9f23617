"""What the tests of the benchmark share: workloads that take a moment."""

import pytest

from sb3_piano.lab.bench import players, workloads


@pytest.fixture
def short(monkeypatch):
    """Make a benchmark that is over in seconds."""
    monkeypatch.setattr(workloads, "EPISODE_STEPS", 3)
    monkeypatch.setattr(workloads, "TRANSITIONS", 4)
    monkeypatch.setattr(workloads, "SLOTS", (1, 2))
    monkeypatch.setattr(workloads, "UPDATES", 1)
    monkeypatch.setattr(workloads, "TRAINING_STEPS", 3)
    monkeypatch.setattr(players, "PIECE", 3.0)
    monkeypatch.setattr(players, "PLANNED", 0.5)
    monkeypatch.setattr(players, "STEPS", 5)
