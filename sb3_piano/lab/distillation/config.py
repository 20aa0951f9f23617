"""Settings of a distillation, and their YAML files."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping
from dataclasses import field, replace
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from annotated_types import Ge, MinLen

from sb3_piano.demonstrations.streaming import DEFAULT_BUFFER
from sb3_piano.exceptions import ConfigError, naming
from sb3_piano.lab.music import Corpus
from sb3_piano.lab.music.corpus import SOURCES
from sb3_piano.music.catalogue import is_path
from sb3_piano.plain_yaml import read_yaml_mapping
from sb3_piano.planning import PlanSettings
from sb3_piano.settings import (
    Count,
    Index,
    Listed,
    Nested,
    NotNegative,
    Number,
    Positive,
    Share,
    Unit,
    settings,
)
from sb3_piano.training.configuration.values import plain

DEFAULT_FILE = Path(__file__).with_name("distill.yml")
"""The package's default settings."""

PLANNED = "planned"
"""Name of the teacher that plans each excerpt."""

Noise = Annotated[Number, Ge(0), Unit("rad")]


@settings
class Round:
    """A round: play excerpts, then train the network on the data of all rounds so far."""

    excerpts: Count
    """Number of excerpts; they follow those of the previous round."""
    learner: Share = 0.0
    """Share of segments played by the previous round's network; 0 in the first round."""
    noise: Noise = 0.04
    """Standard deviation of the noise on the teacher's actions, rad of a finger's joint."""
    learner_noise: Noise = 0.012
    """Standard deviation of the noise on the learner's actions, likewise."""
    warm: bool = False
    """Whether training starts from the previous round's weights instead of new ones."""
    epochs: Count = 6
    """Number of passes over the data of all rounds."""
    batch_size: Count = 512
    """Rows (of one hand) per update."""
    learning_rate: Positive = 1e-3
    """Peak learning rate of Adam in a one-cycle schedule."""
    huber: Positive = 0.1
    """Error of a finger's joint beyond which the loss grows linearly, rad."""


@settings
class PlayingSettings:
    """How training excerpts are played."""

    physics: str = "fast"
    """Name of the physics profile."""
    noise_scales: Annotated[tuple[NotNegative, ...], Listed, MinLen(1)] = (0.0, 0.5, 1.0, 1.5)
    """Factors of a round's noise; each excerpt draws one."""
    noise_memory: Annotated[Number, Ge(0), Unit("s")] = 0.2
    """Time in which the noise's correlation falls to 1/e, s."""
    segment: Annotated[tuple[Positive, Positive], Listed] = (0.5, 3.0)
    """Shortest and longest segment with one player, s."""
    takeover_slider: Positive = 0.03
    """Distance of a hand from its plan, along the keyboard, at which the teacher takes over, m. It
    hands back at half of it."""
    takeover_joints: Positive = 0.35
    """The same for the root mean square of a hand's joint angles, rad."""


@settings
class TeacherSettings:
    """The teacher, whose actions label the states."""

    name: str = PLANNED
    """``planned``, or the folder of a run with observation "hands" and HandActions."""
    plan: Nested[PlanSettings] = field(
        default_factory=lambda: PlanSettings(
            rounds=3, iterations=3, dynamic_iterations=4, feedback=0.75
        )
    )
    """Settings of the excerpts' plans: fast, by default without ``passes`` of refinement."""

    def __post_init__(self) -> None:
        if self.name != PLANNED and os.path.isdir(self.name):
            object.__setattr__(self, "name", _absolute(self.name))


@settings
class NetworkSettings:
    """The network of a hand."""

    net_arch: Annotated[tuple[Count, ...], Listed] = (384, 384, 384)
    """Sizes of the hidden layers."""
    activation: Literal["SiLU", "ReLU"] = "SiLU"
    """Activation function, by its name in ``torch.nn``."""


