"""Base of observation wrappers, and access to the piano inside a chain of wrappers."""

from __future__ import annotations

from typing import Any

import gymnasium as gym

from sb3_piano.envs import ObservationSpace, PianoEnv
from sb3_piano.envs.observation import ObservationLayout
from sb3_piano.exceptions import ConfigError


class LayoutWrapper(gym.ObservationWrapper[Any, Any, Any]):
    """Base of wrappers whose observation has another layout.

    The new observation space has the layout, so that wrappers further out, feature extractors and
    replay buffers find the blocks by name; ``env.unwrapped.observation_layout`` remains that of
    the environment itself.
    """

    def __init__(self, env: gym.Env[Any, Any], layout: ObservationLayout) -> None:
        super().__init__(env)
        self.observation_layout = layout
        """Name, place and meaning of each block."""
        self.observation_space = ObservationSpace(layout)


def unwrap_piano(env: gym.Env[Any, Any], caller: str) -> PianoEnv:
    """Return the piano environment inside all wrappers.

    Raises:
        ConfigError: If it is no piano; the message names the caller.
    """
    inside = env.unwrapped
    if not isinstance(inside, PianoEnv):
        raise ConfigError(
            f"{caller} cannot wrap a {type(inside).__name__}: expected a piano environment."
        )
    return inside


def layout_of(env: gym.Env[Any, Any], caller: str, *needed: str) -> ObservationLayout:
    """Return the layout of the wrapped observation; require the named blocks.

    Raises:
        ConfigError: If it is no piano, a wrapper inside has hidden the layout, or a block is not
            there.
    """
    unwrap_piano(env, caller)
    space = env.observation_space
    if not isinstance(space, ObservationSpace):
        raise ConfigError(
            f"{caller} cannot read a {type(space).__name__} without a layout: expected an "
            "observation space with one. Put wrappers that replace the space further out."
        )
    for name in needed:
        if name not in space.layout:
            raise ConfigError(
                f"{caller} finds no block {name!r} among {', '.join(space.layout)}: expected an "
                'environment whose observation is "roll" or "window".'
            )
    return space.layout
