"""A fingering reward that fades out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym

from sb3_piano.envs.config import RewardWeight
from sb3_piano.settings import Count, Index, checked
from sb3_piano.wrappers.reward_wrapper import RewardTermsWrapper


class FingeringDecay(RewardTermsWrapper, gym.utils.RecordConstructorArgs):
    """Let the fingering term count less and less while the training goes on.

    Its weight falls linearly from what it is inside of this wrapper, in the ``start``-th control
    step, to ``final`` in the ``n_steps``-th one after, and stays there. Fingers are then guided to
    their keys at first, and free to find better ones later.

    Steps are those of this environment, counted by ``env.unwrapped.total_steps``, also over
    episodes. Of several environments each counts its own: for a decay over N steps of a training
    with 4 environments, ``n_steps`` is N / 4. A training that ``sb3-piano train --resume`` goes on
    with counts on; evaluations report the environment's own reward, which does not change.

    Args:
        env: A piano environment, wrapped or not.
        n_steps: Control steps of this environment from the first weight to the last, at least 1.
        final: The weight in the end.
        start: Control steps before the weight begins to fall, at least 0.

    Raises:
        ConfigError: If an argument is out of range, or ``env`` is no piano.
    """

    def __init__(
        self, env: gym.Env[Any, Any], n_steps: int, *, final: float = 0.0, start: int = 0
    ) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, n_steps=n_steps, final=final, start=start)
        super().__init__(env)
        self._n_steps = checked("n_steps", n_steps, Count)
        self._final = checked("final", final, RewardWeight)
        self._start = checked("start", start, Index)

    @property
    def reward_weights(self) -> Mapping[str, float]:
        """The weights of the terms in the control step that was played last."""
        weights = self.inner_weights
        share = min(max((self._piano.total_steps - self._start) / self._n_steps, 0.0), 1.0)
        fingering = (1.0 - share) * weights["fingering"] + share * self._final
        return {**weights, "fingering": fingering}