@settings
class EvaluationSettings:
    """Evaluation of the network alone, after each round and improvement."""

    physics: str = "reference"
    """Name of the physics profile."""
    excerpts: Index = 12
    """Number of excerpts of the training corpus with another seed."""
    pieces: Annotated[tuple[str, ...], Listed] = (
        "FurElise",
        "ClairDeLune",
        "BachMinuetG",
        "Reverie",
        "BachPreludeC",
        "TwinkleTwinkle",
        "scale-EbMajor",
        "arpeggio-BMinor",
    )
    """Names or files of pieces outside of the corpus."""
    duration: Positive | None = 30.0
    """Longest part of a piece, s; ``None`` for whole pieces."""

    def __post_init__(self) -> None:
        if not (self.excerpts or self.pieces):
            raise ConfigError(
                "evaluation has no excerpts and no pieces: expected at least one of them."
            )
        pieces = tuple(_absolute(piece) if is_path(piece) else piece for piece in self.pieces)
        object.__setattr__(self, "pieces", pieces)


@settings
class Improvement:
    """Reinforcement learning from the previous network, without a teacher."""

    n_timesteps: Count
    """Steps of the training; with hands as agents, twice the control steps."""
    physics: str | None = None
    """Name of the physics profile; by default the file's."""
    corpus: Mapping[str, Any] = field(default_factory=dict)
    """Settings of the corpus that replace the distillation's."""
    algo: str = "ppo"
    """Name of the algorithm."""
    config: str | None = None
    """File of its settings in RL Zoo's form, by default ``hyperparams/sight_reader/ppo.yml`` of
    this package. Its ``CorpusExcerpt`` gets the corpus, its policy the network's size and its
    weights."""

    def __post_init__(self) -> None:
        if self.config is not None:
            object.__setattr__(self, "config", _absolute(self.config))


