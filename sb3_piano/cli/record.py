"""``sb3-piano record``: write performances as a data set to learn from."""

from __future__ import annotations

import argparse
import contextlib
import re
import shlex
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sb3_piano.cli.common import (
    EXIT_INTERRUPTED,
    EXIT_OK,
    TRUST,
    add_shared,
    env_options,
    progress_bar,
    whole_number,
)
from sb3_piano.exceptions import ConfigError

if TYPE_CHECKING:
    import gymnasium as gym

    from sb3_piano.demonstrations import Recorded
    from sb3_piano.demonstrations.recording import Predictor

_POLICIES = ("planned", "sampling")
_OBSERVED = {"observation": "fingers", "fingering": "ergonomic"}
"""Options of an environment that is made here unless given: little is observed, by finger."""

_NOISE = [0.0, 0.03, 0.06, 0.1]
"""Standard deviations, rad, with which learners see how the planned pianist recovers: of a scale
that was recorded without noise they learned an F1 of 0.68, of one with it 0.93."""


def add_parser(commands: Any) -> None:
    """Add the command and its arguments."""
    record = commands.add_parser(
        "record", help="write performances as a data set to learn from", epilog=TRUST
    )
    add = record.add_argument
    add(
        "what",
        metavar="RUN|ENV_ID|PIECE",
        help="a run's folder, whose model plays; or what a planned pianist plays: an environment, "
        "a file such as MIDI, or a piece",
    )
    add("--policy", choices=_POLICIES, help="who plays, of no run; default: planned")
    add("--out", metavar="ID", help="the data set's name; default: robopianist/PIECE/POLICY-v0")
    add("--overwrite", action="store_true", help="replace a data set of this name")
    add("--episodes", type=whole_number, default=24, metavar="N", help="default: 24")
    add(
        "--noise",
        type=float,
        nargs="+",
        metavar="RAD",
        help="standard deviations of noise on the actions, in turns; default: 0 0.03 0.06 0.1 for "
        "a planned pianist, 0 for a run",
    )
    add(
        "--start",
        type=float,
        default=0.0,
        metavar="RAD",
        help="standard deviation of the joints at the start; default: 0",
    )
    add("--seed", type=int, default=0, metavar="N", help="default: 0")
    add("--fingering", metavar="HOW", help="as for train, of no run; default: ergonomic")
    add_shared(
        add,
        "--set",
        help="an option of the environment, such as initial_buffer_time=0.5; of no run; may be "
        "given several times; by default it observes by finger",
    )
    add_shared(add, "--best", help="the run's best model by f1 or onset_f1, not the last one")
    add_shared(add, "--no-progress")
    record.set_defaults(command=_record)


def _record(arguments: argparse.Namespace) -> int:
    with_minari()
    from sb3_piano.demonstrations import record

    with (
        _player(arguments) as (policy, env, default_id),
        progress_bar(arguments, "performances") as tell,
    ):
        tell(total=arguments.episodes)
        recorded = record(
            policy,
            env,
            default_id if arguments.out is None else arguments.out,
            episodes=arguments.episodes,
            noise=arguments.noise or ([0.0] if Path(arguments.what).is_dir() else _NOISE),
            seed=arguments.seed,
            overwrite=arguments.overwrite,
            policy_name=default_id.rpartition("/")[2].partition("-v")[0],
            on_episode=lambda notes: tell(advance=1),
        )
    _report(recorded)
    if recorded.interrupted:
        print("sb3-piano: interrupted.", file=sys.stderr)
        return EXIT_INTERRUPTED
    return EXIT_OK


def with_minari() -> None:
    """Refuse to go on without the packages that read and write data sets.

    Raises:
        ConfigError: If they are not installed.
    """
    from sb3_piano.demonstrations.dataset import require_minari

    try:
        require_minari()
    except ImportError as error:
        raise ConfigError(str(error)) from error


@contextlib.contextmanager
def _player(
    arguments: argparse.Namespace,
) -> Iterator[tuple[Predictor, gym.Env[Any, Any], str]]:
    """Give who plays, where, and what the data set is called by default."""
    if Path(arguments.what).is_dir():
        from sb3_piano.training.playing.player import run_to_record

        _refuse_new_env_options(arguments)
        with run_to_record(arguments.what, best=arguments.best, start=arguments.start) as found:
            policy, env, config = found
            yield policy, env, _default_id(env, config.algo)
        return
    if arguments.best is not None:
        raise ConfigError(
            f"--best cannot be given with {arguments.what!r}: only a run has models. Expected a "
            "run's folder, or no --best."
        )
    with contextlib.closing(_new_env(arguments)) as env:
        name = arguments.policy or _POLICIES[0]
        yield _pianist(name, env), env, _default_id(env, name)


def _refuse_new_env_options(arguments: argparse.Namespace) -> None:
    for option in ("set", "policy", "fingering"):
        if getattr(arguments, option):
            raise ConfigError(
                f"--{option} cannot be given with the run '{arguments.what}': its own model plays "
                f"in its own environment. Expected no --{option}."
            )


def _new_env(arguments: argparse.Namespace) -> gym.Env[Any, Any]:
    from sb3_piano.music import is_path
    from sb3_piano.training import PlannedConfig
    from sb3_piano.training.playing.player import env_to_record
    from sb3_piano.training.playing.takes import where_played

    env_id, options = where_played(arguments.what)
    if "score" in options and is_path(options["score"]):
        options["score"] = str(Path(options["score"]).resolve())  # the data set lies elsewhere
    options |= {**_OBSERVED, **env_options(arguments.set)}
    if arguments.fingering is not None:
        options["fingering"] = arguments.fingering
    config = PlannedConfig(algo=_POLICIES[0], env_id=env_id, env_kwargs=options)
    return env_to_record(config, arguments.start)


def _pianist(name: str, env: gym.Env[Any, Any]) -> Predictor:
    from sb3_piano.training.configuration.names import planner_class

    return planner_class(name)(env)


def _default_id(env: gym.Env[Any, Any], policy: str) -> str:
    from sb3_piano.envs import PianoEnv

    piece = "" if env.spec is None else env.spec.id
    if isinstance(env.unwrapped, PianoEnv):
        piece = env.unwrapped.default_score.title
    part = re.sub(r"[^\w-]+", "-", piece, flags=re.ASCII).strip("-") or "piece"
    return f"robopianist/{part}/{policy}-v0"


def _report(recorded: Recorded) -> None:
    dataset = recorded.dataset
    count = len(recorded.episodes)
    plural = "performance" if count == 1 else "performances"
    print(f"Recorded {count} {plural} of {dataset.total_steps} steps in all.")
    by_noise: dict[float, list[Mapping[str, float]]] = {}
    for episode in recorded.episodes:
        by_noise.setdefault(episode["noise"], []).append(episode)
    for noise, episodes in by_noise.items():
        if all("f1" in episode for episode in episodes):
            mean = sum(episode["f1"] for episode in episodes) / len(episodes)
            print(f"F1 {mean:.3f} with noise of {noise:g} rad ({len(episodes)})")
    print(f"Data set:    {dataset.id}")
    print(f"Folder:      {dataset.storage.data_path}")
    print(f"Learn it:    sb3-piano clone {shlex.quote(dataset.id)}")
