"""Base of the wrappers that change what is observed, and the environment inside a wrapper."""

from __future__ import annotations

from typing import Any

import gymnasium as gym

from sb3_piano.envs import ObservationSpace, PianoEnv
from sb3_piano.envs.observation import ObservationLayout
from sb3_piano.exceptions import ConfigError


class LayoutWrapper(gym.ObservationWrapper[Any, Any, Any]):
    """Observe a vector of another layout.

    The new observation space has the layout, so that wrappers further out, feature extractors and
    replay buffers find the blocks by name; ``env.unwrapped.observation_layout`` remains that of
    the environment itself.
    """

    def __init__(self, env: gym.Env[Any, Any], layout: ObservationLayout) -> None:
        super().__init__(env)
        self.observation_layout = layout
        """Name, place and meaning of each block."""
        self.observation_space = ObservationSpace(layout)


def piano_of(env: gym.Env[Any, Any], asker: str) -> PianoEnv:
    """Return the piano environment inside all wrappers.

    Raises:
        ConfigError: If it is no piano; the message names who asks.
    """
    inside = env.unwrapped
    if not isinstance(inside, PianoEnv):
        raise ConfigError(
            f"{asker} cannot wrap a {type(inside).__name__}: expected a piano environment."
        )
    return inside


def layout_of(env: gym.Env[Any, Any], asker: str, *needed: str) -> ObservationLayout:
    """Return the layout of the observation that a wrapper gets, with the blocks that it needs.

    Raises:
        ConfigError: If it is no piano, a wrapper inside has hidden the layout, or a block is not
            there.
    """
    piano_of(env, asker)
    space = env.observation_space
    if not isinstance(space, ObservationSpace):
        raise ConfigError(
            f"{asker} cannot tell which numbers of a {type(space).__name__} mean what: expected "
            "an observation space with a layout. Put wrappers that replace it further out."
        )
    for name in needed:
        if name not in space.layout:
            raise ConfigError(
                f"{asker} finds no block {name!r} among {', '.join(space.layout)}: expected an "
                'environment whose observation is "roll" or "window".'
            )
    return space.layout
