"""The ``sb3-piano`` command: train, evaluate, measure, and list what there is."""

from __future__ import annotations

import argparse
import contextlib
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import sb3_piano
from sb3_piano.exceptions import ConfigError, SB3PianoError

# torch and the simulator are imported by the commands that need them, so that --help is instant.
if TYPE_CHECKING:
    from sb3_piano.training import Evaluation, RunConfig, TrainResult

EXIT_OK, EXIT_ERROR, EXIT_INTERRUPTED = 0, 2, 130

_METRIC_NAMES = {
    "f1": "Keys: F1",
    "precision": "Keys: precision",
    "recall": "Keys: recall",
    "sustain_f1": "Pedal: F1",
    "sustain_precision": "Pedal: precision",
    "sustain_recall": "Pedal: recall",
    "return": "Return",
    "return_key_press": "  from pressing keys",
    "return_fingering": "  from fingering",
    "return_sustain": "  from the pedal",
    "return_forearm": "  from keeping the forearms apart",
    "return_energy": "  from energy",
    "length": "Length, control steps",
}
_VEC_ENV_HELP = "dummy (one process), threads or subproc (one process for each)"
_NEW_RUN_ONLY = ("midi", "config", "seed", "n_envs", "vec_env", "run", "runs_dir")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        argv: The arguments; by default those of the process.

    Returns:
        0 if all went well, 2 after an error of the user's, 130 after Ctrl-C.
    """
    arguments = _parser().parse_args(argv)
    try:
        return int(arguments.command(arguments))
    except SB3PianoError as error:
        print(f"sb3-piano: error: {error}", file=sys.stderr)
        return EXIT_ERROR
    except KeyboardInterrupt:
        print("sb3-piano: interrupted.", file=sys.stderr)
        return EXIT_INTERRUPTED


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="sb3-piano",
        description="Train robot hands to play the piano, and hear what they play.",
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {sb3_piano.__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    _add_train(commands)
    evaluate = commands.add_parser("evaluate", help="let a trained model play")
    evaluate.add_argument("run", metavar="RUN", help="the folder that train made")
    evaluate.add_argument("--episodes", type=_steps, default=1, metavar="N", help="default: 1")
    evaluate.add_argument("--seed", type=int, default=0, metavar="N", help="default: 0")
    evaluate.add_argument(
        "--physics", metavar="NAME", help="reference or fast; default: what it was trained on"
    )
    evaluate.set_defaults(command=_evaluate)
    _add_bench(commands)
    presets = commands.add_parser("presets", help="list the YAML files that come with the package")
    presets.set_defaults(command=_presets)
    envs = commands.add_parser("envs", help="list the environment ids")
    envs.set_defaults(command=_envs)
    return parser


def _add_train(commands: Any) -> None:
    train = commands.add_parser("train", help="train a model, or go on training one")
    add = train.add_argument
    add("--algo", metavar="NAME", help="td3 (default), sac, tqc, ddpg, ppo, a2c, crossq or trpo")
    add("--env", metavar="ID", help="environment id; 'sb3-piano envs' lists ours")
    add("--midi", metavar="FILE", help="play a MIDI file, a PIG .txt file or a piece by its name")
    add("--config", metavar="FILE.yml", help="hyperparameters; default: the algorithm's preset")
    add("--steps", type=_steps, metavar="N", help="environment steps in all, such as 1e6")
    add("--seed", type=int, metavar="N", help="default: drawn, and noted in the run's folder")
    add("--n-envs", type=_steps, metavar="N", help="environments that play at the same time")
    add("--vec-env", metavar="KIND", help=_VEC_ENV_HELP)
    add("--checkpoint-every", type=_steps, metavar="N", help="default: 10000 steps")
    add("--runs-dir", metavar="DIR", help="where runs are kept; default: runs")
    add("--run", metavar="DIR", help="the run's folder, in place of one in --runs-dir")
    add("--resume", metavar="RUN", help="go on with the run in this folder")
    add("--no-progress", action="store_true", help="show no progress bar")
    add("--evaluate", action="store_true", help="evaluate the model afterwards")
    train.set_defaults(command=_train)


def _add_bench(commands: Any) -> None:
    bench = commands.add_parser("bench", help="measure speed and memory")
    add = bench.add_argument
    add("--peer-python", metavar="PATH", help="measure RoboPianist too: a Python that has it")
    add(
        "--rounds",
        type=_steps,
        default=10,
        metavar="N",
        help="rounds to take medians of; default: 10",
    )
    add(
        "--only",
        action="append",
        choices=("simulation", "learner", "memory"),
        help="measure this part; may be given several times",
    )
    add("--threads", type=_steps, metavar="N", help="threads of torch; default: torch's choice")
    add("--json", type=Path, metavar="FILE", help="write the result to a file as well")
    add("--no-progress", action="store_true", help="show no progress bar")
    bench.set_defaults(command=_bench)


def _steps(text: str) -> int:
    """Read a whole number from 1 on, also written as ``1e5``."""
    try:
        number = float(text)
        if number < 1 or number != int(number):
            raise ValueError
    except (ValueError, OverflowError):
        raise argparse.ArgumentTypeError(
            f"{text!r} is no whole number from 1 on, such as 1000 or 1e5"
        ) from None
    return int(number)


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
        _evaluate_run(str(result.folder.path), 1, 0)
    return EXIT_OK


def _refuse_new_run_options(arguments: argparse.Namespace) -> None:
    for name in _NEW_RUN_ONLY:
        if getattr(arguments, name) is not None:
            raise ConfigError(
                f"--{name.replace('_', '-')} cannot be given with --resume: a run keeps its "
                "settings. Expected --steps for a new total, or a new run."
            )


def _config(arguments: argparse.Namespace) -> RunConfig:
    from sb3_piano.envs import GENERAL_ID
    from sb3_piano.training import load_config

    env_id = arguments.env
    overrides = {
        name: value
        for name, value in {
            "n_timesteps": arguments.steps,
            "seed": arguments.seed,
            "n_envs": arguments.n_envs,
            "vec_env": arguments.vec_env,
        }.items()
        if value is not None
    }
    if arguments.midi is not None:
        if env_id not in (None, GENERAL_ID):
            raise ConfigError(
                f"--midi cannot be given with --env {env_id}: only {GENERAL_ID} plays any piece. "
                "Expected --midi alone."
            )
        env_id = GENERAL_ID
        overrides["env_kwargs"] = {"score": arguments.midi}
    if env_id is None:
        raise ConfigError("Nothing to play: expected --env ID, --midi FILE or --resume RUN.")
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


def _evaluate(arguments: argparse.Namespace) -> int:
    _evaluate_run(arguments.run, arguments.episodes, arguments.seed, arguments.physics)
    return EXIT_OK


def _evaluate_run(run: str, episodes: int, seed: int, physics: str | None = None) -> None:
    from sb3_piano.training import evaluate

    _report_evaluation(evaluate(run, episodes, seed, physics=physics))


def _report_evaluation(evaluation: Evaluation) -> None:
    from rich.console import Console
    from rich.table import Table

    n_episodes = len(evaluation.episodes)
    plural = "episode" if n_episodes == 1 else "episodes"
    table = Table(
        title=f"{n_episodes} {plural}, model after {evaluation.num_timesteps} steps of training"
    )
    table.add_column("metric")
    table.add_column("policy" if n_episodes == 1 else "policy (mean ± std)", justify="right")
    if evaluation.baseline is not None:
        table.add_column("no-op baseline", justify="right")
    for name, text in _METRIC_NAMES.items():
        if name in evaluation.mean:
            table.add_row(text, *_cells(evaluation, name))
    Console().print(table)
    for number, path in enumerate(evaluation.performances, start=1):
        if path is not None:
            print(f"Performance: {path}")
        elif evaluation.baseline is not None:
            print(f"Performance: no key was pressed in episode {number}, so there is no MIDI file")
    print(f"Metrics:     {evaluation.metrics_file}")


def _cells(evaluation: Evaluation, name: str) -> list[str]:
    digits = 0 if name == "length" else 3
    policy = _rounded(evaluation.mean[name], digits)
    if len(evaluation.episodes) > 1:
        policy += f" ± {_rounded(evaluation.std[name], digits)}"
    if evaluation.baseline is None:
        return [policy]
    return [policy, _rounded(evaluation.baseline[name], digits)]


def _rounded(value: float, digits: int) -> str:
    return f"{round(value, digits) + 0.0:.{digits}f}"  # + 0.0 turns -0.0 into 0.0


def _bench(arguments: argparse.Namespace) -> int:
    from rich.console import Console

    from sb3_piano.bench import PARTS, BenchSettings, progress_bar, render, run_bench
    from sb3_piano.files import write_json

    file: Path | None = arguments.json
    if file is not None and (file.is_dir() or not file.parent.is_dir()):
        raise ConfigError(f"--json is '{file}': expected a file in a folder that exists.")
    settings = BenchSettings(
        parts=PARTS if arguments.only is None else tuple(arguments.only),
        rounds=arguments.rounds,
        peer_python=arguments.peer_python,
        threads=arguments.threads,
    )
    with contextlib.nullcontext() if arguments.no_progress else progress_bar() as tick:
        report = run_bench(settings, tick)
    Console().print(render(report))
    if file is not None:
        write_json(file, report.to_json())
        print(f"Result: {file}")
    return EXIT_INTERRUPTED if report.interrupted else EXIT_OK


def _presets(arguments: argparse.Namespace) -> int:
    from sb3_piano.hyperparams import PRESETS

    del arguments  # every command gets them
    for path in PRESETS.values():
        print(path)
    return EXIT_OK


def _envs(arguments: argparse.Namespace) -> int:
    from sb3_piano.envs import ENV_IDS

    del arguments  # every command gets them
    for env_id in ENV_IDS:
        print(env_id)
    return EXIT_OK


if __name__ == "__main__":
    sys.exit(main())
