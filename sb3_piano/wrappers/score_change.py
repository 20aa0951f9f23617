"""What the wrappers share that change a score by a value, fixed or drawn."""

from __future__ import annotations

from abc import abstractmethod
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import gymnasium as gym
import numpy as np

from sb3_piano.exceptions import ConfigError
from sb3_piano.music import Score
from sb3_piano.settings import checked
from sb3_piano.wrappers.score_wrapper import ScoreWrapper

Number = TypeVar("Number", int, float)

_REMEMBERED = 16


class ScoreChange(ScoreWrapper):
    """Change each score by a value, which may be another one in each episode.

    The same change of the same score gives the same object for as long as it is among the last 16.
    The environment then keeps the goal that it has prepared of it.
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
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
        """Return a score changed by the value that is drawn."""
        return self._remembered(score, self.draw(score, random))

    def extremes(self, score: Score) -> list[Score]:
        """Return a score changed by the extreme values."""
        return [self._remembered(score, value) for value in self.extreme_values(score)]

    def _remembered(self, score: Score, value: Any) -> Score:
        # The score itself is compared, not its id(), which does not outlive copying and pickling.
        for before, by, after in self._recent:
            if before is score and by == value:
                return after
        result = self.changed(score, value)
        self._recent.append((score, value, result))
        return result


@dataclass(frozen=True)
class FixedOrRange(Generic[Number]):
    """A number, or the range from which it is drawn."""

    low: Number
    high: Number
    fixed: bool
    """Whether a single number was given."""

    @classmethod
    def of(cls, name: str, value: Any, kind: Any) -> FixedOrRange[Number]:
        """Return what an argument says.

        Args:
            name: Name of the argument.
            value: A number, or a pair of the lowest and the highest, both included.
            kind: Annotation of a number.

        Raises:
            ConfigError: If it is neither.
        """
        if isinstance(value, str) or not isinstance(value, Sequence):
            only = checked(name, value, kind)
            return cls(low=only, high=only, fixed=True)
        if len(value) != 2:
            raise ConfigError(
                f"{name} is {value!r}: expected one number, or a pair of the lowest and the "
                "highest."
            )
        low, high = (checked(f"{name}[{i}]", value[i], kind) for i in (0, 1))
        if low > high:
            raise ConfigError(f"{name} is {value!r}: expected the lower end first.")
        return cls(low=low, high=high, fixed=False)
