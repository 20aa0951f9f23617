"""Wrapper that draws a piece for each episode."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from sb3_piano.envs.score_choice import own_score
from sb3_piano.exceptions import ConfigError
from sb3_piano.music import Score, find_piece, select_pieces
from sb3_piano.music.catalogue import ScoreSource, is_path
from sb3_piano.music.difficulty import Features, features
from sb3_piano.music.library.store import piece_features
from sb3_piano.music.selection import unique_titles
from sb3_piano.settings import Number, checked
from sb3_piano.wrappers.piano import unwrap_piano
from sb3_piano.wrappers.score_wrapper import ScorePlan, ScoreWrapper, possible_scores

_FEW = 100
"""Largest number of pieces that are read at once, and kept in memory."""


class RandomPiece(ScoreWrapper, gym.utils.RecordConstructorArgs):
    """Choose one of several pieces for each episode.

    The choice replaces the environment's own piece before any other wrapper changes it, in any
    order of the wrappers: ``PitchShift(RandomPiece(env, pieces), 3)`` and
    ``RandomPiece(PitchShift(env, 3), pieces)`` both shift the chosen piece. Of several
    ``RandomPiece`` the outermost chooses. The environment's options for a generated study, such as
    ``tempo``, hold for all generated studies. A score given in ``reset(options={"score": ...})``
    replaces the choice.

    Up to 100 pieces are read at once, so that errors show early. Of more, each is read when first
    chosen.

    A curriculum uses :attr:`piece_names`, :attr:`piece_index` and :meth:`set_piece_weights`,
    through ``get_attr`` and ``env_method`` of a vector of environments. A piece of weight 0 never
    takes part, and outer wrappers ignore it. An evaluation can play each piece once by
    :meth:`play_in_turn`.

    Args:
        env: A piano environment, wrapped or not.
        pieces: One or more entries of :func:`~sb3_piano.music.select_pieces`: scores, paths of
            files, names of pieces, patterns such as ``"scale-*"``, collections, lists.
        weights: Relative probability of each piece, 0 or more, not all 0; by default all are
            equally likely.

    Raises:
        ConfigError: If ``pieces`` or ``weights`` is no such list, or ``env`` is no piano.
        ScoreError: If a piece cannot be read, wrappers inside cannot change it, or the hands that
            are there have nothing to play in it. If there are many: by ``reset``.
        UnknownPieceError: If there is no piece of some name.
    """

    chooses_piece = True

    def __init__(
        self,
        env: gym.Env[Any, Any],
        pieces: Sequence[ScoreSource] | str,
        weights: Sequence[float] | None = None,
    ) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, pieces=pieces, weights=weights)
        super().__init__(env)
        self._piano = unwrap_piano(env, "RandomPiece")
        self._pieces = select_pieces(pieces)
        self._probabilities = _probabilities(weights, len(self._pieces))
        self._possible = np.flatnonzero(self._probabilities)
        self._played: int | None = None
        self._turn: int | None = None
        self._scores: dict[int, Score] = {}
        if len(self._pieces) <= _FEW:
            for index in range(len(self._pieces)):
                self._score(index)
            possible_scores(self)  # raises if a wrapper inside cannot change a piece

    @property
    def sources(self) -> list[Score]:
        """Pieces to choose from."""
        return [self._score(int(index)) for index in self._possible]

    @property
    def piece_names(self) -> list[str]:
        """Pieces to choose from as text: names, absolute paths and titles of scores.

        Each is another text: of several scores of one title the second is "title (2)".
        """
        possible = (self._pieces[index] for index in self._possible)
        return unique_titles(
            piece.title if isinstance(piece, Score) else os.fspath(piece) for piece in possible
        )

    @property
    def piece_index(self) -> int | None:
        """Index of the present episode's piece; ``None`` if the piece was set from outside."""
        return self._played

    def set_piece_weights(self, weights: Sequence[float]) -> None:
        """Set the probability of each piece from the next episode on.

        Args:
            weights: One for each of :attr:`piece_names`, as of the constructor.

        Raises:
            ConfigError: If they are no such numbers.
        """
        self._probabilities[self._possible] = _probabilities(weights, len(self._possible))

    def play_in_turn(self) -> None:
        """Play :attr:`piece_names` one after the other; a seed restarts with the first."""
        self._turn = 0

    def piece_features(self, index: int) -> Features:
        """Return the difficulty features of one of :attr:`piece_names`, for the played notes.

        Raises:
            ScoreError: If the piece cannot be read.
        """
        own = int(self._possible[index])
        source, config = self._pieces[own], self._piano.config
        is_whole = (
            config.hands == "both" and len(config.sides) != 1 and not self._piano.piece_options
        )
        if is_whole and isinstance(source, str) and not is_path(source):
            return piece_features(find_piece(source))  # which were noted when it was imported
        return features(self._score(own))

    def choose(self, random: np.random.Generator) -> Score:
        """Draw the piece of an episode."""
        if self._turn is None:
            chosen = int(random.choice(len(self._pieces), p=self._probabilities))
        else:
            chosen = int(self._possible[self._turn % len(self._possible)])
            self._turn += 1
        self._played = int(np.searchsorted(self._possible, chosen))
        return self._score(chosen)

    def _score(self, index: int) -> Score:
        """Return a piece from the cache, or read it."""
        if index not in self._scores:
            piece, _ = own_score(self._pieces[index], self._piano.piece_options)
            score = self._piano.own_part(piece)
            while len(self._scores) >= _FEW:
                del self._scores[next(iter(self._scores))]
            self._scores[index] = score
        return self._scores[index]

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode of a drawn piece."""
        if self._turn is not None and seed is not None:
            self._turn = 0
        return super().reset(seed=seed, options=options)

    def extend(self, plan: ScorePlan, options: Mapping[str, Any]) -> ScorePlan:
        """Add this choice to the plan, unless an outer wrapper fixed the piece."""
        self._played = None  # until the environment has its seed, and chooses
        if "score" in options or plan.choose is not None:
            return plan
        return replace(plan, choose=self.choose)


def _probabilities(weights: Any, count: int) -> npt.NDArray[np.float64]:
    if weights is None:
        return np.full(count, 1 / count)
    if isinstance(weights, str) or not isinstance(weights, Sequence) or len(weights) != count:
        raise ConfigError(
            f"weights is {weights!r}: expected a list of {count}, one for each piece."
        )
    numbers = np.array([checked(f"weights[{i}]", w, Number) for i, w in enumerate(weights)])
    if numbers.min() < 0 or numbers.max() == 0:
        raise ConfigError(f"weights is {weights!r}: expected numbers from 0 on, not all of them 0.")
    numbers /= numbers.max()  # first, so that the sum of huge ones is finite
    return numbers / numbers.sum()
