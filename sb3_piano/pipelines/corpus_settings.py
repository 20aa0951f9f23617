"""Settings of a corpus: what is played, by whom, how disturbed, how often."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, MinLen
from pydantic import BeforeValidator

from sb3_piano.demonstrations.disturbances import DEFAULT_MEMORY
from sb3_piano.exceptions import ConfigError
from sb3_piano.music import Score, load_score, select_pieces
from sb3_piano.players import PlayerSpec
from sb3_piano.settings import Count, Index, Listed, NotNegative, Number, Positive, Unit, settings
from sb3_piano.training.configuration.values import plain

DEFAULT_NOISE = (0.0, 0.03, 0.06, 0.1)
"""Standard deviations, rad, with which learners see how a planned pianist recovers."""


def _pieces(value: Any) -> tuple[str, ...]:
    found = select_pieces(value)
    for piece in found:
        if isinstance(piece, Score):
            raise ConfigError(
                f"pieces has {piece.title!r} as a score: expected its name or file, which other "
                "processes find, too."
            )
    return tuple(map(str, found))


@settings
class CorpusConfig:
    """All settings of a corpus of performances.

    Each excerpt is played by each player, each time in ``episodes`` performances with noise in
    turns. Performances are numbered in this order; each is a function of the settings and of its
    number alone.

    Raises:
        ConfigError: If a setting is unknown, has the wrong type or is out of range.
    """

    pieces: Annotated[tuple[str, ...], BeforeValidator(_pieces)]
    """Entries of :func:`~sb3_piano.music.select_pieces`."""
    players: Annotated[tuple[str, ...], MinLen(1), Listed] = ("planned",)
    """Specs of players, see :class:`~sb3_piano.players.PlayerSpec`."""
    excerpts: Count | None = None
    """How many excerpts are drawn, from the pieces in turns; by default one of each piece."""
    seconds: Positive | None = None
    """Length of an excerpt, s, from a note drawn at random; by default pieces are played whole."""
    episodes: Count = 4
    """Performances of each excerpt by each player."""
    noise: Annotated[tuple[Annotated[Number, Ge(0), Unit("rad")], ...], MinLen(1), Listed] = (
        DEFAULT_NOISE
    )
    """Standard deviations of the noise on the actions, rad; an excerpt's performances take
    turns."""
    noise_memory: Annotated[NotNegative, Unit("s")] = DEFAULT_MEMORY
    """Time in which the noise's correlation falls to 1/e, s."""
    start: Annotated[NotNegative, Unit("rad")] = 0.0
    """Standard deviation of the joints at the start, rad."""
    by_hand: bool = False
    """Whether what is observed and played is by hand (observation "hands" and
    :class:`~sb3_piano.wrappers.HandActions`), from which ``distill`` learns."""
    env_kwargs: Mapping[str, Any] = field(default_factory=dict)
    """Options of the environment, but for the score; runs have their own."""
    shard: Count = 25
    """Performances of a data set, which one process plays."""
    seed: Index = 0
    """Seed of the excerpts, the noise and the starts."""

    def __post_init__(self) -> None:
        for player in self.players:
            PlayerSpec.parse(player)

    def __len__(self) -> int:
        """Return the number of performances."""
        return self.n_excerpts * len(self.players) * self.episodes

    @property
    def n_excerpts(self) -> int:
        """Number of excerpts."""
        return len(self.pieces) if self.excerpts is None else self.excerpts

    def to_mapping(self) -> dict[str, Any]:
        """Return the settings in YAML's types, with which the class can be called again."""
        found: dict[str, Any] = plain(dataclasses.asdict(self), "corpus")
        return found

    def performance(self, number: int) -> Performed:
        """Return what is played in the performance of a number.

        Raises:
            ScoreError: If the piece cannot be read.
        """
        rest, turn = divmod(number, self.episodes)
        excerpt, player = divmod(rest, len(self.players))
        return Performed(
            score=self._excerpt(excerpt),
            piece=self.pieces[excerpt % len(self.pieces)],
            player=self.players[player],
            noise=self.noise[turn % len(self.noise)],
            seed=int(np.random.SeedSequence((self.seed, number)).generate_state(1)[0]),
        )

    def _excerpt(self, number: int) -> Score:
        score = load_score(self.pieces[number % len(self.pieces)])
        if self.seconds is None:
            return score
        random = np.random.default_rng((self.seed, number, 0))
        last = max(score.duration - self.seconds, score.notes[0].onset)
        start = float(random.choice(sorted({n.onset for n in score.notes if n.onset <= last})))
        part = score.excerpt(start, start + self.seconds)
        return dataclasses.replace(part, title=f"{score.title} from {start:.2f} s")


@dataclass(frozen=True, kw_only=True)
class Performed:
    """A performance that is to be played."""

    score: Score
    """What is played."""
    piece: str
    """Name or file of the piece."""
    player: str
    """The player, as the settings have it."""
    noise: float
    """Standard deviation of the noise, rad."""
    seed: int
    """Seed of the environment, the player and the noise."""
