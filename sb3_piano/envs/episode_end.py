"""Episode ends that wrappers around the environment decide."""

from __future__ import annotations

import sys
import weakref
from collections.abc import Iterable
from typing import Any

import gymnasium as gym

from sb3_piano.envs.record import EpisodeRecord

LimitRef = weakref.ref[Any]


def time_limits(env: gym.Env[Any, Any]) -> tuple[LimitRef, ...]:
    """Find the ``TimeLimit`` wrappers around an environment, from within its ``reset``.

    An environment has no reference to its wrappers, but their ``reset`` calls its own, so they are
    in the call stack. RL Zoo has its own time limit class, so wrappers are recognised by the
    attribute that they count with. References are weak, as each wrapper holds the environment.
    """
    found, frame = [], sys._getframe(1)
    while (frame := frame.f_back) is not None:  # type: ignore[assignment]
        code = frame.f_code
        if code.co_argcount and code.co_varnames[0] == "self":
            caller = frame.f_locals.get("self")
            limit = getattr(caller, "_max_episode_steps", None)
            if isinstance(caller, gym.Wrapper) and limit is not None and caller.unwrapped is env:
                found.append(weakref.ref(caller))
    return tuple(dict.fromkeys(found))


def ends_by_limit(limits: Iterable[LimitRef]) -> bool:
    """Check whether a time limit ends the episode with the present step."""
    found = [wrapper for limit in limits if (wrapper := limit()) is not None]
    played = [(getattr(wrapper, "_elapsed_steps", 0) or 0) + 1 for wrapper in found]
    return any(n >= wrapper._max_episode_steps for n, wrapper in zip(played, found, strict=True))


class StepInfo(dict[str, Any]):
    """``info`` of a step that does not end the episode; it computes metrics on access.

    It has only its given items. ``info["f1"]`` and the other names of the final ``info`` compute
    the metrics up to this step, for a ``Monitor`` around a wrapper that ends the episode. A copy is
    a plain ``dict``; it has the metrics if Stable-Baselines3 has marked the end.
    """

    def __init__(self, content: dict[str, Any], record: EpisodeRecord) -> None:
        super().__init__(content)
        self._record = record
        self._step = record.steps

    def __missing__(self, name: str) -> Any:
        return self.summary()[name]

    def summary(self) -> dict[str, float]:
        """Compute the metrics up to this step; empty once the record has later steps."""
        return self._record.summary() if self._record.steps == self._step else {}

    def __reduce__(self) -> tuple[Any, ...]:
        metrics = self.summary() if "terminal_observation" in self else {}
        return dict, ({**metrics, **self},)


def final_info(info: dict[str, Any]) -> dict[str, Any]:
    """Add the metrics to the ``info`` with which a wrapper ended an episode."""
    return {**info.summary(), **info} if isinstance(info, StepInfo) else info
