"""Ends of episodes that come from wrappers around the environment."""

from __future__ import annotations

import sys
import weakref
from collections.abc import Iterable
from typing import Any

import gymnasium as gym

from sb3_piano.envs.record import EpisodeRecord

LimitRef = weakref.ref[Any]


def time_limits(env: gym.Env[Any, Any]) -> tuple[LimitRef, ...]:
    """Return the ``TimeLimit`` wrappers whose ``reset`` is being called around an environment's.

    An environment holds no reference to its wrappers. Its ``reset`` is reached through theirs, so
    that they are among its callers. RL Zoo puts a class of its own in gymnasium's place, so that
    they are known by what they count. References are weak, as each wrapper holds the environment.
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
    """Return whether one of the time limits ends the episode with the step that is being played."""
    wrappers = (limit() for limit in limits)
    return any(
        wrapper is not None
        and (getattr(wrapper, "_elapsed_steps", 0) or 0) + 1 >= wrapper._max_episode_steps
        for wrapper in wrappers
    )


class StepInfo(dict[str, Any]):
    """The ``info`` of a step that the environment goes on from, if no wrapper ends the episode.

    It holds what it was made of and nothing else. ``info["f1"]`` and the other names of the final
    ``info`` give the metrics up to this step, for a ``Monitor`` around a wrapper that ends the
    episode. A copy is a plain ``dict``; it has them if Stable-Baselines3 has marked the end.
    """

    def __init__(self, content: dict[str, Any], record: EpisodeRecord) -> None:
        super().__init__(content)
        self._record = record
        self._step = record.steps

    def __missing__(self, name: str) -> Any:
        return self.summary()[name]

    def summary(self) -> dict[str, float]:
        """Return the metrics up to this step; none once the record is of later steps."""
        return self._record.summary() if self._record.steps == self._step else {}

    def __reduce__(self) -> tuple[Any, ...]:
        metrics = self.summary() if "terminal_observation" in self else {}
        return dict, ({**metrics, **self},)


def final_info(info: dict[str, Any]) -> dict[str, Any]:
    """Return the ``info`` with which a wrapper ended an episode, with the metrics."""
    return {**info.summary(), **info} if isinstance(info, StepInfo) else info
