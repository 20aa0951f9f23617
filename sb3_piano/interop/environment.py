"""A piano environment as a ``dm_env.Environment``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from sb3_piano.engine import mujoco
from sb3_piano.envs.episode_end import final_info
from sb3_piano.exceptions import ConfigError, EnvStateError
from sb3_piano.interop.scene import DM_CONTROL_NEEDED, import_dm_control
from sb3_piano.metrics import EPISODE_METRICS
from sb3_piano.wrappers.piano import layout_of, unwrap_piano

try:
    import dm_env
    from dm_env import specs
except ImportError as error:
    raise ImportError(f"sb3_piano.interop needs dm_env ({error}): pip install dm-env") from error

if TYPE_CHECKING:
    from dm_control.mujoco import Physics

ROBOPIANIST_NAMES: Mapping[str, str] = {
    "key_state": "piano/state",
    "sustain": "piano/sustain_state",
    "right_joints": "rh_shadow_hand/joints_pos",
    "left_joints": "lh_shadow_hand/joints_pos",
}
"""RoboPianist's names of the blocks of the observation, where they differ from ours."""


class DmEnvironment(dm_env.Environment):
    """``dm_env.Environment`` adapter for a piano environment.

    An observation is a dictionary of one-dimensional float32 arrays, one for each block of
    ``observation_layout``, with RoboPianist's names. In order they are the flat vector;
    ``ConcatObservationWrapper`` sorts them by name, as it does with RoboPianist's.

    The discount of an episode's last step is 0 where the environment terminated and 1 where it was
    truncated, such as at the end of the piece. A step after the last one begins a new episode.

    Args:
        env: A piano environment, wrapped or not, or the id of one.
        seed: Seeds the environment in its first reset, and ``random_state``.
        **options: If ``env`` is an id, options of ``gymnasium.make``.

    Raises:
        ConfigError: If the observation has no layout, or there are options without an id.
    """

    def __init__(
        self, env: str | gym.Env[Any, Any], *, seed: int | None = None, **options: Any
    ) -> None:
        if not isinstance(env, str) and options:
            raise ConfigError(
                f"The options {sorted(options)} are for an environment that is made from its id, "
                f"but {env} is made already: expected its id."
            )
        self.env = gym.make(env, **options) if isinstance(env, str) else env
        """The Gymnasium environment."""
        self.random_state = np.random.RandomState(seed)
        """For agents that draw their first actions from the environment's generator."""
        self._piano = unwrap_piano(self.env, "DmEnvironment")
        self._layout = layout_of(self.env, "DmEnvironment")
        self._seed = seed
        self._finished = True  # until the first reset
        self._metrics: dict[str, float] | None = None
        self._physics: Physics | None = None

    # dm_env's interface.

    def reset(self) -> dm_env.TimeStep:
        """Begin an episode."""
        observation, _ = self.env.reset(seed=self._seed)
        self._seed, self._finished = None, False
        return dm_env.restart(self._blocks(observation))

    def step(self, action: npt.ArrayLike) -> dm_env.TimeStep:
        """Play one control step, or begin an episode before the first and after the last.

        Args:
            action: Shape of ``action_spec()``, in [-1, 1].
        """
        if self._finished:
            return self.reset()
        observation, reward, terminated, truncated, info = self.env.step(np.asarray(action))
        told = float(reward), self._blocks(observation)
        self._finished = terminated or truncated
        if not self._finished:
            return dm_env.transition(*told)
        info = final_info(info)
        self._metrics = {name: info[name] for name in EPISODE_METRICS if name in info}
        return dm_env.termination(*told) if terminated else dm_env.truncation(*told)

    def observation_spec(self) -> dict[str, specs.BoundedArray]:
        """Describe the blocks of the observation."""
        space = self.env.observation_space
        assert isinstance(space, gym.spaces.Box), "a layout describes a vector"
        low, high = self._blocks(space.low), self._blocks(space.high)
        return {
            name: specs.BoundedArray(low[name].shape, low[name].dtype, low[name], high[name], name)
            for name in low
        }

    def action_spec(self) -> specs.BoundedArray:
        """Describe the action: actuator targets and pedal, scaled to [-1, 1]."""
        space = self.env.action_space
        assert isinstance(space, gym.spaces.Box), "piano environments have continuous actions"
        return specs.BoundedArray(space.shape, space.dtype, space.low, space.high, "action")

    def close(self) -> None:
        """Free the drawing contexts."""
        if self._physics is not None:
            self._physics.free()
            self._physics = None
        self.env.close()

    # What RoboPianist's programs and dm_control's viewer ask for besides.

    def get_musical_metrics(self) -> dict[str, float]:
        """Return :data:`~sb3_piano.metrics.EPISODE_METRICS` of the last whole episode by name.

        Raises:
            EnvStateError: If none is over yet.
        """
        if self._metrics is None:
            raise EnvStateError("No episode is over yet: play one to its last step.")
        return dict(self._metrics)

    def control_timestep(self) -> float:
        """Return the length of a control step, in s."""
        return self._piano.config.control_timestep

    @property
    def physics(self) -> Physics:
        """View of the environment's model and data as dm_control's ``Physics``.

        Raises:
            ImportError: If dm_control is not installed, or does not work with this MuJoCo.
        """
        piano = self._piano
        if self._physics is None or self._physics.data.ptr is not piano.data:
            wrapper = import_dm_control("mujoco.wrapper")
            state = piano.get_state()
            try:
                self._physics = import_dm_control("mujoco").Physics(wrapper.MjData(piano.data))
            except AttributeError as error:
                raise ImportError(
                    f"This dm_control does not work with MuJoCo {mujoco.__version__} ({error}): "
                    f"{DM_CONTROL_NEEDED}"
                ) from error
            piano.set_state(state)  # dm_control computes forces without controls
        return self._physics

    def _blocks(self, vector: npt.NDArray[np.float32]) -> dict[str, npt.NDArray[np.float32]]:
        return {
            ROBOPIANIST_NAMES.get(block.name, block.name): vector[block.slice]
            for block in self._layout.values()
        }
