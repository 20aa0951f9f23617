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
    add_piece_arguments,
    what_is_played,
    whole_number,
)

if TYPE_CHECKING:
    from sb3_piano.tuning import StudyConfig, TuneResult

_TRIALS, _STEPS, _EVALUATIONS = 20, 20_000, 5


def add_parser(commands: Any) -> None:
    """Add the command and its arguments."""
    tune = commands.add_parser(
        "tune",
        help="search hyperparameters with Optuna",
        description="Search hyperparameters, wrapper arguments and reward weights with Optuna. "
        "The same command goes on with a study that was stopped.",
    )
    add = tune.add_argument
    add("--algo", default="td3", metavar="NAME", help="td3 (default), sac, tqc, ...")
    add_piece_arguments(add)
    add("--config", metavar="FILE.yml", help="settings to depart from; default: the preset")
    _add_trial_arguments(tune.add_argument_group("trials"))
    _add_search_arguments(tune.add_argument_group("search"))
    _add_place_arguments(tune.add_argument_group("where"))
    tune.set_defaults(command=_tune)


def _add_trial_arguments(group: Any) -> None:
    add = group.add_argument
    add("--trials", type=whole_number, default=_TRIALS, metavar="N", help="in all; default: 20")
    add("--steps", type=whole_number, default=_STEPS, metavar="N", help="of a training; 20,000")
    add("--minutes", type=float, metavar="M", help="longest time of a trial; default: no limit")
    add("--seeds", type=whole_number, default=1, metavar="N", help="trainings of a trial; 1")
    add("--metric", default="f1", metavar="NAME", help="f1 (default) or onset_f1")
    add("--objective", default="final", metavar="WHICH", help="final (default) or best model")
    add(
        "--evaluations",
        type=whole_number,
        default=_EVALUATIONS,
        metavar="N",
        help="of a training; 5",
    )
    add("--eval-episodes", type=whole_number, default=1, metavar="N", help="of an evaluation; 1")
    add("--eval-seed", type=int, default=1000, metavar="N", help="held out; default: 1000")


def _add_search_arguments(group: Any) -> None:
    add = group.add_argument
    space_help = "a space by its name (sac, env, reward, ...) or a YAML file; may be given several "
    add(
        "--space",
        action="append",
        metavar="SPACE",
        help=space_help + "times; default: the algorithm's",
    )
    add("--sampler", default="tpe", metavar="NAME", help="tpe (default), cmaes, gp or random")
    add(
        "--pruner",
        default="median",
        metavar="NAME",
        help="median (default), hyperband, ... or none",
    )
    add("--startup-trials", type=whole_number, default=10, metavar="N", help="at random first; 10")
    add("--seed", type=int, metavar="N", help="seed of the sampler; default: drawn")


def _add_place_arguments(group: Any) -> None:
    add = group.add_argument
    add("--workers", type=whole_number, default=1, metavar="N", help="processes; default: 1")
    add("--storage", metavar="URL", help="a database, such as postgresql+psycopg://user@host/name")
    add("--name", metavar="NAME", help="the study's name; default: algorithm and environment")
    add(
        "--studies-dir",
        default="studies",
        metavar="DIR",
        help="where studies are; default: studies",
    )
    add("--no-progress", action="store_true", help="show no progress bar")


def _tune(arguments: argparse.Namespace) -> int:
    import optuna

    from sb3_piano.tuning import Search, tune

    optuna.logging.set_verbosity(optuna.logging.WARNING)  # the progress bar tells the rest
    config = _config(arguments)
    name = _default_name(arguments, config) if arguments.name is None else arguments.name
    search = Search(
        sampler=arguments.sampler,
        pruner=arguments.pruner,
        startup_trials=arguments.startup_trials,
        seed=arguments.seed,
    )
    result = tune(
        config,
        Path(arguments.studies_dir, name),
        name=name,
        n_trials=arguments.trials,
        workers=arguments.workers,
        storage=arguments.storage,
        search=search,
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
    return StudyConfig(
        algo=arguments.algo,
        env_id=env_id,
        entry=load_entry(arguments.algo, env_id, arguments.config, **overrides),
        space=load_space(arguments.space or (), arguments.algo),
        metric=arguments.metric,
        objective=arguments.objective,
        seeds=tuple(range(arguments.seeds)),
        eval_seed=arguments.eval_seed,
        eval_episodes=arguments.eval_episodes,
        n_evaluations=arguments.evaluations,
        minutes=arguments.minutes,
    )


def _default_name(arguments: argparse.Namespace, config: StudyConfig) -> str:
    piece = config.env_id if arguments.midi is None else Path(arguments.midi).stem
    return f"{config.algo}-{piece.rpartition(':')[2].replace('/', '-')}"


def _show(result: TuneResult, config: StudyConfig, arguments: argparse.Namespace) -> None:
    from sb3_piano.tuning.storage import shown_url
    from sb3_piano.tuning.trials import summary

    label = f"{config.objective} {config.metric}"
    print(f"Study:      {result.folder.path}, {summary(result.trials, label)}")
    if result.best is None:
        print("No trial is complete.")
    else:
        beside = "" if result.preset is None else f" (of the preset: {result.preset.value:.3f})"
        print(f"Best:       {label} {result.best.value:.3f}{beside}")
        print(f"Settings:   {result.folder.best_file}")
    print(f"Report:     {result.folder.report_file}")
    print(f"All trials: {result.folder.table_file}")
    url = arguments.storage
    store = result.folder.journal_file if url is None else shown_url(url)
    print(f"Dashboard:  optuna-dashboard {shlex.quote(str(store))}")
    for reason in sorted(result.failures):
        print(f"Failed:     {reason}")
    if result.interrupted:
        print("Interrupted: the same command goes on.")
    elif result.best is not None:
        best = shlex.quote(str(result.folder.best_file))
        algo, env_id = config.algo, config.env_id
        print(f"Train:      sb3-piano train --algo {algo} --env {env_id} --config {best}")
