"""Episodes that begin with the hands a little out of place."""

from __future__ import annotations

import math
from typing import Any

import gymnasium as gym
import numpy as np

from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError
from sb3_piano.simulation import TIP_TRAVEL


class PerturbedStart(gym.Wrapper[Any, Any, Any, Any], gym.utils.RecordConstructorArgs):
    """Begin each episode with the joints of both hands turned at random, within their limits.

    What is drawn comes from the environment's own generator, so that equal seeds begin alike. The
    wrapper goes right around the environment, since the observation is taken anew.

    Args:
        env: A bare piano environment, or what ``gymnasium.make`` returns for one.
        std: Standard deviation of each joint, rad, at least 0; for the forearms 6 cm for each
            rad.

    Raises:
        ConfigError: If ``std`` is out of range, or ``env`` is no piano or has wrappers that change
            its observation.
    """

    def __init__(self, env: gym.Env[Any, Any], std: float) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, std=std)
        super().__init__(env)
        if not (math.isfinite(std) and std >= 0):
            raise ConfigError(f"std is {std}: expected a finite number of rad, at least 0.")
        piano = env.unwrapped
        if not isinstance(piano, PianoEnv):
            raise ConfigError(
                f"The start of a {type(piano).__name__} cannot be perturbed: expected a piano."
            )
        if env.observation_space is not piano.observation_space:
            raise ConfigError(
                "PerturbedStart is around a wrapper that changes the observation: expected it "
                "right around the environment, further in."
            )
        self._piano = piano
        self._std = std

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode."""
        _, info = self.env.reset(seed=seed, options=options)
        scene, data = self._piano.scene, self._piano.data
        where = scene.hand_qpos
        slides = ["forearm" in name for names in scene.joint_names for name in names]
        low, high = np.concatenate(scene.joint_range).T
        offsets = self._piano.np_random.normal(size=len(where)) * self._std
        moved = data.qpos[where] + offsets * np.where(slides, TIP_TRAVEL, 1.0)
        data.qpos[where] = np.clip(moved, low, high)
        # Putting the state back makes everything that follows from the positions.
        return self._piano.set_state(self._piano.get_state()), info
