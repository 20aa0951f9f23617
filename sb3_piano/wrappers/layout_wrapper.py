"""The base of all wrappers that change what is observed."""

from __future__ import annotations

from typing import Any

import gymnasium as gym

from sb3_piano.envs import ObservationLayout, ObservationSpace


class LayoutWrapper(gym.ObservationWrapper[Any, Any, Any]):
    """Observe a vector of another layout.

    The new observation space has the layout, so that wrappers further out, feature extractors and
    replay buffers find the blocks by name; ``env.unwrapped.observation_layout`` remains that of
    the environment itself.

    Args:
        env: A piano environment, wrapped or not.
        layout: Which numbers of the new observation stand where.
    """

    def __init__(self, env: gym.Env[Any, Any], layout: ObservationLayout) -> None:
        super().__init__(env)
        self.observation_layout = layout
        """Which numbers stand where."""
        self.observation_space = ObservationSpace(layout)
