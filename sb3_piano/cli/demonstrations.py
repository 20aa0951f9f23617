"""``sb3-piano record`` and ``clone``: record demonstrations, and clone them into a run."""

from __future__ import annotations

import argparse
import contextlib
import os
import re
import shlex
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Any

from sb3_piano.cli.common import (
    EXIT_OK,
    TRUST,
    command,
    print_interrupted,
    progress_bar,
    refuse_options,
    whole_number,
)
from sb3_piano.cli.evaluate import evaluate_run
from sb3_piano.cli.play import PLAYERS_HELP, player_spec, stage_of
from sb3_piano.hyperparams import DEFAULT_ALGORITHM

if TYPE_CHECKING:
    import gymnasium as gym

    from sb3_piano.demonstrations import Recorded
    from sb3_piano.players import Player
    from sb3_piano.training import EnvSpec

_NOISE = [0.0, 0.03, 0.06, 0.1]
"""Standard deviations, rad, of noise on actions. Learners see how the planned pianist recovers:
on a scale, clones reached F1 0.68 without noise and 0.93 with it."""

_WHAT = (
    "a run's folder, to record its model; or a piece for the player: its name, a file such as "
    "MIDI, or an environment id"
)
_PLAYER = f"not for a run: {PLAYERS_HELP}; default: planned"
_NOISE_HELP = (
    "standard deviations of action noise, used in turn; default: 0 0.03 0.06 0.1 for a planned "
    "pianist, 0 for a run"
)
_SET_HELP = (
    "environment option, such as initial_buffer_time=0.5; not for a run; repeatable; "
    "default: observation=fingers"
)
_DATASET = (
    "name of a data set from 'sb3-piano record', or folder of a corpus from 'sb3-piano corpus'"
)
_BUFFER = (
    "transitions in memory; larger corpora are read shard by shard in each epoch; default: 2e6"
)


def add_record_arguments(parser: Any) -> None:
    """Add the arguments of ``record``."""
    add = command(parser, _record, epilog=TRUST)
    add("what", "RUN|ENV_ID|PIECE", _WHAT)
    add("--player", "PLAYER", _PLAYER)
    add("--weights", "FILE", argparse.SUPPRESS)  # deprecated
    add("--out", "ID", "name of the data set; default: robopianist/PIECE/POLICY-v0")
    add("--overwrite", text="replace an existing data set")
    add("--episodes", "N", "number of episodes", whole_number, 24)
    add("--noise", "RAD", _NOISE_HELP, float, nargs="+")
    add("--start", "RAD", "standard deviation of joint angles at the start; default: 0", float, 0.0)
    add("--seed", "N", "random seed", int, 0)
    add("--fingering", "HOW", "finger labels, as for train; not for a run; default: ergonomic")
    add("--set", "NAME=VALUE", _SET_HELP, action="append")
    add("--best", text="use the run's best model by f1 or onset_f1 instead of the last")
    add("--no-progress")


def add_clone_arguments(parser: Any) -> None:
    """Add the arguments of ``clone``."""
    add = command(parser, _clone, epilog=TRUST)
    add("dataset", "DATASET|FOLDER", _DATASET)
    add("--algo", "NAME", "algorithm: sac (default), td3, tqc or ddpg", default=DEFAULT_ALGORITHM)
    add("--config")
    add("--epochs", "N", "passes over the data set", whole_number, 60)
    add("--batch-size", "N", "transitions per gradient step", whole_number, 256)
    add("--learning-rate", "X", "initial learning rate", float, 1e-3)
    add("--buffer", "N", _BUFFER, whole_number)
    add("--hidden", "N", "sizes of the hidden layers", whole_number, [512, 512], nargs="+")
    add("--no-normalize", text="do not standardize observations")
    add("--prefill", text="fill the replay buffer with the data set, for later training")
    add("--seed", "N", "random seed; default: drawn, saved in the run's folder", int)
    add("--runs-dir", default="runs")
    add("--out", "DIR", "folder of this run; default: a new one in --runs-dir")
    add("--no-progress")
    add("--evaluate", text="evaluate the model afterwards")


def _record(arguments: argparse.Namespace) -> int:
    from sb3_piano.demonstrations import record, require_minari

    require_minari()  # before planning

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
            noise=arguments.noise or ([0.0] if os.path.isdir(arguments.what) else _NOISE),
            seed=arguments.seed,
            overwrite=arguments.overwrite,
            policy_name=default_id.rpartition("/")[2].partition("-v")[0],
            on_episode=lambda notes: tell(advance=1),
        )
    _show(recorded)
    return print_interrupted(recorded.interrupted)


