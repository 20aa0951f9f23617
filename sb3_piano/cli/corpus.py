"""``sb3-piano corpus``: record demonstrations of many pieces with many processes."""

from __future__ import annotations

import argparse
import shlex
from collections import defaultdict
from statistics import fmean
from typing import TYPE_CHECKING, Any

from sb3_piano.cli.common import (
    EXIT_OK,
    TRUST,
    add_row,
    command,
    env_options,
    new_table,
    print_interrupted,
    print_table,
    progress_bar,
    whole_number,
)
from sb3_piano.cli.play import PLAYERS_HELP
from sb3_piano.cli.settings import add_settings, given

if TYPE_CHECKING:
    from sb3_piano.demonstrations.corpus import RecordedCorpus

_PIECES = (
    "pieces: names, files, patterns such as 'scale-*' or '~/midi/**/*.mid', collections such as "
    "repertoire, or lists in .txt files"
)
_PLAYERS = f"players of every excerpt: {PLAYERS_HELP}; default: planned"
_FIELDS = ("excerpts", "seconds", "episodes", "noise", "start", "by_hand", "shard", "seed")
_SET = "environment option, such as observation=roll; not for a run; repeatable"


def add_arguments(parser: Any) -> None:
    """Add the arguments of the command."""
    from sb3_piano.pipelines import CorpusConfig

    add = command(parser, _corpus, epilog=TRUST)
    add("pieces", "PIECE", _PIECES, nargs="+")
    add("--out", "FOLDER", "folder of the corpus; the same command resumes it", required=True)
    add("--player", "PLAYER", _PLAYERS, nargs="+", dest="players")
    add_settings(add, CorpusConfig, *_FIELDS)
    add("--set", "NAME=VALUE", _SET, action="append")
    add("--status", text="print the state of each shard, also while recording, and exit")
    add("--workers", "N", "worker processes; default: one per core", whole_number)
    add("--ray", "ADDRESS", "address of a Ray cluster; all nodes must see the same folders")
    add("--no-progress")


def _corpus(arguments: argparse.Namespace) -> int:
    from sb3_piano.jobs import open_executor, status
    from sb3_piano.jobs.folders import shared_folder
    from sb3_piano.pipelines import CorpusConfig, record_corpus
    from sb3_piano.pipelines.corpus import corpus_jobs

    config = CorpusConfig(
        **given(arguments, CorpusConfig), env_kwargs=env_options(arguments.set or ())
    )
    if arguments.status:
        table = new_table("shard", "state", left=2)
        for shard in status(corpus_jobs(config, shared_folder(arguments.out))):
            add_row(table, shard.job.name, shard.state)
        print_table(table)
        return EXIT_OK
    with (
        open_executor(arguments.workers, arguments.ray) as executor,
        progress_bar(arguments, "performances") as tell,
    ):
        corpus = record_corpus(
            config,
            arguments.out,
            executor=executor,
            on_progress=lambda done, total: tell(completed=done, total=total),
        )
    if corpus is None:
        return print_interrupted(True, hint="; the same command resumes it.")
    _show(corpus)
    return EXIT_OK


def _show(corpus: RecordedCorpus) -> None:
    played: dict[Any, list[Any]] = defaultdict(list)
    for notes in (notes for shard in corpus.shards for notes in shard.episodes):
        played[notes["player"], notes["noise"]].append(notes)
    table = new_table("player", "noise, rad", "performances", "F1", "onset F1")
    for (player, noise), each in played.items():
        shown = [f"{fmean(notes[name] for notes in each):.3f}" for name in ("f1", "onset_f1")]
        add_row(table, player, f"{noise:g}", str(len(each)), *shown)
    print_table(table)
    if corpus.skipped:
        number, why = next(iter(corpus.skipped.items()))
        print(f"{len(corpus.skipped)} were left out, such as number {number}: {why}")
    print(f"Steps:       {corpus.steps} in {len(corpus.shards)} shards")
    print(f"Content:     {corpus.content}")
    print(f"Folder:      {corpus.folder}")
    print(f"Learn it:    sb3-piano clone {shlex.quote(str(corpus.folder))}")
