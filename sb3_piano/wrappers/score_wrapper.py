"""The base of all wrappers that change what is played."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from typing import Any

import gymnasium as gym
import numpy as np

from sb3_piano.envs import ScoreTransform
from sb3_piano.music import Score
from sb3_piano.wrappers.piano import piano_of


class ScoreWrapper(gym.Wrapper[Any, Any, Any, Any], ABC):
    """Change the score of each episode.

    The change is handed down through ``reset`` as the option ``transform``, and made by the
    environment itself with its own random generator, once it is seeded: equal seeds give equal
    pieces. Of several such wrappers the outermost acts first. A score given in
    ``reset(options={"score": ...})`` is changed like the environment's own.
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        piano_of(env, type(self).__name__)

    @abstractmethod
    def change(self, score: Score, random: np.random.Generator) -> Score:
        """Return what is played in place of a score.

        Args:
            score: What would be played without this wrapper.
            random: Where everything random comes from.

        Raises:
            ScoreError: If the score does not allow the change.
        """

    @abstractmethod
    def extremes(self, score: Score) -> Sequence[Score]:
        """Return scores which have, together, all pitches that :meth:`change` may make of one.

        Raises:
            ScoreError: If the score does not allow the change.
        """

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode of the changed score."""
        options = dict(options or {})
        options["transform"] = self._joined(options.get("transform"))
        return self.env.reset(seed=seed, options=options)

    def _joined(self, outer: ScoreTransform | None) -> ScoreTransform:
        """Return the changes of the wrappers further out, followed by this one."""
        if outer is None:
            return self.change

        def both(score: Score, random: np.random.Generator) -> Score:
            return self.change(outer(score, random), random)

        return both


def possible_scores(env: gym.Env[Any, Any]) -> list[Score]:
    """Return scores which have, together, all pitches that an environment may ask for by itself.

    Args:
        env: A piano environment, wrapped or not; what wrappers around it would change is unknown.

    Raises:
        ScoreError: If a wrapper cannot change what it gets.
    """
    scores = [piano_of(env, "possible_scores").default_score]
    for layer in _score_wrappers(env):
        scores = [extreme for score in scores for extreme in layer.extremes(score)]
    return scores


def _score_wrappers(env: gym.Env[Any, Any]) -> Iterator[ScoreWrapper]:
    """Yield those around an environment, the outermost first, in which order they act."""
    while isinstance(env, gym.Wrapper):
        if isinstance(env, ScoreWrapper):
            yield env
        env = env.env
