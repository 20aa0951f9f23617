"""Context of a run for its callbacks, so that they need no settings for it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TypeAlias, runtime_checkable

import gymnasium as gym
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

EnvWrapper: TypeAlias = Callable[[gym.Env[Any, Any]], gym.Env[Any, Any]]
"""Puts a wrapper around a bare environment."""


@dataclass(frozen=True, kw_only=True)
class RunContext:
    """Folder of a run's files, and a maker of environments like its own."""

    folder: Path
    """The run's folder."""
    make_env: Callable[[EnvWrapper | None], VecEnv]
    """Returns one new environment of the run, with all its wrappers, as a vector; the argument is
    put around the bare environment inside."""


@runtime_checkable
class UsesRun(Protocol):
    """A callback that wants to know its run before the training starts."""

    def use_run(self, run: RunContext) -> None:
        """Take from the run what was not set otherwise."""


def hand_over(run: RunContext, callbacks: Iterable[BaseCallback]) -> None:
    """Tell all callbacks that ask for it which run they serve, however deep they are nested.

    Callbacks are looked for in ``CallbackList`` and in the events of ``EventCallback`` and
    ``EvalCallback``.
    """
    for callback in callbacks:
        if isinstance(callback, UsesRun):
            callback.use_run(run)
        hand_over(run, _children(callback))


def _children(callback: BaseCallback) -> list[BaseCallback]:
    children = list(getattr(callback, "callbacks", ()))
    children += [getattr(callback, name, None) for name in ("callback", "callback_on_new_best")]
    return [child for child in children if isinstance(child, BaseCallback)]
