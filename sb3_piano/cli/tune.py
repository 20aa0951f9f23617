"""``sb3-piano tune``: search hyperparameters, wrapper arguments and reward weights."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Callable
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

_Option = tuple[str, str, Callable[[str], Any], Any, str]

# Option, what its value is called, its type, its default, and what it is.
_TRIAL_OPTIONS: list[_Option] = [
    ("--trials", "N", whole_number, 20, "in all"),
    ("--steps", "N", whole_number, 20_000, "of a training"),
    ("--minutes", "M", float, None, "longest time of a trial; default: no limit"),
    ("--seeds", "N", whole_number, 1, "trainings of a trial"),
    ("--metric", "NAME", str, "f1", "f1 or onset_f1"),
    ("--objective", "WHICH", str, "final", "final or best model"),
    ("--evaluations", "N", whole_number, 5, "of a training"),
    ("--eval-episodes", "N", whole_number, 1, "of an evaluation"),
    ("--eval-seed", "N", int, 1000, "held out"),
]
_SEARCH_OPTIONS: list[_Option] = [
    ("--sampler", "NAME", str, "tpe", "tpe, cmaes, gp or random"),
    ("--pruner", "NAME", str, "median", "median, hyperband, halving or none"),
    ("--startup-trials", "N", whole_number, 10, "at random first"),
    ("--seed", "N", int, None, "seed of the sampler; default: drawn"),
]
_PLACE_OPTIONS: list[_Option] = [
    ("--workers", "N", whole_number, 1, "processes"),
    ("--storage", "URL", str, None, "a database, such as postgresql+psycopg://user@host/name"),
    ("--name", "NAME", str, None, "the study's name; default: algorithm and environment"),
    ("--studies-dir", "DIR", str, "studies", "where studies are"),
]


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
    _add(tune.add_argument_group("trials"), _TRIAL_OPTIONS)
    search = tune.add_argument_group("search")
    search.add_argument(
        "--space",
        action="append",
        metavar="SPACE",
        help="a space by its name (sac, env, reward, ...) or a YAML file; may be given several "
        "times; default: the algorithm's",
    )
    _add(search, _SEARCH_OPTIONS)
    place = tune.add_argument_group("where")
    _add(place, _PLACE_OPTIONS)
    place.add_argument("--no-progress", action="store_true", help="show no progress bar")
    tune.set_defaults(command=_tune)


def _add(group: Any, options: list[_Option]) -> None:
    for option, metavar, kind, default, text in options:
        text += "" if default is None else f"; default: {default}"
        group.add_argument(option, metavar=metavar, type=kind, default=default, help=text)


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
