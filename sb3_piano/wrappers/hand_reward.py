"""A reward that says to each hand how well it played in this control step."""

from __future__ import annotations

from typing import Annotated, Any, SupportsFloat

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from annotated_types import Ge, Le

from sb3_piano.metrics.onsets import ONSET_TOLERANCE
from sb3_piano.music.constants import FINGERS_PER_HAND, NUM_KEYS
from sb3_piano.music.fingering.robot import KEY_Y
from sb3_piano.settings import Number, checked
from sb3_piano.wrappers.piano import piano_of

FloatArray = npt.NDArray[np.float64]

HAND_REWARDS = "hand_rewards"
"""Name in a step's info of the rewards of the right and of the left hand, (2,)."""

Share = Annotated[Number, Ge(0), Le(1)]
Weight = Annotated[Number, Ge(0)]


class HandReward(gym.Wrapper[Any, Any, Any, Any], gym.utils.RecordConstructorArgs):
    """Reward each hand by F1 over the keys of a control step, and by its strikes.

    A hand's reward is ``own * F1(its keys) + (1 - own) * F1(all keys) - 1``, plus ``strikes`` times
    the number of its strikes that hit a note within the tolerance of the onset metric less those
    that hit none. Its keys are those that its fingers are labelled to hold, and the wrong ones that
    one of its fingertips is nearest to. A key that sounds counts by its state at the end of the
    step, and by ``within`` as the share of the step's physics steps in which it sounds. Where
    nothing is due and nothing sounds F1 is 1.

    The reward of a step is the mean of both hands'; ``info["hand_rewards"]`` has them one by one,
    for :class:`~sb3_piano.vec_env.HandsAsAgents`. The terms of the piano's own reward are still in
    ``info["reward_terms"]``.

    Args:
        env: A piano environment, wrapped or not.
        own: Share of the hand's own keys, 0 to 1.
        within: Share of what sounds within the step, 0 to 1.
        strikes: What a strike is worth, 0 or more; a missed key for a whole step is worth up to 1.

    Raises:
        ConfigError: If a number is out of range, or ``env`` is no piano.
    """

    def __init__(
        self, env: gym.Env[Any, Any], own: float = 0.6, within: float = 0.3, strikes: float = 0.3
    ) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, own=own, within=within, strikes=strikes)
        super().__init__(env)
        self._piano = piano_of(env, "HandReward")
        self._own = checked("own", own, Share)
        self._within = checked("within", within, Share)
        self._strikes = checked("strikes", strikes, Weight)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode."""
        observation, info = self.env.reset(seed=seed, options=options)
        roll = self._piano.roll
        self._hand_of = np.where(roll.finger >= 0, roll.finger // FINGERS_PER_HAND, -1)
        self._open: dict[int, list[float]] = {}  # by key, onsets that are yet to be struck, s
        steps_and_keys = np.argwhere(roll.onset).tolist()
        for (_, key), time in zip(steps_and_keys, roll.onset_time.tolist(), strict=True):
            self._open.setdefault(key, []).append(time)
        self._sounding = np.zeros(NUM_KEYS, dtype=bool)
        return observation, info

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """Play a control step."""
        piano = self._piano
        step = piano.steps_played
        observation, _, terminated, truncated, info = self.env.step(action)
        rewards = self._rewards(step)
        info[HAND_REWARDS] = rewards
        return observation, float(rewards.mean()), terminated, truncated, info

    def _rewards(self, step: int) -> FloatArray:
        simulation, due = self._piano.simulation, self._piano.roll.active[step]
        sounding = self._piano.scene.sounding_at(simulation.key_angles)  # (p, 88)
        heard = (1 - self._within) * sounding[-1] + self._within * sounding.mean(axis=0)
        keys = np.flatnonzero(due | (heard > 0))
        before, self._sounding = self._sounding, sounding[-1]
        if len(keys) == 0:
            return np.zeros(2)
        hands = self._hand_of[step, keys]
        if (hands < 0).any():  # which nobody holds: wrong ones, and those released early
            tips = simulation.fingertips[:, 1]
            near = np.abs(tips[:, None] - KEY_Y[keys]).argmin(axis=0) // FINGERS_PER_HAND
            hands = np.where(hands < 0, near, hands)
        asked, heard = due[keys].astype(float), heard[keys]
        both = _f1(asked, heard)
        rewards = np.array(
            [
                self._own * _f1(asked[hands == side], heard[hands == side])
                + (1 - self._own) * both
                - 1.0
                for side in (0, 1)
            ]
        )
        if self._strikes > 0:
            self._add_strikes(rewards, step, before, sounding, keys, hands)
        return rewards

    def _add_strikes(
        self,
        rewards: FloatArray,
        step: int,
        before: npt.NDArray[np.bool_],
        sounding: npt.NDArray[np.bool_],
        keys: npt.NDArray[np.intp],
        hands: npt.NDArray[np.intp],
    ) -> None:
        """Add to the hands' rewards what their strikes in this step are worth."""
        columns = np.concatenate([before[None, keys], sounding[:, keys]]).astype(np.int8)
        length = self._piano.config.control_timestep
        for substep, index in np.argwhere(np.diff(columns, axis=0) == 1).tolist():
            time = (step + (substep + 1) / len(sounding)) * length
            hit = self._strike(int(keys[index]), time)
            rewards[hands[index]] += self._strikes * (1.0 if hit else -1.0)

    def _strike(self, key: int, time: float) -> bool:
        """Return whether a strike hits a note that was not struck before, which it now is."""
        waiting = self._open.get(key, [])
        near = [onset for onset in waiting if abs(onset - time) <= ONSET_TOLERANCE + 1e-9]
        if near:
            waiting.remove(min(near, key=lambda onset: abs(onset - time)))
        return bool(near)


def _f1(asked: FloatArray, heard: FloatArray) -> float:
    """Return F1 of how much of each key is heard, 0 to 1, where it is asked for or not."""
    total = float(asked.sum() + heard.sum())
    return 2 * float((asked * heard).sum()) / total if total > 0 else 1.0
