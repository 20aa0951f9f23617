"""Bases of all wrappers that change what is played."""

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
from sb3_piano.wrappers.piano import piano_of


@dataclass(frozen=True)
class ScorePlan:
    """Changes that all wrappers around an environment make to the score of an episode."""

    choose: Callable[[np.random.Generator], Score] | None = None
    """Source of a score in place of the environment's own, if there is one."""
    changes: tuple[ScoreTransform, ...] = ()
    """Changes that are then made, one after the other."""

    @classmethod
    def of(cls, transform: ScoreTransform | None) -> ScorePlan:
        """Return what the option ``transform`` stands for, whoever gave it."""
        if transform is None:
            return cls()
        return transform if isinstance(transform, cls) else cls(changes=(transform,))

    def __call__(self, score: Score, random: np.random.Generator) -> Score:
        """Return what is played, as a :data:`~sb3_piano.envs.ScoreTransform` does."""
        if self.choose is not None:
            score = self.choose(random)
        for change in self.changes:
            score = change(score, random)
        return score


@dataclass(frozen=True, kw_only=True)
class FixedScore(ScorePlan):
    """Plan of an episode that plays a given score, whatever wrappers add to the plan."""

    score: Score
    """What is played."""

    def __call__(self, score: Score, random: np.random.Generator) -> Score:
        """Return the given score."""
        del score, random  # neither chosen nor changed
        return self.score


class ScoreWrapper(gym.Wrapper[Any, Any, Any, Any]):
    """Change the score of each episode.

    The change is handed down through ``reset`` as the option ``transform``, and made by the
    environment itself with its own random generator, once it is seeded: equal seeds give equal
    pieces. Of several such wrappers the outermost acts first. A score given in
    ``reset(options={"score": ...})`` is changed like the environment's own.
    """

    chooses_piece: bool = False
    """Whether this wrapper chooses what is played in place of the environment's own piece."""
    cuts: bool = False
    """Whether this wrapper leaves out notes by their times."""
    draws_times: bool = False
    """Whether the times of the changed score differ between episodes, or may."""

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        piano_of(env, type(self).__name__)

    @property
    def sources(self) -> Sequence[Score] | None:
        """Scores in place of the environment's own; ``None`` if this wrapper keeps that."""
        return None

    def change(self, score: Score, random: np.random.Generator) -> Score:
        """Return what is played in place of a score; by default the score as it is.

        Raises:
            ScoreError: If the score does not allow the change.
        """
        del random  # nothing is drawn
        return score

    def extremes(self, score: Score) -> Sequence[Score]:
        """Return scores with the lowest and the highest pitch that :meth:`change` may lead to.

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
        """Return the plan of the wrappers further out, with this one's part added to it."""
        del options  # the change is the same for every score
        return replace(plan, changes=(*plan.changes, self.change))


def possible_scores(env: gym.Env[Any, Any]) -> list[Score]:
    """Return scores with the lowest and the highest pitch that an environment may ask for.

    Scores that are given to ``reset`` are not among them, nor what wrappers further out would
    change. Of a piece from which a drawn part is played, or a part after a drawn change of times,
    all notes count.

    Raises:
        ScoreError: If a wrapper cannot change what it gets.
    """
    wrappers = [layer for layer in layers(env) if isinstance(layer, ScoreWrapper)]
    scores, times_known = [piano_of(env, "possible_scores").default_score], True
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
    """Change each score by a value, which may be another one in each episode.

    With a ``probability`` below 1 the other episodes play the score as it is.

    The same change of the same score gives the same object for as long as it is among the last 16.
    The environment then keeps the goal that it has prepared of it.
    """

    def __init__(self, env: gym.Env[Any, Any], probability: float = 1.0) -> None:
        super().__init__(env)
        self._probability: float = checked("probability", probability, Share)
        self._recent: deque[tuple[Score, Any, Score]] = deque(maxlen=_REMEMBERED)

    @abstractmethod
    def draw(self, score: Score, random: np.random.Generator) -> Any:
        """Return by what a score is changed in this episode."""

    @abstractmethod
    def extreme_values(self, score: Score) -> Sequence[Any]:
        """Return by what a score must be changed for :meth:`extremes`."""

    @abstractmethod
    def changed(self, score: Score, value: Any) -> Score:
        """Return a score changed by a value.

        Raises:
            ScoreError: If the score does not allow it.
        """

    def change(self, score: Score, random: np.random.Generator) -> Score:
        """Return a score changed by the value that is drawn, or the score as it is."""
        # Nothing is drawn for a certain change: seeds give the pieces that they gave without it.
        if self._probability < 1 and random.random() >= self._probability:
            return score
        return self._remembered(score, self.draw(score, random))

    def extremes(self, score: Score) -> list[Score]:
        """Return a score changed by the extreme values, and as it is where it may stay so."""
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
