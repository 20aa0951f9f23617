"""Wrapper that records the episodes of the bare environment."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, SupportsFloat

import gymnasium as gym
import numpy as np

from sb3_piano.arrays import Float32Array, FloatArray
from sb3_piano.envs.piano_env import PianoEnv
from sb3_piano.metrics import EPISODE_METRICS
from sb3_piano.metrics.episode import RETURN_PREFIX
from sb3_piano.take import Motion, Take


class EpisodeRecorder(gym.Wrapper[Any, Any, Any, Any]):
    """Record each episode when it ends, before a vector environment resets it.

    Around the bare environment it records the unchanged rewards, independent of outer wrappers. If
    an outer wrapper ends an episode early, the record has the steps until then.
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        self.finished: list[Take] = []
        """Finished episodes in order. An episode that an outer wrapper ended is added when the next
        one begins."""
        self.resting = False
        """Whether each action is replaced by the rest action (see :attr:`can_rest`)."""
        self._begin()

    @property
    def can_rest(self) -> bool:
        """Whether the environment has a ``rest_action``, which plays nothing."""
        return hasattr(self.unwrapped, "rest_action")

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode."""
        if self._length > 0:  # an outer wrapper ended the previous episode
            env = self.unwrapped
            self._finish(env.summary if isinstance(env, PianoEnv) else {})
        result = self.env.reset(seed=seed, options=options)
        self._begin()
        self._note_positions()
        return result

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """Step, and record the episode if it ended."""
        if self.resting:
            action = self.unwrapped.rest_action  # type: ignore[attr-defined]
        observation, reward, terminated, truncated, info = self.env.step(action)
        self._return += float(reward)
        self._length += 1
        if self.can_rest:
            self._actions.append(np.array(action, dtype=np.float32))
        self._note_positions()
        if terminated or truncated:
            self._finish(info)
        return observation, reward, terminated, truncated, info

    def _begin(self) -> None:
        self._return, self._length = 0.0, 0
        self._qpos: list[FloatArray] = []
        self._fingertips: list[FloatArray] = []
        self._actions: list[Float32Array] = []

    def _finish(self, info: Mapping[str, Any]) -> None:
        self.finished.append(self._take(info))
        self._length = 0

    def _note_positions(self) -> None:
        if self.can_rest:
            env: Any = self.unwrapped
            self._qpos.append(env.data.qpos.copy())
            self._fingertips.append(env.scene.fingertip_position(env.data))

    def _take(self, info: Mapping[str, Any]) -> Take:
        env: Any = self.unwrapped
        metrics = {"return": self._return, "length": float(self._length)}
        returns = [name for name in info if name.startswith(RETURN_PREFIX)]
        metrics |= {n: float(info[n]) for n in (*EPISODE_METRICS, *returns) if n in info}
        if not self._qpos:
            return Take(metrics=metrics)
        played = env.performance
        return Take(
            title=played.title,
            metrics=metrics,
            performance=played,
            motion=Motion(
                qpos=np.array(self._qpos),
                hand_qpos=env.scene.hand_qpos,
                fingertips=np.array(self._fingertips),
                actions=np.array(self._actions),
            ),
            scene_options=env.scene.options,
        )
