"""Distil a planned pianist into one sight-reading network."""

from __future__ import annotations

import contextlib
import os
import shlex
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from sb3_piano.demonstrations.dataset import forget_unfinished, require_minari
from sb3_piano.demonstrations.shards import file_digest
from sb3_piano.exceptions import RunError
from sb3_piano.files import write_bytes, write_csv, write_yaml
from sb3_piano.interrupts import stop_on_signal
from sb3_piano.jobs import Here, Outcome, finish, open_executor, status
from sb3_piano.jobs.folders import begin_or_resume, check_same
from sb3_piano.lab.distillation.config import PLANNED, DistillConfig
from sb3_piano.lab.distillation.improvement import improve, improvement_run
from sb3_piano.lab.distillation.rollout import hands_env
from sb3_piano.lab.distillation.rounds import (
    DATA,
    Make,
    Progress,
    RoundResult,
    Rounds,
    held_out_pieces,
    recorded_of,
    round_name,
    weights_file,
)
from sb3_piano.lab.distillation.shards import JUDGED_BY
from sb3_piano.lab.distillation.teachers import new_teacher
from sb3_piano.links import keep_inside, make_folder
from sb3_piano.locks import LOCK_SUFFIX, hold
from sb3_piano.music.catalogue import is_path
from sb3_piano.music.library import Library
from sb3_piano.plain_yaml import read_yaml_mapping
from sb3_piano.players import PlayerSpec
from sb3_piano.players.hand_model import FILE_NAME
from sb3_piano.threads import torch_computing
from sb3_piano.training.playing.player_files import player_files
from sb3_piano.training.runs.provenance import provenance

_CONFIG, _FILES, _TABLE = "config.yml", "files.yml", "rounds.csv"


@dataclass(frozen=True, kw_only=True)
class DistillResult:
    """Result of :func:`distill`."""

    folder: Path
    """Folder of all files."""
    rounds: tuple[RoundResult, ...]
    """Finished rounds and improvements."""
    weights: Path | None
    """File of the newest network of a hand, if a round is finished."""
    interrupted: bool = False
    """Whether Ctrl-C or SIGTERM ended it early."""


