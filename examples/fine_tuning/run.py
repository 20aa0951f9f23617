"""Fine-tune the sight-reader on the first 12 s of Für Elise, and play before and after.

    python examples/fine_tuning/run.py                  # SAC, some minutes
    python examples/fine_tuning/run.py --algo ppo --steps 200000
    python examples/fine_tuning/run.py --piece my.mid   # the whole piece

"last" is the model at the end, "best" the one that was best by the evaluations in between, of
which the sight-reader itself was the first.
"""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Mapping
from pathlib import Path

from sb3_piano.envs import GENERAL_ID
from sb3_piano.exceptions import SB3PianoError
from sb3_piano.hyperparams import FINE_TUNING
from sb3_piano.training import RunConfig, evaluate, load_fine_tuning, train
from sb3_piano.training.runs.builders import build_model, build_vec_env

EXCERPT = Path(__file__).with_name("fur_elise.yml")


def main() -> int:
    """Run what the command line asks for, and print a row for each model."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    add = parser.add_argument
    add("--algo", default="sac", choices=FINE_TUNING)
    add("--piece", metavar="NAME|FILE", help="a whole piece in place of the excerpt")
    add(
        "--from", dest="player", default="sight-reader", metavar="PLAYER", help="or planned, a FILE"
    )
    add("--steps", type=int, metavar="N", help="default: those of the preset")
    add("--seed", type=int, default=0, metavar="N")
    add("--runs", default="runs", metavar="DIR")
    arguments = parser.parse_args()
    changed = {} if arguments.steps is None else {"n_timesteps": arguments.steps}
    try:
        config = load_fine_tuning(
            arguments.algo,
            GENERAL_ID,
            EXCERPT if arguments.piece is None else None,
            player=arguments.player,
            env_kwargs={"score": arguments.piece or "FurElise"},
            seed=arguments.seed,
            **changed,
        )
        tell("before", before(config))
        result = train(config, runs_dir=arguments.runs)
        folder = result.folder.path
        if result.interrupted:
            print(f"Interrupted. To go on: sb3-piano train --resume {folder}")
            return 130
        tell("last", evaluate(folder).mean)
        tell("best", evaluate(folder, best="f1").mean)
    except SB3PianoError as error:
        parser.exit(2, f"{parser.prog}: error: {error}\n")
    return 0


def before(config: RunConfig) -> Mapping[str, float]:
    """Return the metrics of a model that has learnt nothing, which are the sight-reader's."""
    alone = config.alone()
    with contextlib.closing(build_vec_env(alone)) as venv:
        model, observation = build_model(alone, venv), venv.reset()
        while True:
            action, _ = model.predict(observation, deterministic=True)
            observation, _, dones, infos = venv.step(action)
            if dones[0]:
                return infos[0]


def tell(name: str, metrics: Mapping[str, float]) -> None:
    """Print a row."""
    print(f"{name:6}  F1 {metrics['f1']:.3f}, onset F1 {metrics['onset_f1']:.3f}", flush=True)


if __name__ == "__main__":
    raise SystemExit(main())
