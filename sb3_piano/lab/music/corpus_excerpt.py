"""Wrapper that draws an excerpt of a corpus for each episode."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np

from sb3_piano.exceptions import ScoreError
from sb3_piano.lab.music.corpus import Corpus
from sb3_piano.music import MAX_PITCH, MIN_PITCH, Note, Score
from sb3_piano.settings import Count, checked
from sb3_piano.wrappers.piano import unwrap_piano
from sb3_piano.wrappers.score_wrapper import ScorePlan, ScoreWrapper

_MOST_DRAWS = 100


class CorpusExcerpt(ScoreWrapper, gym.utils.RecordConstructorArgs):
    """Play a random excerpt of a corpus in each episode, with fingers for the simulated hands.

    All excerpts are equally likely; equal seeds draw equal excerpts. The excerpt replaces the
    environment's own piece, as in :class:`~sb3_piano.wrappers.RandomPiece`. An environment with
    ``fingering="robot"`` computes fingers again: "keep" is faster.

    Args:
        env: A piano environment, wrapped or not.
        corpus: The corpus, or a mapping of settings that replace the defaults.
        episodes: Number of consecutive episodes with one excerpt. A new excerpt costs as much time
            as some 200 control steps on the fast physics.

    Raises:
        ConfigError: If a setting is wrong, or ``env`` is no piano.
    """

    chooses_piece = True
    draws_times = True  # the times of the placeholder score have no meaning

    def __init__(
        self, env: gym.Env[Any, Any], corpus: Corpus | Mapping[str, Any], episodes: int = 1
    ) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, corpus=corpus, episodes=episodes)
        super().__init__(env)
        self._piano = unwrap_piano(env, "CorpusExcerpt")
        self._episodes = checked("episodes", episodes, Count)
        self._chosen: Score | None = None
        self._left = 0
        if not isinstance(corpus, Corpus):
            corpus = Corpus(**checked("corpus", corpus, Mapping))
        self._corpus = corpus

    @property
    def sources(self) -> list[Score]:
        """A placeholder score from the lowest to the highest key, for excerpts anywhere."""
        ends = [Note(onset=0.0, offset=1.0, pitch=pitch) for pitch in (MIN_PITCH, MAX_PITCH)]
        return [Score(notes=ends, title="corpus")]

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode; a seed draws a new excerpt."""
        if seed is not None:
            self._chosen = None
        return super().reset(seed=seed, options=options)

    def choose(self, random: np.random.Generator) -> Score:
        """Draw the excerpt of an episode."""
        if self._chosen is None or not self._left:
            self._chosen, self._left = self._excerpt(random), self._episodes
        self._left -= 1
        return self._chosen

    def _excerpt(self, random: np.random.Generator) -> Score:
        """Draw an excerpt with notes for the hands in the scene."""
        draws_left = _MOST_DRAWS
        while True:
            score = self._corpus.fingered(int(random.integers(len(self._corpus))))
            draws_left -= 1
            try:
                return self._piano.own_part(score)
            except ScoreError:
                if not draws_left:
                    raise

    def extend(self, plan: ScorePlan, options: Mapping[str, Any]) -> ScorePlan:
        """Return the plan with this excerpt, unless an outer wrapper chose the piece."""
        if "score" in options or plan.choose is not None:
            return plan
        return replace(plan, choose=self.choose)