def distill(
    config: DistillConfig | None,
    folder: str | os.PathLike[str],
    *,
    executor: Executor | None = None,
    workers: int | None = None,
    num_threads: int | None = None,
    on_progress: Progress = lambda text, done, total: None,
    on_round: Callable[[RoundResult], object] = lambda result: None,
) -> DistillResult:
    """Train a policy for any piece from a teacher's labels (DAgger, Ross et al. 2011).

    In each round the teacher and, from the second round on, the previous round's network play
    excerpts, and the teacher labels each state with its action. Then a network is trained on the
    data of all rounds and evaluated on held-out music. Reinforcement learning without the teacher
    follows (``config.improvements``), with an evaluation after each improvement.

    A started distillation is resumed: finished parts are kept, and the result of the rounds equals
    that of an uninterrupted one. Ctrl-C or SIGTERM ends it; at most the training of one round and
    the shards in progress are lost.

    ======================= ======================================================================
    ``config.yml``          the settings
    ``run.yml``             command line, versions of packages, time
    ``data/``               Minari data sets of the rounds, and a manifest of each
    ``round-N.safetensors`` network of one hand after round N, from 0; ``round-N.json`` is its
                            :class:`RoundResult`
    ``improved-N/``         the run of improvement N, from 0, as :func:`~sb3_piano.training.train`
                            makes it; ``.safetensors`` and ``.json`` are its network and result
    ``hand.safetensors``    the newest of these networks, a :class:`~sb3_piano.players.HandModel`
    ``rounds.csv``          a row per result
    ======================= ======================================================================

    Args:
        config: The settings; ``None`` to resume with the folder's settings.
        folder: Output folder: new, empty, or of a distillation to resume.
        executor: Executor that plays the excerpts and sees the folder by the same path; by default
            a pool of local processes.
        workers: Processes of that pool; by default one per usable core.
        num_threads: Threads of torch for all training; by default see :mod:`sb3_piano.threads`.
        on_progress: Called with the progress.
        on_round: Called with each result, including earlier ones.

    Raises:
        ConfigError: If a setting is not valid, or the teacher does not fit.
        RunError: If the folder cannot be used, or has other settings.
        UnknownPieceError: If an evaluation piece is unknown.
        MissingPackageError: If Minari is not installed.
    """
    require_minari()
    place = Path(folder)
    if config is None:
        config = _settings_of(place)
    held_out = held_out_pieces(config)
    recorded_of(config)  # raise its errors before the work
    with contextlib.closing(hands_env(config.playing.physics)) as env:
        with new_teacher(config.teacher, config.playing, env):
            pass  # raise its errors here instead of in a worker
        hands_env(config.evaluation.physics).close()
    names = [round_name(number) for number in range(len(config.rounds))]
    improvements: dict[str, Make] = {}
    for number in range(len(config.improvements)):
        start = weights_file(place.absolute(), names[-1])
        run = improvement_run(config, number, start, num_threads)
        run.env.make().close()  # raise its errors before the rounds
        names.append(f"improved-{number}")
        improvements[names[-1]] = partial(improve, config, number, start, num_threads, on_progress)
    rounds: list[RoundResult] = []
    interrupted = False
    keep_inside(place)
    owned = hold(
        place / LOCK_SUFFIX, f"'{place}' is being worked in", "one distillation in a folder."
    )
    with owned, torch_computing(num_threads), stop_on_signal() as request:
        theirs = _settings_of(place).to_mapping() if (place / _CONFIG).is_file() else None
        notes = provenance(config.seed)
        begin_or_resume(place / _CONFIG, "distillation", config.to_mapping(), theirs, notes)
        _check_files(place, config)
        make_folder(place / DATA)
        forget_unfinished(place / DATA)
        pool = open_executor(workers) if executor is None else contextlib.nullcontext(executor)
        with pool as chosen:
            work = Rounds(config, place.absolute(), held_out, chosen, request, on_progress)
            jobs = [work.job(n, name, improvements.get(name)) for n, name in enumerate(names)]

            def tell(outcome: Outcome, *done: int) -> None:
                if outcome.error is not None:
                    raise outcome.error
                rounds.append(RoundResult(**(outcome.result or {})))
                _write_results(place, rounds, names)
                on_round(rounds[-1])

            known = status(jobs)
            for one in (one for one in known if one.result is not None):
                tell(one)
            try:
                finish(jobs, Here(), known=known, on_outcome=tell)
            except KeyboardInterrupt:
                interrupted = True
    weights = place / FILE_NAME if rounds else None
    return DistillResult(
        folder=place, rounds=tuple(rounds), weights=weights, interrupted=interrupted
    )


def _settings_of(place: Path) -> DistillConfig:
    """Read the settings of a started distillation."""
    file = place / _CONFIG
    if not file.is_file():
        raise RunError(
            f"There is no distillation in '{place}', it has no {_CONFIG}: expected a folder that "
            "'sb3-piano distill' made."
        )
    return DistillConfig.from_yaml(file)


def _check_files(place: Path, config: DistillConfig) -> None:
    """Save the checksums of the rounds' input files, or compare them with the saved ones.

    Raises:
        RunError: If a file has changed since the start of the distillation.
    """
    library = Library()
    names = sorted({name for names in config.corpus.names.values() for name in names})
    files = [Path(name) for name in names if is_path(name)]
    files += [library.path(name) for name in names if name in library]
    if config.teacher.name != PLANNED:
        files += player_files(PlayerSpec(name=config.teacher.name))
    found = {str(file): file_digest(file) for file in files}
    note = place / _FILES
    if note.is_file():
        check_same(read_yaml_mapping(note), found, f"The distillation in '{place}'")
    write_yaml(note, found)


def _write_results(place: Path, rounds: Sequence[RoundResult], names: Sequence[str]) -> None:
    """Write the table of results, and the newest network as ``hand.safetensors``."""
    columns = ("name", "transitions", "loss", *JUDGED_BY, "minutes")
    rows = [{name: getattr(result, name) for name in columns} for result in rounds]
    write_csv(place / _TABLE, columns, rows)
    files = [weights_file(place, name) for name in names]
    newest = [file for file in files if file.is_file()][-1]
    write_bytes(place / FILE_NAME, newest.read_bytes())


def resume_command(place: Path) -> str:
    """Return the command that resumes a distillation."""
    return f"sb3-piano distill --resume {shlex.quote(str(place))}"
