"""``sb3-piano tune``: search hyperparameters, wrapper arguments and reward weights."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sb3_piano.cli.common import (
    EXIT_ERROR,
    EXIT_INTERRUPTED,
    EXIT_OK,
    TRUST,
    add_piece_arguments,
    adder,
    command,
    what_is_played,
    whole_number,
)
from sb3_piano.cli.settings import given
from sb3_piano.exceptions import ConfigError
from sb3_piano.hyperparams import DEFAULT_ALGORITHM

if TYPE_CHECKING:
    from sb3_piano.tuning import StudyConfig, TuneResult

_SPACE_HELP = (
    "search space: a name (sac, env, reward, ...) or a YAML file; repeatable; default: the "
    "algorithm's"
)
_DESCRIPTION = (
    "Search hyperparameters, wrapper arguments and reward weights with Optuna. The same command "
    "resumes a stopped study."
)
_RAY_HELP = "address of a Ray cluster, or auto; all nodes must see --studies-dir"
_STORAGE_HELP = "database of the study, such as postgresql+psycopg://user@host/name"


def add_arguments(parser: Any) -> None:
    """Add the arguments of the command."""
    add = command(parser, _tune, description=_DESCRIPTION, epilog=TRUST)
    add("--algo", "NAME", "algorithm: sac (default), td3, tqc, ...", default=DEFAULT_ALGORITHM)
    add_piece_arguments(add)
    add("--config", text="hyperparameters to start from; default: the preset")
    add = adder(parser.add_argument_group("trials"))
    add("--trials", "N", "total number of trials", whole_number, 20)
    add("--steps", "N", "environment steps per training", whole_number, 20_000)
    add("--minutes", "M", "time limit of a trial in minutes; default: none", float)
    add("--seeds", "N", "trainings per trial, each with its own seed", whole_number, 1)
    add("--metric", "NAME", "metric to maximize: f1 or onset_f1", default="f1")
    add("--objective", "WHICH", "model to score: final or best", default="final")
    add("--evaluations", "N", "evaluations per training", whole_number, 5)
    add("--eval-episodes", "N", "episodes per evaluation", whole_number, 1)
    add("--eval-seed", "N", "seed of the evaluations, not used for training", int, 1000)
    add = adder(parser.add_argument_group("search"))
    add("--space", "SPACE", _SPACE_HELP, action="append")
    add("--sampler", "NAME", "Optuna sampler: tpe, cmaes, gp or random", default="tpe")
    add("--pruner", "NAME", "Optuna pruner: median, hyperband, halving or none", default="median")
    add("--startup-trials", "N", "random trials at the start", whole_number, 10)
    add("--seed", "N", "seed of the sampler; default: drawn", int)
    add = adder(parser.add_argument_group("execution"))
    add("--workers", "N", "worker processes", whole_number, 1)
    add("--ray", "ADDRESS", _RAY_HELP)
    add("--storage", "URL", _STORAGE_HELP)
    add("--name", "NAME", "name of the study; default: algorithm and environment")
    add("--studies-dir", "DIR", "folder of all studies", default="studies")
    add("--no-progress")


def _tune(arguments: argparse.Namespace) -> int:
    import optuna

    from sb3_piano.tuning import Search, tune

    optuna.logging.set_verbosity(optuna.logging.WARNING)  # the progress bar shows the rest
    config = _config(arguments)
    name = _default_name(arguments, config) if arguments.name is None else arguments.name
    if name in ("", "..") or Path(name).name != name:
        raise ConfigError(
            f"--name is {name!r}: expected the name of a folder in --studies-dir, not a path."
        )
    result = tune(
        config,
        Path(arguments.studies_dir, name),
        name=name,
        n_trials=arguments.trials,
        workers=arguments.workers,
        ray=arguments.ray,
        storage=arguments.storage,
        search=Search(**given(arguments, Search)),
        progress_bar=not arguments.no_progress,
    )
    _show(result, config, arguments)
    if result.interrupted:
        return EXIT_INTERRUPTED
    return EXIT_ERROR if result.best is None else EXIT_OK


def _config(arguments: argparse.Namespace) -> StudyConfig:
    from sb3_piano.training import load_entry
    from sb3_piano.tuning import StudyConfig, load_space

    env_id, overrides = what_is_played(arguments)
    overrides["n_timesteps"] = arguments.steps
    settings = {
        **given(arguments, StudyConfig),
        "env_id": env_id,
        "entry": load_entry(arguments.algo, env_id, arguments.config, **overrides),
        "space": load_space(arguments.space or (), arguments.algo),
        "seeds": tuple(range(arguments.seeds)),
        "n_evaluations": arguments.evaluations,
    }
    return StudyConfig(**settings)


def _default_name(arguments: argparse.Namespace, config: StudyConfig) -> str:
    piece = config.env_id if arguments.midi is None else Path(arguments.midi).stem
    return f"{config.algo}-{piece.rpartition(':')[2].replace('/', '-')}"


def _show(result: TuneResult, config: StudyConfig, arguments: argparse.Namespace) -> None:
    from sb3_piano.tuning.report import commands_of
    from sb3_piano.tuning.storage import shown_url
    from sb3_piano.tuning.study import failure_of, preset_trial, summary

    folder, label = result.folder, config.value_name
    print(f"Study:      {folder.path}, {summary(result.trials, label)}")
    if result.best is None:
        print("No trial is complete.")
    else:
        preset = preset_trial(result.trials)
        beside = "" if preset is None else f" (of the preset: {preset.value:.3f})"
        print(f"Best:       {label} {result.best.value:.3f}{beside}")
        print(f"Settings:   {folder.best_file}")
    print(f"Report:     {folder.report_file}")
    print(f"All trials: {folder.table_file}")
    url = arguments.storage
    store = folder.journal_file if url is None else shown_url(url)
    print(f"Dashboard:  optuna-dashboard {shlex.quote(str(store))}")
    for reason in sorted({*map(failure_of, result.trials)} - {""}):
        print(f"Failed:     {reason}")
    if result.interrupted:
        print("Interrupted: the same command goes on.")
    elif result.best is not None:
        for name, command in commands_of(result.best, config, folder).items():
            print(f"{name + ':':<11} {command}")
