"""Train corrections of the planned pianist from several seeds, and compare them with the plan.

    python examples/residual/run.py                             # all pieces of td3.yml, three seeds
    python examples/residual/run.py --seeds 0 --steps 10000     # less of everything
    python examples/residual/run.py --env RoboPianist-arpeggio-BMinor-v0

A run that is finished is skipped and one that was interrupted goes on. The table has the F1 of the
plan, of the agent before its first step, of the last model, and of the best one by the evaluations
during the training. A model belongs to the plan that it was trained with: after a change to the
planner it is to be trained again.
"""

from __future__ import annotations

import argparse
import contextlib
from pathlib import Path
from typing import Any

import gymnasium as gym
import yaml
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv

from sb3_piano.exceptions import SB3PianoError
from sb3_piano.planning import PlannedPianist
from sb3_piano.training import RunConfig, evaluate, load_config, resume, train
from sb3_piano.training.runs.builders import build_model, build_vec_env

SETTINGS = Path(__file__).with_name("td3.yml")


def main() -> int:
    """Run what the command line asks for, and print a row of the table after each run."""
    pieces = list(yaml.safe_load(SETTINGS.read_text(encoding="utf-8")))
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    add = parser.add_argument
    add("--env", nargs="+", default=pieces, metavar="ID", help="default: all of td3.yml")
    add("--seeds", nargs="+", type=int, default=[0, 1, 2], metavar="N", help="default: 0 1 2")
    add("--steps", type=int, metavar="N", help="default: those of td3.yml")
    add("--runs", type=Path, default=Path("runs/residual"), metavar="DIR")
    arguments = parser.parse_args()
    print(
        "| piece | seed | plan | step 0 | last | best |\n|---|---:|---:|---:|---:|---:|", flush=True
    )
    changed = {} if arguments.steps is None else {"n_timesteps": arguments.steps}
    try:
        for seed in arguments.seeds:
            for env_id in arguments.env:
                config = load_config("td3", env_id, SETTINGS, seed=seed, **changed)
                folder = arguments.runs / f"{env_id}_seed_{seed}"
                if not run(config, folder):
                    print("Interrupted: the same command goes on from here.")
                    return 130
                values = [plan_f1(config), first_f1(config), *trained_f1(folder)]
                numbers = " | ".join(f"{value:.4f}" for value in values)
                print(f"| {env_id} | {seed} | {numbers} |", flush=True)
    except SB3PianoError as error:
        parser.exit(2, f"{parser.prog}: error: {error}\n")
    return 0


def run(config: RunConfig, folder: Path) -> bool:
    """Bring a run to its end, and return whether it got there."""
    if (folder / "config.yml").is_file():
        result = resume(folder, config.n_timesteps, progress_bar=False)
    else:
        result = train(config, folder, progress_bar=False)
    return not result.interrupted


def plan_f1(config: RunConfig) -> float:
    """Return the F1 of the planned pianist, without any wrapper."""
    with contextlib.closing(
        DummyVecEnv([lambda: gym.make(config.env_id, **config.env_kwargs)])
    ) as venv:
        return f1(PlannedPianist(venv), venv)


def first_f1(config: RunConfig) -> float:
    """Return the F1 of the agent before its first step."""
    with contextlib.closing(build_vec_env(config)) as venv:
        return f1(build_model(config, venv), venv)


def trained_f1(folder: Path) -> tuple[float, float]:
    """Return the F1 of the last and of the best model of a run."""
    return evaluate(folder).mean["f1"], evaluate(folder, best="f1").mean["f1"]


def f1(player: Any, venv: VecEnv) -> float:
    """Return the F1 of one episode."""
    observation, state, done = venv.reset(), None, [True]
    while True:
        action, state = player.predict(observation, state, done, deterministic=True)
        observation, _, done, (info,) = venv.step(action)
        if done[0]:
            return float(info["f1"])


if __name__ == "__main__":
    raise SystemExit(main())
