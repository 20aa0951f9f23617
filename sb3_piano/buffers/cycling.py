"""Replay buffer that samples from one environment after the other."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from stable_baselines3.common.type_aliases import ReplayBufferSamples
from stable_baselines3.common.vec_env import VecNormalize

from sb3_piano.buffers.compact import CompactReplayBuffer


class CyclingReplayBuffer(CompactReplayBuffer):
    """``CompactReplayBuffer`` that takes each batch from one environment, in turn.

    The k-th batch has transitions of environment k modulo the number of environments. If each
    environment plays its own piece (``pieces`` in YAML), every piece has a replay buffer, and
    updates alternate between pieces; :class:`CompactReplayBuffer` draws each batch from all of
    them, in equal shares on average. A resumed training begins with environment 0 again.
    ``buffer_size`` counts the transitions of all environments together.

    Source: RoboVirtuoso (2023), section 4.2: "we give each environment its own replay buffer and
    then cycle through the replay buffers when sampling minibatches for training". Its authors make
    one update for each transition: ``gradient_steps: -1`` here.

    Arguments and errors are those of :class:`CompactReplayBuffer`.
    """

    _turn = 0

    def _get_samples(
        self, batch_inds: npt.NDArray[np.intp], env: VecNormalize | None = None
    ) -> ReplayBufferSamples:
        """Return the transitions at (n,) rows of the next environment in turn."""
        envs = np.full(len(batch_inds), self._turn)
        self._turn = (self._turn + 1) % self.n_envs
        ended = self.dones[batch_inds, envs] * (1 - self.timeouts[batch_inds, envs])
        arrays = (
            self._normalize_obs(self.observations[batch_inds, envs], env),
            self.actions[batch_inds, envs],
            self._normalize_obs(self.next_observations[batch_inds, envs], env),
            ended.reshape(-1, 1),
            self._normalize_reward(self.rewards[batch_inds, envs].reshape(-1, 1), env),
        )
        return ReplayBufferSamples(*map(self.to_torch, arrays))
