"""Bases of all wrappers that change the score."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import gymnasium as gym
import numpy as np

from sb3_piano.envs.score_choice import ScoreTransform
from sb3_piano.layers import layers
from sb3_piano.music import Score
from sb3_piano.settings import Share, checked
from sb3_piano.wrappers.piano import unwrap_piano


@dataclass(frozen=True)
class ScorePlan:
    """Changes of all wrappers around an environment to the score of an episode."""

    choose: Callable[[np.random.Generator], Score] | None = None
    """Source of a score in place of the environment's own, or ``None``."""
    changes: tuple[ScoreTransform, ...] = ()
    """Changes to that score, in order."""

    @classmethod
    def of(cls, transform: ScoreTransform | None) -> ScorePlan:
        """Return the plan of the option ``transform`` of ``reset``."""
        if transform is None:
            return cls()
        return transform if isinstance(transform, cls) else cls(changes=(transform,))

    def __call__(self, score: Score, random: np.random.Generator) -> Score:
        """Apply the plan, as a :data:`~sb3_piano.envs.ScoreTransform` does."""
        if self.choose is not None:
            score = self.choose(random)
        for change in self.changes:
            score = change(score, random)
        return score


@dataclass(frozen=True, kw_only=True)
class FixedScore(ScorePlan):
    """Plan that plays a given score and ignores the wrappers' changes."""

    score: Score
    """Score to play."""

    def __call__(self, score: Score, random: np.random.Generator) -> Score:
        """Return the given score."""
        del score, random  # neither chosen nor changed
        return self.score


class ScoreWrapper(gym.Wrapper[Any, Any, Any, Any]):
    """Change the score of each episode.

    The change goes through ``reset`` as the option ``transform``. The environment applies it with
    its own random generator, once it is seeded: equal seeds give equal pieces. Of several such
    wrappers the outermost acts first. A score given in ``reset(options={"score": ...})`` is
    changed, too.
    """

    chooses_piece: bool = False
    """Whether this wrapper replaces the environment's own piece."""
    cuts: bool = False
    """Whether this wrapper drops notes by their times."""
    draws_times: bool = False
    """Whether the times of the changed score may differ between episodes."""

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        unwrap_piano(env, type(self).__name__)

    @property
    def sources(self) -> Sequence[Score] | None:
        """Scores in place of the environment's own; ``None`` if this wrapper keeps it."""
        return None

    def change(self, score: Score, random: np.random.Generator) -> Score:
        """Return the changed score; by default the score itself.

        Raises:
            ScoreError: If the score does not allow the change.
        """
        del random  # nothing is drawn
        return score

    def extremes(self, score: Score) -> Sequence[Score]:
        """Return scores with the lowest and the highest pitch that :meth:`change` can return.

        Whatever lies between the lowest and the highest pitch of ``score`` must be changed into
        something that lies between those of the result, so that they hold for parts of it too.

        Raises:
            ScoreError: If the score does not allow the change.
        """
        return [score]

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode of the changed score."""
        options = dict(options or {})
        options["transform"] = self.extend(ScorePlan.of(options.get("transform")), options)
        return self.env.reset(seed=seed, options=options)

    def extend(self, plan: ScorePlan, options: Mapping[str, Any]) -> ScorePlan:
        """Add this wrapper's change to the plan of the outer wrappers."""
        del options  # the change is the same for every score
        return replace(plan, changes=(*plan.changes, self.change))


def possible_scores(env: gym.Env[Any, Any]) -> list[Score]:
    """Return scores with the lowest and the highest possible pitch of an environment.

    Scores that are given to ``reset`` are not among them, nor what wrappers further out would
    change. Of a piece from which a drawn part is played, or a part after a drawn change of times,
    all notes count.

    Raises:
        ScoreError: If a wrapper cannot change what it gets.
    """
    wrappers = [layer for layer in layers(env) if isinstance(layer, ScoreWrapper)]
    scores, times_known = [unwrap_piano(env, "possible_scores").default_score], True
    for wrapper in wrappers:
        sources = wrapper.sources
        if sources is not None:
            scores, times_known = list(sources), not wrapper.draws_times
            break
    # A drawn stretch has a fastest and a slowest form to look at; a drawn part may begin anywhere.
    bounded = times_known
    for wrapper in wrappers:  # the outermost acts first
        if bounded or not wrapper.cuts:  # raises if a part may be silent
            changed = [extreme for score in scores for extreme in wrapper.extremes(score)]
            scores = changed if times_known or not wrapper.cuts else scores
        times_known = times_known and not wrapper.draws_times
        bounded = bounded and not (wrapper.draws_times and wrapper.cuts)
    return scores


_REMEMBERED = 16


class ScoreChange(ScoreWrapper, ABC):
    """Base of wrappers that change each score by a value, fixed or drawn.

    With a ``probability`` below 1 the other episodes play the score as it is.

    The last 16 changed scores are cached and returned as the same objects, so that the environment
    keeps its prepared goal.
    """

    def __init__(self, env: gym.Env[Any, Any], probability: float = 1.0) -> None:
        super().__init__(env)
        self._probability: float = checked("probability", probability, Share)
        self._recent: deque[tuple[Score, Any, Score]] = deque(maxlen=_REMEMBERED)

    @abstractmethod
    def draw(self, score: Score, random: np.random.Generator) -> Any:
        """Return the value of this episode's change."""

    @abstractmethod
    def extreme_values(self, score: Score) -> Sequence[Any]:
        """Return the values of the change for :meth:`extremes`."""

    @abstractmethod
    def changed(self, score: Score, value: Any) -> Score:
        """Return a score changed by a value.

        Raises:
            ScoreError: If the score does not allow it.
        """

    def change(self, score: Score, random: np.random.Generator) -> Score:
        """Return a score changed by the drawn value, or the score itself."""
        # Nothing is drawn for a certain change: seeds give the pieces that they gave without it.
        if self._probability < 1 and random.random() >= self._probability:
            return score
        return self._remembered(score, self.draw(score, random))

    def extremes(self, score: Score) -> list[Score]:
        """Return a score changed by the extreme values, and itself if it may stay unchanged."""
        unchanged = [score] if self._probability < 1 else []
        if self._probability == 0:
            return unchanged
        changed = [self._remembered(score, value) for value in self.extreme_values(score)]
        return unchanged + changed

    def _remembered(self, score: Score, value: Any) -> Score:
        # The score itself is compared, not its id(), which does not outlive copying and pickling.
        for before, by, after in self._recent:
            if before is score and by == value:
                return after
        result = self.changed(score, value)
        self._recent.append((score, value, result))
        return result
