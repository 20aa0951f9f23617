"""Learning curves of several settings, on several pieces, from several seeds, at equal CPU time.

    python benchmarks/learning.py benchmarks/learning/on_time.yml --out on_time
    python benchmarks/learning.py benchmarks/learning/on_time.yml --out on_time --report

A study is a YAML file: at most so many ``minutes`` of one core for each training, ``every`` so many
steps an evaluation, ``seeds``, ``envs`` (ids) and ``pieces`` (names or files), of which only the
first ``seconds`` where it names some, and ``variants``: for each name the algorithm (``algo``), the
preset's entry ``default`` in place of the piece's (``published``), another ``file`` than the
preset's or "fast", a player to be corrected (``player``), a run whose networks are the beginning
(``start``), and ``settings`` laid over these. "{piece}" in the player and ``fingering`` is the
piece's name, "{seed}" in ``start`` the seed.

Each training of stock SB3 is a process with one thread of torch. The deterministic policy plays an
episode in an environment of its own, always on the reference physics; the clock stands still
meanwhile. A training is a file of JSON lines in ``--out``: stop it and call it again to go on with
those that are not whole. In the end there are a table of the first and the last models, mean
[least, greatest] of n seeds, of several pieces also their mean and gain with 95 % intervals of a
bootstrap over n pieces, and ``curves.png``. "floor" is an F1 less than 0.05 above that of resting
hands.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import gymnasium as gym
import matplotlib.pyplot as plt
import numpy as np
import torch
from rich.console import Console
from rich.progress import Progress
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecNormalize, sync_envs_normalization

from sb3_piano.callbacks import MetricEvalCallback
from sb3_piano.envs import GENERAL_ID
from sb3_piano.exceptions import SB3PianoError
from sb3_piano.interrupts import stop_on_signal
from sb3_piano.jobs import map_jobs, open_executor
from sb3_piano.music import load_score, write_midi
from sb3_piano.plain_yaml import read_yaml_mapping
from sb3_piano.settings import Count, Index, Listed, Nested, Positive, settings
from sb3_piano.training import RunConfig, load_config, load_fine_tuning
from sb3_piano.training.evaluation.statistics import summarize
from sb3_piano.training.runs.builders import build_callbacks, build_model, build_vec_env

METRICS = {"f1": "F1", "onset_f1": "onset F1"}

FLOOR = 0.05
"""An F1 by so much above that of resting hands, or less, is no playing."""

Row = dict[str, float]
"""An evaluation."""
Ends = tuple[Row, Row]
"""The first and the last one of a training."""


@settings
class Variant:
    """Settings that are compared with others."""

    algo: str = "sac"
    published: bool = False
    file: str | None = None
    player: str | None = None
    start: str | None = None
    settings: dict[str, Any] = dataclasses.field(default_factory=dict)

    def config(self, piece: Piece, seed: int) -> RunConfig:
        """Return the settings of a training."""
        given = dict(self.settings)
        kwargs = {**given.pop("env_kwargs", {}), **piece.env_kwargs}
        if "fingering" in kwargs:
            kwargs["fingering"] = kwargs["fingering"].format(piece=piece.name)
        env_id = piece.env_id
        if self.published:
            kwargs = {**gym.spec(env_id).kwargs, **kwargs}
            env_id = GENERAL_ID
        given |= {"env_kwargs": kwargs, "seed": seed, "vec_env": "dummy"}
        if self.start is not None:
            start = {"run": self.start.format(seed=seed)}
            given["callback"] = [
                *given.get("callback", []),
                {"sb3_piano.training.StartFromRun": start},
            ]
        if self.player is not None:
            player = self.player.format(piece=piece.name)
            return load_fine_tuning(self.algo, env_id, player=player, **given)
        return load_config(self.algo, env_id, self.file, **given)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Piece:
    """What is played, and where."""

    env_id: str
    env_kwargs: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    @property
    def name(self) -> str:
        """A short name, for files too."""
        score = str(self.env_kwargs.get("score", ""))
        return Path(score).stem or self.env_id.removeprefix("RoboPianist-").removesuffix("-v0")


@settings
class StudyFile:
    """What a study's file says."""

    minutes: Positive
    every: Count
    seeds: Annotated[tuple[Index, ...], Listed]
    variants: dict[str, Nested[Variant]]
    envs: Annotated[tuple[str, ...], Listed] = ()
    pieces: Annotated[tuple[str, ...], Listed] = ()
    seconds: Positive | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class Study:
    """A study with its pieces."""

    minutes: float
    every: int
    seeds: Sequence[int]
    variants: Mapping[str, Variant]
    pieces: Sequence[Piece]

    @classmethod
    def from_yaml(cls, path: Path, beginnings: Path | None) -> Study:
        """Read it; the beginnings of pieces are written into a folder, if one is given."""
        file = StudyFile(**read_yaml_mapping(path))
        pieces = [Piece(env_id=env_id) for env_id in file.envs]
        for name in file.pieces:
            score = name
            if file.seconds is not None and beginnings is not None:
                score = str(beginning(name, file.seconds, beginnings))
            pieces.append(Piece(env_id=GENERAL_ID, env_kwargs={"score": score}))
        return cls(
            minutes=file.minutes,
            every=file.every,
            seeds=file.seeds,
            variants=file.variants,
            pieces=pieces,
        )

    def cells(self) -> Iterator[tuple[str, Piece, int]]:
        """Yield variant, piece and seed of each training, seed by seed."""
        for seed in self.seeds:
            for piece in self.pieces:
                for variant in self.variants:
                    yield variant, piece, seed


