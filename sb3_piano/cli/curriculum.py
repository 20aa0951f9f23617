"""``sb3-piano curriculum``: train stages, each from the model of the stage before."""

from __future__ import annotations

import argparse
import dataclasses
import math
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sb3_piano.cli.common import (
    EXIT_INTERRUPTED,
    EXIT_OK,
    TRUST,
    add_row,
    command,
    new_table,
    print_table,
    refuse_options,
    whole_number,
)
from sb3_piano.cli.evaluate import evaluate_run
from sb3_piano.exceptions import ConfigError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sb3_piano.jobs import Job, Outcome

_OUT_HELP = "folder of the curriculum; default: runs/curricula/NAME, after FILE"
_METRICS = ("f1", "onset_f1")
_NOTHING = "-"


def add_arguments(parser: Any) -> None:
    """Add the arguments of the command."""
    add = command(parser, _curriculum, epilog=TRUST)
    add("file", "FILE", "YAML file of the stages; the same command resumes them", nargs="?")
    add("--out", "FOLDER", _OUT_HELP)
    add("--runs-dir")
    add("--seed", "N", "seed of every stage; default: the file's, or drawn", int)
    add("--resume", "FOLDER", "resume the curriculum in this folder, without its file")
    add("--checkpoint-every", "N", "steps between checkpoints; default: 10000", whole_number)
    add("--status", text="print the progress of each stage, also while it trains, and exit")
    add("--evaluate", text="evaluate the model of the last stage afterwards")
    add("--no-progress")


def _curriculum(arguments: argparse.Namespace) -> int:
    from sb3_piano.jobs import status
    from sb3_piano.pipelines import load_curriculum, run_curriculum
    from sb3_piano.pipelines.curriculum import curriculum_jobs

    options: dict[str, Any] = {"progress_bar": not arguments.no_progress}
    if arguments.checkpoint_every is not None:
        options["checkpoint_every"] = arguments.checkpoint_every
    if (arguments.file is None) == (arguments.resume is None):
        raise ConfigError("Expected either a FILE with stages or --resume FOLDER.")
    folder = arguments.out if arguments.resume is None else arguments.resume
    if arguments.resume is not None:
        reason = "with --resume: a curriculum keeps its folder and seed."
        refuse_options(arguments, ("out", "runs_dir", "seed"), reason, "Expected --resume alone.")
    runs_dir = "runs" if arguments.runs_dir is None else arguments.runs_dir
    curriculum = load_curriculum(folder if arguments.file is None else arguments.file)
    place = Path(folder or Path(runs_dir, "curricula", curriculum.name))
    if arguments.status:
        _show(status(curriculum_jobs(place, load_curriculum(place))))
        return EXIT_OK
    number = {name: n for n, name in enumerate(curriculum.run_names, start=1)}
    trained = []

    def tell(stage: Job) -> None:
        trained.append(stage.name)
        print(f"[{number[stage.name]}/{len(number)}] {stage.name}", flush=True)

    if arguments.seed is not None:
        curriculum = dataclasses.replace(curriculum, seed=arguments.seed)
    stages = run_curriculum(curriculum, place, on_stage=tell, **options)
    last = str(place / curriculum.run_names[-1])
    _report(stages, place, last, bool(trained))
    if stages[-1].result is None:
        return EXIT_INTERRUPTED
    if arguments.evaluate:
        evaluate_run(last)
    return EXIT_OK


def _report(stages: Sequence[Outcome], place: Path, last: str, has_trained: bool) -> None:
    _show(stages)
    print(f"Folder:   {place}")
    if stages[-1].result is None:
        resume = f"sb3-piano curriculum --resume {shlex.quote(str(place))}"
        print(f"Go on:    {resume}")
        return
    if not has_trained:
        print("All stages had ended: nothing was left to do. Once more: with another --out FOLDER")
    print(f"Evaluate: sb3-piano evaluate {shlex.quote(last)}")


def _show(stages: Sequence[Outcome]) -> None:
    from sb3_piano.cli.evaluation_tables import label, rounded

    table = new_table("stage", "ended by", "steps", *map(label, _METRICS), left=2)
    for stage in stages:
        job: Any = stage.job
        result = stage.result or {}
        evaluations = job.evaluations(result.get("num_timesteps", math.inf)).values()
        metrics = [{}, *evaluations][-1]
        last = [rounded(n, metrics[n]) if n in metrics else _NOTHING for n in _METRICS]
        steps = str(job.progress()[0] or _NOTHING)
        add_row(table, job.name, result.get("ended_by", _NOTHING), steps, *last)
    print_table(table)