@settings
class DistillConfig:
    """All settings of a distillation.

    Relative paths become absolute, so that it can be resumed from any folder.

    Raises:
        ConfigError: If a setting is unknown, has the wrong type or is out of range, or an
            evaluation piece is also in the corpus.
    """

    corpus: Nested[Corpus] = field(default_factory=Corpus)
    """Training excerpts; rounds with more excerpts than it has start over, with other noise and
    other segments."""
    rounds: Annotated[tuple[Nested[Round], ...], Listed, MinLen(1)] = (
        Round(excerpts=300, epochs=18),
        Round(excerpts=200, learner=0.8, warm=True, epochs=8, batch_size=768, learning_rate=6e-4),
    )
    playing: Nested[PlayingSettings] = field(default_factory=PlayingSettings)
    teacher: Nested[TeacherSettings] = field(default_factory=TeacherSettings)
    network: Nested[NetworkSettings] = field(default_factory=NetworkSettings)
    improvements: Annotated[tuple[Nested[Improvement], ...], Listed] = (
        Improvement(n_timesteps=3_200_000),
        Improvement(n_timesteps=2_400_000, physics="fast-contacts", corpus={"near": 0.3}),
    )
    """Improvements after the rounds; each is followed by an evaluation."""
    evaluation: Nested[EvaluationSettings] = field(default_factory=EvaluationSettings)
    shard: Count = 25
    """Excerpts per data set; one process plays each data set."""
    recorded: str | None = None
    """Folder of a corpus, from ``sb3-piano corpus --by-hand``, that replaces the first round's
    data; the round's ``excerpts`` are not played."""
    buffer: Count = DEFAULT_BUFFER
    """Rows (of one hand) in memory during training; with more, shards are read in each epoch."""
    seed: Index = 0
    """Seed of the noise, the segments' players and the network; the corpus has its own."""

    def __post_init__(self) -> None:
        for name in ("learner", "warm"):
            if getattr(self.rounds[0], name):
                raise ConfigError(
                    f"rounds[0].{name} is {getattr(self.rounds[0], name)}: expected "
                    f"{getattr(Round(excerpts=1), name)}, there is no learner before the first "
                    "round."
                )
        if self.recorded is not None:
            object.__setattr__(self, "recorded", _absolute(self.recorded))
        improvements = tuple(map(self._with_absolute_paths, range(len(self.improvements))))
        object.__setattr__(self, "improvements", improvements)
        object.__setattr__(self, "corpus", _with_absolute_paths(self.corpus))
        low, high = self.playing.segment
        if low > high:
            raise ConfigError(
                f"playing.segment is {low:g} to {high:g} s: expected the least first."
            )
        for corpus in (self.corpus, *map(self.corpus_of, range(len(self.improvements)))):
            self._check_unseen(corpus)

    def _with_absolute_paths(self, number: int) -> Improvement:
        one, corpus = self.improvements[number], _with_absolute_paths(self.corpus_of(number))
        return replace(one, corpus={name: getattr(corpus, name) for name in one.corpus})

    def _check_unseen(self, corpus: Corpus) -> None:
        for source, names in corpus.names.items():
            learnt = {alias for n in names for alias in (n, n.partition("-")[2], Path(n).stem)}
            learnt |= {os.path.realpath(name) for name in names if is_path(name)}
            for piece in self.evaluation.pieces:
                if (os.path.realpath(piece) if is_path(piece) else piece) in learnt:
                    raise ConfigError(
                        f"evaluation.pieces has {piece!r}, which the corpus learns from (source "
                        f"{source!r}): expected other pieces, or it in corpus.held_out too."
                    )

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any]) -> Self:
        """Return the settings of a YAML file's content; missing settings get their defaults."""
        return cls(**mapping)

    @classmethod
    def from_yaml(cls, path: str | os.PathLike[str], **changes: Any) -> Self:
        """Load the settings of a YAML file.

        Args:
            path: The file.
            **changes: Values that replace the file's, by names such as ``corpus.seed`` or
                ``rounds.0.epochs``.

        Raises:
            ConfigError: If it cannot be read, or a setting is not valid.
        """
        mapping: Any = read_yaml_mapping(Path(path))
        given = f" with {', '.join(changes)} replaced" if changes else ""
        with naming(f"'{path}'{given}"):
            for name, value in changes.items():
                _change(mapping, name, value)
            config = cls.from_mapping(mapping)
        return config

    def to_mapping(self) -> dict[str, Any]:
        """Return the settings in YAML's types, the inverse of :meth:`from_mapping`."""
        found: dict[str, Any] = plain(dataclasses.asdict(self), "config")
        return found

    def corpus_of(self, number: int) -> Corpus:
        """Return the corpus of an improvement."""
        changes = self.improvements[number].corpus
        with naming(f"improvements[{number}].corpus"):
            corpus = replace(self.corpus, **changes) if changes else self.corpus
        return corpus

    def of_round(self, number: int) -> range:
        """Return the numbers of a round's excerpts, counted over all rounds."""
        first = sum(one.excerpts for one in self.rounds[:number])
        return range(first, first + self.rounds[number].excerpts)


def _absolute(path: str) -> str:
    return str(Path(path).absolute())


def _with_absolute_paths(corpus: Corpus) -> Corpus:
    sources = {
        source if source in SOURCES else _absolute(source): weight
        for source, weight in corpus.sources.items()
    }
    held_out = tuple(
        _absolute(name) if Path(name).name != name else name for name in corpus.held_out
    )
    if (sources, held_out) == (corpus.sources, corpus.held_out):
        return corpus  # a new one would read all folders again
    return replace(corpus, sources=sources, held_out=held_out)


def _change(mapping: dict[str, Any], name: str, value: Any) -> None:
    """Set a value in nested mappings and lists by a dotted name."""
    place: Any = mapping
    *path, last = name.split(".")
    for part in path:
        if isinstance(place, dict):
            place = place.setdefault(part, {})
        else:
            place = place[_index(place, part, name)]
    place[last if isinstance(place, dict) else _index(place, last, name)] = value


def _index(place: Any, part: str, name: str) -> int:
    if not (isinstance(place, list) and part.isdigit() and int(part) < len(place)):
        raise ConfigError(f"Unknown setting {name!r}: there is no {part!r} to be set.")
    return int(part)
