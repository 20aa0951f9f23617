"""Wrapper with a reward for each hand in each control step."""

from __future__ import annotations

import itertools
import math
from typing import Any, SupportsFloat

import gymnasium as gym
import numpy as np

from sb3_piano.arrays import BoolArray, FloatArray
from sb3_piano.envs.rewards import held, labelled_fingering
from sb3_piano.envs.terms import as_loud
from sb3_piano.exceptions import ConfigError
from sb3_piano.metrics.onsets import OpenOnsets
from sb3_piano.music.constants import FINGERS_PER_HAND, NUM_KEYS
from sb3_piano.music.fingering.robot import KEY_Y
from sb3_piano.settings import NotNegative, Share, checked
from sb3_piano.simulation.scene import SIDES
from sb3_piano.wrappers.piano import unwrap_piano

HAND_REWARDS = "hand_rewards"
"""Key of ``info`` for the rewards of the hands in the scene, the right one first."""


class HandReward(gym.Wrapper[Any, Any, Any, Any], gym.utils.RecordConstructorArgs):
    """Reward each hand by F1 over the keys of a control step, and by its strikes.

    A hand's reward is ``own * F1(its keys) + (1 - own) * F1(all keys) - 1``, plus ``strikes`` for
    each strike that hits a note within the tolerance of the onset metric, less ``strikes`` for each
    other strike, plus up to ``dynamics`` for a hit that is as loud as its note. The hand's keys are
    those labelled with its fingers, and the wrong keys nearest to one of its fingertips. A sounding
    key counts by its state at the end of the step, and by ``within`` as the share of the physics
    steps in which it sounds. Without due and sounding keys F1 is 1.

    An untrained hand hardly ever hits a due key. ``guidance`` is the highest bonus for coming near:
    the mean closeness, as in RoboPianist's terms of fingering and of pressing keys, of its fingers
    to the due keys, times ``fingering``, and of these keys to being down.

    The reward of a step is the mean of the hands' rewards; ``info["hand_rewards"]`` has each, for
    :class:`~sb3_piano.vec_env.HandsAsAgents`. ``info["reward_terms"]`` keeps the terms of the
    piano's own reward.

    Args:
        env: A piano environment, wrapped or not.
        own: Share of the hand's own keys, 0 to 1.
        within: Share of what sounds within the step, 0 to 1.
        strikes: Value of a strike, 0 or more; a missed key for a whole step costs up to 1.
        guidance: Value of being at due keys and holding them down, 0 or more.
        fingering: Weight of the labelled fingers in the guidance, 0 or more; with 0 it pays for
            keys alone, whichever finger holds them.
        dynamics: Value of a strike in time that is as loud as its note, 0 or more; it falls to 0 at
            a difference of 30 MIDI velocities, as the reward term ``dynamics``.

    Raises:
        ConfigError: If a number is out of range, or ``env`` is no piano or has no hands.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any],
        own: float = 0.6,
        within: float = 0.3,
        strikes: float = 0.3,
        guidance: float = 0.0,
        fingering: float = 1.0,
        dynamics: float = 0.0,
    ) -> None:
        gym.utils.RecordConstructorArgs.__init__(
            self,
            own=own,
            within=within,
            strikes=strikes,
            guidance=guidance,
            fingering=fingering,
            dynamics=dynamics,
        )
        super().__init__(env)
        self._piano = unwrap_piano(env, "HandReward")
        if not self._piano.scene.sides:
            raise ConfigError("HandReward finds no hands in the scene: expected one or two.")
        self._hands = [SIDES.index(side) for side in self._piano.scene.sides]
        self.own = checked("own", own, Share)
        self.within = checked("within", within, Share)
        self.strikes = checked("strikes", strikes, NotNegative)
        self.guidance = checked("guidance", guidance, NotNegative)
        self.fingering = checked("fingering", fingering, NotNegative)
        self.dynamics = checked("dynamics", dynamics, NotNegative)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode."""
        observation, info = self.env.reset(seed=seed, options=options)
        finger = self._piano.asked_roll.finger
        self._hand_of = np.where(finger >= 0, finger // FINGERS_PER_HAND, -1)
        self._open = OpenOnsets(self._piano.roll)
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

    def snapshot(self) -> tuple[OpenOnsets, BoolArray]:
        """Return the open onsets and the sounding keys, to go with ``PianoEnv.snapshot``."""
        return self._open.copy(), self._sounding

    def go_back(self, moment: tuple[OpenOnsets, BoolArray]) -> None:
        """Restore a snapshot."""
        self._open, self._sounding = moment[0].copy(), moment[1]

    def _rewards(self, step: int) -> FloatArray:
        # Some keys at a time: plain numbers are faster than arrays.
        piano, length = self._piano, self._piano.config.control_timestep
        sounding = piano.scene.sounding_at(piano.simulation.key_angles)  # (p, 88)
        before, self._sounding = self._sounding, sounding[-1]
        substeps, due = sounding.sum(axis=0), piano.asked_roll.active[step]
        keys = np.flatnonzero(due | (substeps > 0)).tolist()
        # Of each hand: how many keys are asked for, heard, and both.
        counts, earned = ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0]), [0.0, 0.0]
        for key in keys:
            hand, asked = self._hand(step, key), bool(due[key])
            share = self.within * substeps.item(key) / len(sounding)
            heard = share + (1 - self.within) * bool(sounding[-1, key])
            for n, count in enumerate((asked, heard, asked * heard)):
                counts[hand][n] += count
            if self.strikes + self.dynamics > 0 and substeps[key] > 0:
                column = [bool(before[key]), *sounding[:, key].tolist()]
                for substep, (was, now) in enumerate(itertools.pairwise(column), start=1):
                    if now and not was:
                        hit = self._open.hit(key, (step + substep / len(sounding)) * length)
                        earned[hand] += self.strikes if hit else -self.strikes
                        if hit and self.dynamics and sounding[-1, key]:
                            loud = as_loud(piano.roll, step, piano.simulation, key)
                            earned[hand] += self.dynamics * loud
        both = map(sum, zip(*counts, strict=True))
        own, all_keys = self.own, (1 - self.own) * _f1(*both) - 1.0
        pairs = zip(counts, earned, strict=True)
        rewards = np.array([own * _f1(*one) + all_keys + strikes for one, strikes in pairs])
        rewards = rewards[self._hands]
        return rewards + self.guidance * self._closeness(step) if self.guidance else rewards

    def _closeness(self, step: int) -> FloatArray:
        """Return the closeness of each hand to its due keys; 0 without due keys."""
        simulation = self._piano.simulation
        keys, fingers = (array.tolist() for array in self._piano.asked_roll.due(step))
        distances: tuple[list[float], list[float]] = ([], [])
        missing: tuple[list[float], list[float]] = ([], [])
        for key, finger in zip(keys, fingers, strict=True):
            if finger < 0:
                continue
            hand, tip = finger // FINGERS_PER_HAND, simulation.fingertips[finger].tolist()
            distances[hand].append(math.dist(simulation.press_point(key), tip))
            missing[hand].append(1.0 - simulation.key_state.item(key))
        pairs = zip(distances, missing, strict=True)
        fingering = self.fingering
        closeness = [0.5 * (fingering * labelled_fingering(d) + held(m)) for d, m in pairs]
        return np.array(closeness)[self._hands]

    def _hand(self, step: int, key: int) -> int:
        """Return the hand that holds a key, or the nearest one: 0 or 1."""
        hand = self._hand_of.item(step, key)
        if hand < 0:  # a wrong key, or one that was released early
            tips = self._piano.simulation.fingertips[:, 1]
            hand = int(np.abs(tips - KEY_Y[key]).argmin()) // FINGERS_PER_HAND
        return hand


def _f1(asked: float, heard: float, hit: float) -> float:
    """Return the F1 of keys, each sounding by a share; 1 if no key is due and none sounds."""
    total = asked + heard
    return 2 * hit / total if total > 0 else 1.0
