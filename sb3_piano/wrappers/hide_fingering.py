"""Wrapper that removes the fingering blocks from the observation."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from sb3_piano.wrappers.piano import LayoutWrapper, layout_of

FINGERING_BLOCKS = ("fingering", "lookahead_fingering")
"""Blocks of the observation with finger labels."""


class HideFingering(LayoutWrapper, gym.utils.RecordConstructorArgs):
    """Replace finger labels by zeros; the observation keeps its shape and space.

    The *reward* still depends on the labels of a score, and so do wrappers that show rewards, such
    as :class:`~sb3_piano.wrappers.PreviousActionReward`. Use ``fingering_reward="off"`` or
    ``"optimal-transport"`` for an environment without labels.

    Source: the curriculum-strategies report on RoboPianist: "We replace the per-note finger field
    in o_t with a constant of the same dimension."

    Args:
        env: A piano environment, wrapped or not, that observes keys. ``observation="fingers"`` is
            made of labels altogether.

    Raises:
        ConfigError: If ``env`` is no piano or has no block of finger labels.
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        gym.utils.RecordConstructorArgs.__init__(self)
        layout = layout_of(env, "HideFingering", "fingering")
        super().__init__(env, layout)
        self._hidden = [layout[name].slice for name in FINGERING_BLOCKS if name in layout]

    def observation(self, observation: Any) -> npt.NDArray[np.float32]:
        """Return an observation without labels."""
        shown: npt.NDArray[np.float32] = observation.copy()
        for block in self._hidden:
            shown[block] = 0.0
        return shown
