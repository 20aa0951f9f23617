"""Iterate over the wrappers of an environment."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import gymnasium as gym

Env = gym.Env[Any, Any]


def layers(env: Env) -> Iterator[Env]:
    """Yield an environment's wrappers, the outermost first, then the bare environment."""
    while isinstance(env, gym.Wrapper):
        yield env
        env = env.env
    yield env
