"""How fast a preset trains, and where the time goes.

    python benchmarks/training_speed.py --algo td3 --steps 1000

Trains past the steps without learning, then measures ``--steps`` environment steps: the share of
the simulation (``env.step``), of the learner (``model.train``), and of all else (the policy's
actions, the replay buffer, callbacks).
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import torch
from stable_baselines3.common.callbacks import BaseCallback

from sb3_piano.training import load_config
from sb3_piano.training.builders import build_model, build_vec_env

WARM_UP = 50
"""Environment steps with learning before the measurement begins."""


class Stopwatch:
    """Adds up the time that functions take."""

    def __init__(self) -> None:
        self.seconds = 0.0

    def wrap(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return the function, timed."""

        def timed(*args: Any, **kwargs: Any) -> Any:
            start = time.perf_counter()
            try:
                return function(*args, **kwargs)
            finally:
                self.seconds += time.perf_counter() - start

        return timed


class Measurement(BaseCallback):
    """Start the clocks once the learner is at work."""

    def __init__(self, first_step: int, clocks: tuple[Stopwatch, ...]) -> None:
        super().__init__()
        self.first_step = first_step
        self.clocks = clocks
        self.started_at: int | None = None
        self.start = 0.0

    def _on_rollout_start(self) -> None:
        if self.started_at is None and self.model.num_timesteps >= self.first_step:
            self.started_at = self.model.num_timesteps
            self.start = time.perf_counter()
            for clock in self.clocks:
                clock.seconds = 0.0

    def _on_step(self) -> bool:
        return True


def measure(algo: str, env_id: str, steps: int, learning_starts: int, n_envs: int) -> None:
    """Train and print what it took."""
    config = load_config(
        algo, env_id, seed=0, n_envs=n_envs, learning_starts=learning_starts,
        monitor_kwargs={}, buffer_size=learning_starts + WARM_UP + 2 * steps,
    )  # fmt: skip
    venv = build_vec_env(config)
    model = build_model(config, venv)
    simulation, learner = Stopwatch(), Stopwatch()
    venv.step = simulation.wrap(venv.step)  # type: ignore[method-assign]
    model.train = learner.wrap(model.train)  # type: ignore[attr-defined]
    first_step = learning_starts + WARM_UP
    measurement = Measurement(first_step, (simulation, learner))
    model.learn(first_step + steps, callback=measurement)
    total = time.perf_counter() - measurement.start
    assert measurement.started_at is not None, "the training is longer than its warm-up"
    done = model.num_timesteps - measurement.started_at
    venv.close()
    print(f"{algo} on {env_id}, {n_envs} environment(s), {torch.get_num_threads()} torch thread(s)")
    print(f"{done} steps in {total:.1f} s: {done / total:.1f} steps/s")
    rest = total - simulation.seconds - learner.seconds
    parts = {"simulation": simulation.seconds, "learner": learner.seconds, "rest": rest}
    for name, seconds in parts.items():
        print(f"  {name:<11}{seconds / total:6.1%}  {1000 * seconds / done:8.2f} ms per step")


def main() -> None:
    """Read the command line and measure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--algo", default="td3", help="an algorithm with a preset; default: td3")
    parser.add_argument("--env", default="RoboPianist-debug-TwinkleTwinkleLittleStar-v0")
    parser.add_argument("--steps", type=int, default=1000, help="environment steps to measure")
    parser.add_argument(
        "--learning-starts", type=int, default=500,
        help="random steps before learning; the preset's 5000 cost time and change nothing",
    )  # fmt: skip
    parser.add_argument("--n-envs", type=int, default=1)
    parser.add_argument("--threads", type=int, help="threads of torch; default: its own choice")
    arguments = parser.parse_args()
    if arguments.threads is not None:
        torch.set_num_threads(arguments.threads)
    measure(
        arguments.algo, arguments.env, arguments.steps, arguments.learning_starts, arguments.n_envs
    )


if __name__ == "__main__":
    main()
