"""``sb3-piano train``: train a model, or go on training one."""

from __future__ import annotations

import argparse
import shlex
from typing import TYPE_CHECKING, Any

from sb3_piano.cli.common import (
    EXIT_INTERRUPTED,
    EXIT_OK,
    NUM_THREADS_HELP,
    TRUST,
    add_piece_arguments,
    add_shared,
    what_is_played,
    whole_number,
)
from sb3_piano.cli.evaluate import evaluate_run
from sb3_piano.cli.play import play_run
from sb3_piano.exceptions import ConfigError

if TYPE_CHECKING:
    from sb3_piano.training import RunConfig, TrainResult

_VEC_ENV_HELP = "dummy (one process), threads or subproc (one process for each)"
_OF_CONFIG = ("seed", "n_envs", "vec_env", "num_threads")
_NEW_RUN_ONLY = ("midi", "fingering", "config", *_OF_CONFIG, "run", "runs_dir")


def add_parser(commands: Any) -> None:
    """Add the command and its arguments."""
    train = commands.add_parser("train", help="train a model, or go on training one", epilog=TRUST)
    add = train.add_argument
    add("--algo", metavar="NAME", help="td3 (default), sac, tqc, ddpg, ppo, a2c, crossq or trpo")
    add_piece_arguments(add)
    add_shared(add, "--config")
    add("--steps", type=whole_number, metavar="N", help="environment steps in all, such as 1e6")
    add("--seed", type=int, metavar="N", help="default: drawn, and noted in the run's folder")
    add("--n-envs", type=whole_number, metavar="N", help="environments that play at the same time")
    add("--vec-env", metavar="KIND", help=_VEC_ENV_HELP)
    add("--num-threads", type=whole_number, metavar="N", help=NUM_THREADS_HELP)
    add("--checkpoint-every", type=whole_number, metavar="N", help="default: 10000 steps")
    add_shared(add, "--runs-dir")
    add_shared(add, "--run")
    add("--resume", metavar="RUN", help="go on with the run in this folder")
    add_shared(add, "--no-progress")
    add("--evaluate", action="store_true", help="evaluate the model afterwards")
    add("--play", action="store_true", help="write a video of the model afterwards")
    train.set_defaults(command=_train)


def _train(arguments: argparse.Namespace) -> int:
    from sb3_piano.training import resume, train

    options: dict[str, Any] = {"progress_bar": not arguments.no_progress}
    if arguments.checkpoint_every is not None:
        options["checkpoint_every"] = arguments.checkpoint_every
    if arguments.resume is not None:
        _refuse_new_run_options(arguments)
        result = resume(
            arguments.resume,
            arguments.steps,
            algo=arguments.algo,
            env_id=arguments.env,
            **options,
        )
    else:
        config = _config(arguments)
        runs_dir = "runs" if arguments.runs_dir is None else arguments.runs_dir
        result = train(config, arguments.run, runs_dir=runs_dir, **options)
    _report_training(result)
    if result.interrupted:
        return EXIT_INTERRUPTED
    if arguments.evaluate:
        evaluate_run(str(result.folder.path))
    if arguments.play:
        # A machine that cannot draw says so; the training has succeeded all the same.
        play_run(str(result.folder.path), arguments)
    return EXIT_OK


def _refuse_new_run_options(arguments: argparse.Namespace) -> None:
    for name in _NEW_RUN_ONLY:
        if getattr(arguments, name) is not None:
            raise ConfigError(
                f"--{name.replace('_', '-')} cannot be given with --resume: a run keeps its "
                "settings. Expected --steps for a new total, or a new run."
            )


def _config(arguments: argparse.Namespace) -> RunConfig:
    from sb3_piano.training import load_config

    env_id, overrides = what_is_played(arguments, ", --midi FILE or --resume RUN")
    given = {"n_timesteps": arguments.steps, **{n: getattr(arguments, n) for n in _OF_CONFIG}}
    overrides |= {name: value for name, value in given.items() if value is not None}
    algo = "td3" if arguments.algo is None else arguments.algo
    return load_config(algo, env_id, arguments.config, **overrides)


def _report_training(result: TrainResult) -> None:
    folder = result.folder
    path = shlex.quote(str(folder.path))
    if result.had_finished:
        print(
            f"The run has done {result.num_timesteps} of {result.n_timesteps} steps: nothing is "
            f"left to do. To go on: sb3-piano train --resume {path} --steps N"
        )
    elif result.interrupted:
        print(f"Interrupted after {result.num_timesteps} of {result.n_timesteps} steps.")
    else:
        print(f"Trained for {result.num_timesteps} steps.")
    print(f"Run:         {folder.path}")
    if folder.model_file.is_file():
        print(f"Model:       {folder.model_file}")
    if folder.tensorboard_dir.is_dir():
        print(f"TensorBoard: tensorboard --logdir {shlex.quote(str(folder.tensorboard_dir))}")
    if result.interrupted:
        print(f"Go on:       sb3-piano train --resume {path}")
    else:
        print(f"Evaluate:    sb3-piano evaluate {path}")