def beginning(name: str, seconds: float, folder: Path) -> Path:
    """Return the file with a piece's first seconds."""
    score = load_score(name)
    file = folder / f"{Path(name).stem}.mid"
    folder.mkdir(parents=True, exist_ok=True)
    write_midi(score.excerpt(0, min(seconds, score.duration)), file)
    return file


class TimedEvaluation(BaseCallback):
    """Play a deterministic episode every ``every`` steps; stop when the CPU time is up."""

    def __init__(self, config: RunConfig, every: int, seconds: float, out: Path) -> None:
        super().__init__()
        self.venv = build_vec_env(config.alone().in_env(physics="reference"))
        if isinstance(self.venv, VecNormalize):
            self.venv.training = False
        self.every, self.seconds, self.out = every, seconds, out
        self.cpu, self.due_at = 0.0, 0

    def _on_training_start(self) -> None:
        self.start = time.process_time()

    def _on_rollout_start(self) -> None:
        if self.num_timesteps >= self.due_at:
            self.evaluate()

    def _on_step(self) -> bool:
        return self.cpu + time.process_time() - self.start < self.seconds

    def evaluate(self) -> None:
        """Write a line."""
        self.cpu += time.process_time() - self.start
        self.due_at = self.num_timesteps + self.every
        sync_envs_normalization(self.training_env, self.venv)
        observation: Any = self.venv.reset()
        done = False
        while not done:
            action, _ = self.model.predict(observation, deterministic=True)
            observation, _, dones, infos = self.venv.step(action)
            done = bool(dones[0])
        row = {"steps": self.num_timesteps, "cpu_seconds": round(self.cpu, 1)}
        row |= {name: round(infos[0][name], 4) for name in (*METRICS, "noop_f1")}
        row["fingers"] = round(infos[0]["effective_fingers"], 2)
        with self.out.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")
        self.start = time.process_time()


def run(training: tuple[Variant, Piece, int, Study, Path]) -> None:
    """Train until the time is up; the file has its name when it is whole."""
    variant, piece, seed, study, file = training
    torch.set_num_threads(1)
    config = variant.config(piece, seed)
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_suffix(".part")
    part.unlink(missing_ok=True)
    model = build_model(config, build_vec_env(config))
    callback = TimedEvaluation(config, study.every, 60 * study.minutes, part)
    # Not those that evaluate: their time would count.
    own = [one for one in build_callbacks(config) if not isinstance(one, MetricEvalCallback)]
    model.learn(config.n_timesteps, callback=[*own, callback])
    callback.evaluate()
    part.replace(file)


def file_of(out: Path, variant: str, piece: Piece, seed: int) -> Path:
    """Return the file of a training's evaluations."""
    return out / variant / f"{piece.name}-{seed}.jsonl"


def train_all(study: Study, out: Path, jobs: int | None) -> None:
    """Train what is not whole yet."""
    todo = [
        (study.variants[name], piece, seed, study, file)
        for name, piece, seed in study.cells()
        if not (file := file_of(out, name, piece, seed)).is_file()
    ]
    with (
        stop_on_signal() as request,
        open_executor(jobs) as executor,
        Progress(console=Console(stderr=True)) as progress,
    ):
        bar = progress.add_task(f"{len(todo)} trainings of {study.minutes:g} min", total=len(todo))
        for _ in map_jobs(executor, run, todo, request):
            progress.advance(bar)


def rows_of(file: Path) -> list[Row]:
    """Return the evaluations of a training."""
    return [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]


def print_table(study: Study, out: Path) -> None:
    """Print what the trainings before and after have played."""
    before = " | ".join(f"{name} before | {name}" for name in METRICS.values())
    print(f"| variant | piece | n | steps | minutes | {before} | fingers |")
    print("|---|---|---:|---:|---:|---:|---|---:|---|---:|")
    for name in study.variants:
        means: list[Ends] = []
        for piece in study.pieces:
            ends = [(rows[0], rows[-1]) for rows in trainings(study, out, name, piece)]
            if ends:
                print_row(name, piece.name, ends)
                first, last = zip(*ends, strict=True)
                means.append((mean_of(first), mean_of(last)))
        if len(means) > 1:
            print_row(f"**{name}**", "mean", means, over_pieces=True)
            gains = " | ".join(f" | {gain_text(metric, means)}" for metric in METRICS)
            print(f"| **{name}** | gain | {len(means)} |  |  | {gains} |  |")


