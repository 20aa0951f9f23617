"""How long a configuration trains until it plays with a given F1.

    python benchmarks/time_to_f1.py --algo td3 --seed 0 --minutes 60 --out td3.jsonl
    python benchmarks/time_to_f1.py --algo td3 --published --minutes 60 --out published.jsonl

Trains stock SB3 and lets the deterministic policy play an episode every so many steps, in an
environment of its own, always on the reference physics and with RoboPianist's reward weights. The
clocks stand still while it plays. Every evaluation is a line of the output file: steps, seconds,
CPU seconds, F1 and return. At the end the first one that reached each level of F1 is printed.
``--published`` takes the preset's default, the papers' values, in place of those for the piece.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import time
from pathlib import Path
from typing import Any

import gymnasium as gym
import torch
from stable_baselines3.common.callbacks import BaseCallback

from sb3_piano.envs import GENERAL_ID
from sb3_piano.training import RunConfig, load_config
from sb3_piano.training.runs.builders import build_model, build_vec_env

LEVELS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)


class TimedEvaluation(BaseCallback):
    """Play a deterministic episode every ``every`` steps; stop when the CPU time is up."""

    def __init__(self, config: RunConfig, every: int, seconds: float, out: Path) -> None:
        super().__init__()
        env_kwargs = {**config.env_kwargs, "physics": "reference", "reward_weights": {}}
        self.venv = build_vec_env(
            dataclasses.replace(config, n_envs=1, env_kwargs=env_kwargs, monitor_kwargs={})
        )
        self.every, self.seconds, self.out = every, seconds, out
        self.rows: list[dict[str, float]] = []
        self.wall = self.cpu = 0.0
        self.due_at = 0

    def _on_training_start(self) -> None:
        self._start()

    def _start(self) -> None:
        self.wall_start, self.cpu_start = time.perf_counter(), time.process_time()

    def _stop(self) -> None:
        self.wall += time.perf_counter() - self.wall_start
        self.cpu += time.process_time() - self.cpu_start

    def _on_rollout_start(self) -> None:
        if self.num_timesteps < self.due_at:
            return
        self._stop()
        self.due_at = self.num_timesteps + self.every
        self.rows.append({
            "steps": self.num_timesteps, "seconds": round(self.wall, 1),
            "cpu_seconds": round(self.cpu, 1), **self._play(),
        })  # fmt: skip
        with self.out.open("a") as file:
            file.write(json.dumps(self.rows[-1]) + "\n")
        self._start()

    def _play(self) -> dict[str, float]:
        observation: Any = self.venv.reset()
        total, done = 0.0, False
        infos: list[dict[str, Any]] = []
        while not done:
            action, _ = self.model.predict(observation, deterministic=True)
            observation, rewards, dones, infos = self.venv.step(action)
            total, done = total + float(rewards[0]), bool(dones[0])
        return {"f1": round(infos[0]["f1"], 4), "return": round(total, 2)}

    def _on_step(self) -> bool:
        return self.cpu + time.process_time() - self.cpu_start < self.seconds


def report(rows: list[dict[str, float]]) -> None:
    """Print when each level of F1 was first reached."""
    last = rows[-1]
    print(f"{last['steps']} steps, {last['steps'] / max(last['seconds'], 1e-9):.1f} steps/s")
    print(f"{'F1':>5} {'steps':>9} {'minutes':>8} {'CPU minutes':>12}")
    for level in LEVELS:
        row = next((row for row in rows if row["f1"] >= level), None)
        if row is None:
            break
        minutes, cpu_minutes = row["seconds"] / 60, row["cpu_seconds"] / 60
        print(f"{level:>5} {row['steps']:>9} {minutes:>8.1f} {cpu_minutes:>12.1f}")
    print(f"best F1 {max(row['f1'] for row in rows)}, last F1 {last['f1']}")


def main() -> None:
    """Read the command line, train and report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--algo", default="td3")
    parser.add_argument("--config", help="a YAML file; default: the algorithm's preset")
    parser.add_argument("--env", default="RoboPianist-debug-CMajorScaleTwoHands-v0")
    parser.add_argument(
        "--published", action="store_true", help="the entry 'default', whatever the environment"
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=60, help="CPU time of training, at most")
    parser.add_argument("--every", type=int, default=4000, help="steps between evaluations")
    parser.add_argument("--threads", type=int, default=1, help="threads of torch")
    parser.add_argument("--out", type=Path, required=True, help="file of the evaluations")
    arguments = parser.parse_args()
    if arguments.out.exists():
        parser.error(f"--out is '{arguments.out}', which exists: expected a new file")
    torch.set_num_threads(arguments.threads)
    env_id, overrides = arguments.env, {}
    if arguments.published:
        env_id, overrides = GENERAL_ID, {"env_kwargs": {"score": gym.spec(env_id).kwargs["score"]}}
    config = load_config(arguments.algo, env_id, arguments.config, seed=arguments.seed, **overrides)
    model = build_model(config, build_vec_env(config))
    callback = TimedEvaluation(config, arguments.every, 60 * arguments.minutes, arguments.out)
    try:
        model.learn(config.n_timesteps, callback=callback)
    except KeyboardInterrupt:
        print("Interrupted.")
    report(callback.rows)


if __name__ == "__main__":
    main()
