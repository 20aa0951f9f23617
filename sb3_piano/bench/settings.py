"""What a benchmark measures, and how long."""

from __future__ import annotations

from dataclasses import dataclass

from sb3_piano.exceptions import ConfigError

ENV_ID = "RoboPianist-debug-CMajorScaleTwoHands-v0"
"""The environment on which everything is measured."""

PARTS = ("simulation", "learner", "memory")
"""What can be measured."""

_COUNTS = ("rounds", "num_threads", "episode_steps", "transitions", "updates", "training_steps")


@dataclass(frozen=True, kw_only=True)
class BenchSettings:
    """The settings of a benchmark.

    Raises:
        ConfigError: If a value is out of range.
    """

    parts: tuple[str, ...] = PARTS
    """What is measured; some of :data:`PARTS`."""
    rounds: int = 10
    """How often everything is measured, besides one round to warm up; at least 1."""
    peer_python: str | None = None
    """An interpreter that has RoboPianist, which is then measured as well."""
    num_threads: int | None = None
    """Threads of torch, at least 1; by default one, see :mod:`sb3_piano.torch_threads`."""
    slots: tuple[int, ...] = (1, 2, 4, 8)
    """Numbers of slots of the vector environment."""
    episode_steps: int | None = None
    """Control steps of an episode of the simulation; ``None`` plays whole ones."""
    transitions: int = 500
    """Transitions in the replay buffer before the learner is measured."""
    updates: int = 20
    """Updates of the networks in a round."""
    training_steps: int = 30
    """Environment steps of whole training in a round."""

    def __post_init__(self) -> None:
        for part in self.parts:
            if part not in PARTS:
                raise ConfigError(f"parts has {part!r}: expected some of {', '.join(PARTS)}.")
        for name in _COUNTS:
            value = getattr(self, name)
            if value is not None and value < 1:
                raise ConfigError(f"{name} is {value}: expected 1 or more.")
        if min(self.slots, default=1) < 1:
            raise ConfigError(f"slots is {self.slots}: expected numbers from 1 on.")
        if self.peer_python is not None and "simulation" not in self.parts:
            raise ConfigError(
                f"peer_python is {self.peer_python!r}, but the simulation is not measured: "
                "expected 'simulation' among the parts, or no peer."
            )