@contextlib.contextmanager
def _player(
    arguments: argparse.Namespace,
) -> Iterator[tuple[Player, gym.Env[Any, Any], str]]:
    """Yield the player, its environment and the default name of the data set."""
    from sb3_piano.training import RunFolder
    from sb3_piano.training.playing.recording import player_to_record
    from sb3_piano.training.playing.run_player import titles_of_copies

    what = arguments.what
    if os.path.isdir(what):
        reason = f"with the run '{what}': its own model plays in its own environment."
        refuse_options(arguments, ("set", "player", "weights", "fingering"), reason)
        spec, stage = player_spec(arguments, what), None
    else:
        instead = "Expected a run's folder, or no --best."
        refuse_options(arguments, ["best"], f"with {what!r}: only a run has models.", instead)
        spec = player_spec(arguments, "planned")
        stage = _stage(arguments, spec.name)
    options = {"best": arguments.best, "start": arguments.start}
    with player_to_record(spec, stage, **options) as (policy, env):
        piece, name = _piece_of(env), spec.label
        if spec.is_run:
            run = RunFolder(Path(spec.name))
            former = run.read_player()
            name = run.read_config().algo if former is None else former[0].name
            piece = titles_of_copies(run, env).get(piece, piece)
        yield policy, env, _default_id(piece, name)


def _stage(arguments: argparse.Namespace, player: str) -> EnvSpec:
    from sb3_piano.music.catalogue import is_path
    from sb3_piano.music.fingering.apply import FINGERINGS

    options: dict[str, Any] = {"observation": "fingers", "fingering": "ergonomic"}
    if player == "sight-reader":  # the only action space of its network
        options["reduced_action_space"] = False
    if arguments.fingering is not None:
        options["fingering"] = arguments.fingering
        if arguments.fingering not in FINGERINGS:
            options["fingering"] = os.path.realpath(arguments.fingering)
    if is_path(arguments.what) and os.path.exists(arguments.what):
        arguments.what = os.path.realpath(arguments.what)  # data sets are in another folder
    return stage_of(arguments, defaults={}, **options)


def _default_id(piece: str, policy: str) -> str:
    part = re.sub(r"[^\w-]+", "-", piece, flags=re.ASCII).strip("-") or "piece"
    return f"robopianist/{part}/{policy}-v0"


def _piece_of(env: gym.Env[Any, Any]) -> str:
    from sb3_piano.envs import PianoEnv

    if isinstance(env.unwrapped, PianoEnv):
        return env.unwrapped.default_score.title
    return "" if env.spec is None else env.spec.id


def _show(recorded: Recorded) -> None:
    dataset, count = recorded.dataset, len(recorded.episodes)
    plural = "performance" if count == 1 else "performances"
    print(f"Recorded {count} {plural} of {dataset.total_steps} steps in all.")
    by_noise: dict[float, list[float]] = defaultdict(list)
    for episode in recorded.episodes:
        if "f1" in episode:
            by_noise[episode["noise"]].append(episode["f1"])
    for noise, scores in by_noise.items():
        print(f"F1 {fmean(scores):.3f} with noise of {noise:g} rad ({len(scores)})")
    print(f"Data set:    {dataset.id}")
    print(f"Folder:      {dataset.storage.data_path}")
    print(f"Learn it:    sb3-piano clone {shlex.quote(dataset.id)}")


def _clone(arguments: argparse.Namespace) -> int:
    from rich.progress import TextColumn

    from sb3_piano.demonstrations.streaming import DEFAULT_BUFFER
    from sb3_piano.training import clone

    loss = TextColumn("loss {task.fields[loss]:.2g}")
    with progress_bar(arguments, "epochs", [loss]) as tell:
        tell(total=arguments.epochs, loss=float("nan"))
        result = clone(
            arguments.dataset,
            arguments.algo,
            arguments.out,
            runs_dir=arguments.runs_dir,
            config=arguments.config,
            net_arch=arguments.hidden,
            normalize=not arguments.no_normalize,
            prefill=arguments.prefill,
            seed=arguments.seed,
            epochs=arguments.epochs,
            batch_size=arguments.batch_size,
            learning_rate=arguments.learning_rate,
            buffer=arguments.buffer or DEFAULT_BUFFER,
            on_epoch=lambda loss: tell(advance=1, loss=loss),
        )
    path, cloning = shlex.quote(str(result.folder.path)), result.cloning
    print(f"Cloned {cloning.n_transitions} transitions, to a loss of {cloning.losses[-1]:.2g}.")
    print(f"Run:         {result.folder.path}")
    print(f"Model:       {result.folder.model_file}")
    print(f"Evaluate:    sb3-piano evaluate {path}")
    print(f"Train on:    sb3-piano train --resume {path}")
    if arguments.evaluate:
        evaluate_run(str(result.folder.path))
    return EXIT_OK
