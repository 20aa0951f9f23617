"""``sb3-piano train``: train a model, or resume a training."""

from __future__ import annotations

import argparse
import shlex
from typing import TYPE_CHECKING, Any

from sb3_piano.cli.common import (
    EXIT_INTERRUPTED,
    EXIT_OK,
    TRUST,
    add_piece_arguments,
    command,
    refuse_options,
    what_is_played,
    whole_number,
)
from sb3_piano.cli.evaluate import evaluate_run
from sb3_piano.cli.play import play_run
from sb3_piano.exceptions import ConfigError
from sb3_piano.hyperparams import DEFAULT_ALGORITHM

if TYPE_CHECKING:
    from sb3_piano.training import RunConfig
    from sb3_piano.training.runs.train import TrainResult

_PIECES_HELP = (
    "train on several pieces: names, files, patterns such as 'scale-*', collections, or lists in "
    "FILE.txt; split among the --n-envs environments, which draw one per episode"
)
_BATCH = ("batched", "device")
_OF_CONFIG = ("seed", "n_envs", "vec_env", "num_threads", "matmul_precision")
_NEW_RUN_ONLY = (
    "from",
    "init_from",
    "with_buffer",
    "midi",
    "pieces",
    "fingering",
    "config",
    *_OF_CONFIG,
    *_BATCH,
    "out",
    "runs_dir",
)


def add_arguments(parser: Any) -> None:
    """Add the arguments of the command."""
    add = command(parser, _train, epilog=TRUST)
    add("--algo", "NAME", "algorithm: sac (default), td3, tqc, ddpg, ppo, a2c, crossq or trpo")
    add_piece_arguments(add)
    add("--pieces", "PIECE", _PIECES_HELP, nargs="+")
    add(
        "--from",
        "PLAYER",
        "learn corrections to a base player: sight-reader, planned, the FILE.safetensors of a "
        "hand's network, or a RUN; with sac, td3 or ppo",
    )
    add("--init-from", "RUN", "start from the networks, optimizers and settings of a run")
    add("--with-buffer", text="with --init-from: also load its replay buffer")
    add(
        "--config",
        text="hyperparameters: FILE.yml or 'fast'; default: published ones; with --from: changes",
    )
    add("--steps", "N", "total environment steps, such as 1e6", whole_number)
    add("--seed", "N", "random seed; default: drawn, saved in the run's folder", int)
    add("--n-envs", "N", "number of parallel environments", whole_number)
    add("--vec-env", "KIND", "dummy (one process), threads, processes or subproc (a process each)")
    add(
        "--batched",
        "N",
        "train on N environments as one batch, on MuJoCo's threads or, with --device cuda, on a "
        "GPU; default of --config: batched",
        whole_number,
    )
    add("--device", "NAME", "device of the networks, and of a batch: auto (default), cpu or cuda")
    add("--num-threads")
    add("--matmul-precision")
    add(
        "--checkpoint-every",
        "N",
        "steps between checkpoints; default: 10000, of a batch 1000 of each agent",
        whole_number,
    )
    add("--runs-dir")
    add("--out", "DIR", "folder of this run; default: a new one in --runs-dir")
    add("--resume", "RUN", "resume the run in this folder")
    add("--no-progress")
    add("--evaluate", text="evaluate the model afterwards")
    add("--play", text="write a video of the model afterwards")


def _train(arguments: argparse.Namespace) -> int:
    from sb3_piano.training import resume, train

    options: dict[str, Any] = {"progress_bar": not arguments.no_progress}
    if arguments.checkpoint_every is not None:
        options["checkpoint_every"] = arguments.checkpoint_every
    if arguments.resume is not None:
        reason = "with --resume: a run keeps its settings."
        instead = "Expected --steps for a new total, or a new run."
        refuse_options(arguments, _NEW_RUN_ONLY, reason, instead)
        expected = {"algo": arguments.algo, "env_id": arguments.env}
        result = resume(arguments.resume, arguments.steps, **expected, **options)
    else:
        runs_dir = "runs" if arguments.runs_dir is None else arguments.runs_dir
        result = train(_config(arguments), arguments.out, runs_dir=runs_dir, **options)
    _report_training(result)
    if result.interrupted:
        return EXIT_INTERRUPTED
    if arguments.evaluate:
        evaluate_run(str(result.folder.path))
    if arguments.play:
        # The status stays 0 without a video: the training has succeeded.
        play_run(str(result.folder.path), arguments)
    return EXIT_OK


def _config(arguments: argparse.Namespace) -> RunConfig:
    given = {"n_timesteps": arguments.steps, **{n: getattr(arguments, n) for n in _OF_CONFIG}}
    given = {name: value for name, value in given.items() if value is not None}
    worlds, device = arguments.batched, arguments.device
    if worlds is None and device is not None:
        given["device"] = device
    if worlds is not None:
        refuse_options(arguments, ("n_envs", "vec_env"), "with --batched.")
        named = arguments.config or arguments.init_from or getattr(arguments, "from")
        arguments.config = arguments.config if named else "batched"
    config = _unbatched(arguments, given)
    return config if worlds is None else config.batched(worlds, device)


def _unbatched(arguments: argparse.Namespace, given: dict[str, Any]) -> RunConfig:
    from sb3_piano.envs import GENERAL_ID
    from sb3_piano.training import load_config, load_fine_tuning, load_start
    from sb3_piano.training.configuration.names import algorithm_class

    algo, start = arguments.algo or DEFAULT_ALGORITHM, getattr(arguments, "from")
    if arguments.with_buffer and arguments.init_from is None:
        raise ConfigError("--with-buffer is given without --init-from: expected both, or neither.")
    if arguments.pieces is not None:
        refuse_options(arguments, ("env", "midi", "from"), "with --pieces.")
        given["pieces"] = arguments.pieces
        arguments.env = GENERAL_ID
    if arguments.init_from is not None:
        refuse_options(arguments, ("algo", "from"), "with --init-from: a run keeps its algorithm.")
        env_id, options = _played(arguments)
        given |= {"with_buffer": arguments.with_buffer, **options}
        return load_start(arguments.init_from, env_id, arguments.config, **given)
    if start is None:
        algorithm_class(algo)  # report an unknown algorithm first
        others = ", --midi FILE, --pieces PIECE... or --resume RUN"
        env_id, options = what_is_played(arguments, others)
        return load_config(algo, env_id, arguments.config, **options, **given)
    env_id, options = _played(arguments)
    return load_fine_tuning(algo, env_id, arguments.config, player=start, **options, **given)


def _played(arguments: argparse.Namespace) -> tuple[str | None, dict[str, Any]]:
    """Return the environment id, or ``None`` for the run's own, and environment options."""
    if arguments.env or arguments.midi:
        return what_is_played(arguments, " or --midi FILE")
    fingering = arguments.fingering
    return None, {} if fingering is None else {"env_kwargs": {"fingering": fingering}}


def _report_training(result: TrainResult) -> None:
    folder = result.folder
    path = shlex.quote(str(folder.path))
    if result.had_finished:
        print(
            f"The run has done {result.num_timesteps} of {result.n_timesteps} steps: nothing is "
            f"left to do. To continue: sb3-piano train --resume {path} --steps N"
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
        print(f"Resume:      sb3-piano train --resume {path}")
    else:
        print(f"Evaluate:    sb3-piano evaluate {path}")
