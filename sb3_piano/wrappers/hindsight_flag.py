"""Wrapper that marks relabelled episodes in the observation."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from sb3_piano.envs.observation import ObservationBlock, ObservationLayout
from sb3_piano.wrappers.piano import LayoutWrapper, layout_of


class HindsightFlag(LayoutWrapper, gym.utils.RecordConstructorArgs):
    """Append 1 to observations of relabelled episodes, 0 to all others.

    Appends the block ``relabelled``, one number: 0 in every played episode, and 1 in the
    transitions that :class:`~sb3_piano.callbacks.HindsightCallback` adds to the replay buffer. It
    may be outside or inside another wrapper that changes the layout.

    Source: RoboVirtuoso, section 5.2, "an additional value in the observables vector to indicate
    whether an episode was a relabelled or the original".

    Raises:
        ConfigError: If ``env`` is no piano, or the block is there already.
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        gym.utils.RecordConstructorArgs.__init__(self)
        layout = layout_of(env, "HindsightFlag")
        block = ObservationBlock(
            name="relabelled",
            shape=(1,),
            meaning="1 in an episode whose piece was made of what was played in it, else 0",
            binary=True,
        )
        super().__init__(env, ObservationLayout([*layout.values(), block]))
        self.relabelled = False
        """Whether the observations are those of a relabelled episode."""

    def observation(self, observation: Any) -> npt.NDArray[np.float32]:
        """Return the observation with the flag appended."""
        return np.concatenate([observation, (float(self.relabelled),)], dtype=np.float32)