def trainings(study: Study, out: Path, variant: str, piece: Piece) -> list[list[Row]]:
    """Return the evaluations of each training that is whole, seed by seed."""
    files = [file_of(out, variant, piece, seed) for seed in study.seeds]
    return [rows_of(file) for file in files if file.is_file()]


def draw_curves(study: Study, out: Path, file: Path) -> None:
    """Draw both scores over minutes, a column for each piece, a curve for each training."""
    figure, axes = plt.subplots(
        len(METRICS),
        len(study.pieces),
        figsize=(1.5 + 3 * len(study.pieces), 5),
        sharex=True,
        sharey=True,
        squeeze=False,
        layout="constrained",
    )
    for color, name in enumerate(study.variants):
        for column, piece in enumerate(study.pieces):
            for number, rows in enumerate(trainings(study, out, name, piece)):
                minutes = [one["cpu_seconds"] / 60 for one in rows]
                for row, metric in enumerate(METRICS):
                    axes[row, column].plot(
                        minutes,
                        [one[metric] for one in rows],
                        color=f"C{color}",
                        alpha=0.7,
                        label=None if number else name,
                    )
    for column, piece in enumerate(study.pieces):
        axes[0, column].set_title(piece.name.removeprefix("debug-"), fontsize=9)
        axes[-1, column].set_xlabel("minutes of one core")
    for row, label in enumerate(METRICS.values()):
        axes[row, 0].set(ylabel=label, ylim=(-0.02, 1.02))
    for each in axes.flat:
        each.grid(alpha=0.3)
    axes[0, 0].legend()
    figure.savefig(file, dpi=120)


def mean_of(rows: Sequence[Row]) -> Row:
    """Return the mean of each number."""
    return {name: float(np.mean([row[name] for row in rows])) for name in rows[0]}


def print_row(name: str, piece: str, ends: Sequence[Ends], *, over_pieces: bool = False) -> None:
    """Print the means of trainings, or of pieces, the scores of the last models with their spread.

    In brackets are the least and the greatest of the trainings, and the interval over pieces.
    """
    first, last = mean_of([before for before, _ in ends]), mean_of([after for _, after in ends])
    scores = []
    for metric in METRICS:
        found = [after[metric] for _, after in ends]
        spread = summarize(found).interval if over_pieces else (min(found), max(found))
        text = f"{last[metric]:.3f}"
        if spread and len(found) > 1:
            text += f" [{spread[0]:.3f}, {spread[1]:.3f}]"
        if metric == "f1" and last["f1"] < last["noop_f1"] + FLOOR:
            text += " floor"
        scores.append(f"{first[metric]:.3f} | {text}")
    minutes = last["cpu_seconds"] / 60
    print(
        f"| {name} | {piece} | {len(ends)} | {last['steps']:,.0f} | {minutes:.1f} | "
        f"{' | '.join(scores)} | {last['fingers']:.1f} |"
    )


def gain_text(metric: str, means: Sequence[Ends]) -> str:
    """Return what training adds on the mean of the pieces, with the interval, as text."""
    gain = summarize([after[metric] - before[metric] for before, after in means])
    low, high = gain.interval or (gain.mean, gain.mean)
    return f"{gain.mean:+.3f} [{low:+.3f}, {high:+.3f}]"


def main(arguments: Sequence[str] | None = None) -> None:
    """Train and report."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    add = parser.add_argument
    add("study", type=Path, help="the YAML file")
    add("--out", type=Path, required=True, help="folder of the evaluations")
    add("--jobs", type=int, help="trainings at a time; default: cores")
    add("--report", action="store_true", help="train nothing, print the table of what there is")
    add(
        "--curves", type=Path, help="PNG file of curves; default: curves.png in --out when training"
    )
    given = parser.parse_args(arguments)
    try:
        study = Study.from_yaml(given.study, None if given.report else given.out / "pieces")
    except SB3PianoError as error:
        parser.error(str(error))
    if not given.report:
        try:
            train_all(study, given.out, given.jobs)
        except KeyboardInterrupt:
            print("Interrupted: the same command goes on from here.")
            raise SystemExit(130) from None
    elif not any(file_of(given.out, *cell).is_file() for cell in study.cells()):
        parser.error(
            f"There is no training of '{given.study}' in '{given.out}': expected one that has "
            "ended. Give the command without --report first."
        )
    print_table(study, given.out)
    if curves := given.curves or (None if given.report else given.out / "curves.png"):
        draw_curves(study, given.out, curves)


if __name__ == "__main__":
    main()
