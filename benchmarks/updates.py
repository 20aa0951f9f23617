"""Updates a second of small networks: stock Stable-Baselines3, ours, and SBX if it is installed.

    python benchmarks/updates.py --batch-size 128 1024 --device cuda

Networks of the debug presets' size (130 observations, 39 actions, two layers of 256) learn from
random transitions. Times are the processor's on a CPU, of rounds in turn, and the wall's on a GPU.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import time
from collections.abc import Iterator
from typing import Any

import gymnasium as gym
import numpy as np
import stable_baselines3
import torch
from gymnasium import spaces

from sb3_piano.policies import fast_updates
from sb3_piano.policies.batched_critics import batched_critics


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


@contextlib.contextmanager
def with_batched_critics(model: Any) -> Iterator[None]:
    """Context manager for our updates with all critics at once, also on a CPU."""
    with batched_critics(model.critic), batched_critics(model.critic_target), fast_updates(model):
        yield


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--algo", choices=["SAC", "TD3"], default="SAC")
    parser.add_argument("--batch-size", nargs="+", type=int, default=[128, 1024])
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--updates", type=int, default=60)
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    ways: dict[str, tuple[Any, Any]] = {
        "stock": (stable_baselines3, contextlib.nullcontext),
        "fast_updates": (stable_baselines3, fast_updates),
        "and batched critics": (stable_baselines3, with_batched_critics),
    }
    with contextlib.suppress(ImportError):
        ways["SBX"] = (importlib.import_module("sbx"), contextlib.nullcontext)
    for size in arguments.batch_size:
        rates: dict[str, list[float]] = {name: [] for name in ways}
        models = {name: made(package, arguments, size) for name, (package, _) in ways.items()}
        for _ in range(arguments.rounds):
            for name, (_, way) in ways.items():
                with way(models[name]):
                    rates[name].append(rate(models[name], size, arguments))
        middle = {name: np.median(found) for name, found in rates.items()}
        print(f"batches of {size}:", ", ".join(f"{n} {r:.1f}/s" for n, r in middle.items()))


def made(package: Any, arguments: argparse.Namespace, size: int) -> Any:
    """Return a model with a filled buffer."""
    settings: dict[str, Any] = {"batch_size": size, "buffer_size": 20_000, "seed": 0}
    settings |= {"policy_kwargs": {"net_arch": [256, 256]}, "learning_starts": 10**9}
    device = {"device": arguments.device} if package is stable_baselines3 else {}
    model = getattr(package, arguments.algo)("MlpPolicy", Noise(), **settings, **device)
    model.learn(2_000)
    return model


def rate(model: Any, size: int, arguments: argparse.Namespace) -> float:
    """Return updates a second, after some to warm up."""
    on_cpu = arguments.device == "cpu"
    clock = time.process_time if on_cpu else time.perf_counter
    model.train(10, size)
    start = clock()
    model.train(arguments.updates, size)
    if not on_cpu:
        torch.cuda.synchronize()
    return float(arguments.updates / (clock() - start))


if __name__ == "__main__":
    main()
