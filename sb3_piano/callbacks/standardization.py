"""Observations standardised as those of the network that is corrected."""

from __future__ import annotations

from stable_baselines3.common.callbacks import BaseCallback

from sb3_piano.policies import set_standardization


class SightReaderStandardization(BaseCallback):
    """When a training begins, let the policy standardise observations as the sight-reader does.

    For policies of :mod:`sb3_piano.policies` for hands in environments with
    :class:`~sb3_piano.players.SightReaderResidual`. The numbers are saved with the policy.

    Raises:
        ConfigError: When training starts, if the policy is another one.
    """

    def _on_training_start(self) -> None:
        if self.num_timesteps == 0:  # a training that goes on has them
            mean, std = self.training_env.get_attr("standardization", [0])[0]
            set_standardization(self.model.policy, mean, std)

    def _on_step(self) -> bool:
        return True
