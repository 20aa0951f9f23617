"""SBX's updates for benchmarks/updates.py, which starts this with a Python that has sbx-rl.

It reads a line for each turn (algorithm, batch size, updates) and answers with the seconds that
these took, by the processor's clock and by the wall's.
"""

from __future__ import annotations

import importlib
import sys
import time
from typing import Any

import gymnasium as gym
from gymnasium import spaces


class Noise(gym.Env[Any, Any]):
    """Random observations of the size of the piano's "fingers"."""

    observation_space = spaces.Box(-1, 1, (130,))
    action_space = spaces.Box(-1, 1, (39,))

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode."""
        super().reset(seed=seed)
        return self.observation_space.sample(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Return another observation."""
        del action
        return self.observation_space.sample(), 0.0, False, False, {}


def made(algorithm: Any, size: int, **options: Any) -> Any:
    """Return a model of the debug presets' size, with transitions in its buffer."""
    settings: dict[str, Any] = {"batch_size": size, "buffer_size": 20_000, "seed": 0}
    settings |= {"policy_kwargs": {"net_arch": [256, 256]}, "learning_starts": 10**9}
    model = algorithm("MlpPolicy", Noise(), **settings, **options)
    model.learn(2_000)
    return model


def seconds(model: Any, size: int, updates: int) -> tuple[float, float]:
    """Return how long updates take, by the processor's clock and by the wall's."""
    wall, processor = time.perf_counter(), time.process_time()
    model.train(updates, size)
    return time.process_time() - processor, time.perf_counter() - wall


def main() -> None:
    """Answer each line."""
    models: dict[tuple[str, int], Any] = {}
    for line in sys.stdin:
        name, *numbers = line.split()
        size, updates = map(int, numbers)
        if (name, size) not in models:
            models[name, size] = made(getattr(importlib.import_module("sbx"), name), size)
            models[name, size].train(updates, size)  # which compiles
        print(*seconds(models[name, size], size, updates), flush=True)


if __name__ == "__main__":
    main()
