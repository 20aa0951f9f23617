"""Hands as agents in many worlds: their actions and rewards."""

from __future__ import annotations

import numpy as np
import torch

from sb3_piano.batch.tables import Pieces
from sb3_piano.batch.task import KEY_TOLERANCE, Heard, Strikes, Task, closeness, mean_where
from sb3_piano.batch.worlds import Tensor, Worlds
from sb3_piano.music.constants import FINGERS_PER_HAND
from sb3_piano.music.fingering.robot import KEY_Y
from sb3_piano.simulation.scene import SIDES
from sb3_piano.wrappers import HandActions, HandReward


class HandControls:
    """Actuator targets from the actions of :class:`~sb3_piano.wrappers.HandActions`, N worlds."""

    def __init__(self, wrapper: HandActions, worlds: Worlds):
        scene, like = worlds.scene, worlds.qpos
        self._worlds = worlds
        self._reach = torch.as_tensor(wrapper.reach).to(like)
        self._low, self._high = (
            torch.as_tensor(np.array(end)).to(like) for end in (scene.ctrl_low, scene.ctrl_high)
        )
        self._joints = torch.as_tensor(scene.hand_qpos, device=like.device)
        self._actuators = torch.as_tensor(scene.actuator_of_joint.T.copy()).to(like)

    def controls(self, actions: Tensor) -> Tensor:
        """Return the actuators' targets, (N, nu)."""
        positions = self._worlds.qpos.index_select(1, self._joints) @ self._actuators
        told = positions + self._reach * actions.clamp(-1, 1)
        return torch.minimum(torch.maximum(told, self._low), self._high)


class HandRewards:
    """Rewards of :class:`~sb3_piano.wrappers.HandReward` for the hands of N worlds."""

    def __init__(
        self, wrapper: HandReward, task: Task, pieces: Pieces, worlds: Worlds, heard: Heard
    ):
        self._task, self._pieces, self._worlds, self._heard = task, pieces, worlds, heard
        self._set = wrapper
        like = worlds.qpos
        self._hands = torch.tensor([SIDES.index(side) for side in worlds.scene.sides])
        self._key_y = torch.as_tensor(np.asarray(KEY_Y)).to(like)
        self._strikes = Strikes(pieces, worlds.count)
        self._substep = torch.arange(1, worlds.n_substeps + 1, device=like.device)[:, None]
        self._before = torch.zeros_like(heard.sounding)

    def begin(self, mask: Tensor) -> None:
        """Start the episodes of a mask."""
        self._strikes.begin(mask)
        self._before = self._before & ~mask[:, None]

    def rewards(self, piece: Tensor, row: Tensor, step: Tensor) -> Tensor:
        """Return the rewards of the present hands, (N, h), after a control step."""
        heard, options, pieces = self._heard, self._set, self._pieces
        sounding, dtype = heard.within(), self._worlds.dtype
        before, self._before = self._before, sounding[:, -1]
        due, substeps = pieces.due[row], sounding.sum(1)
        share = options.within * substeps.to(dtype) / sounding.shape[1]
        level = share + (1 - options.within) * sounding[:, -1].to(dtype)
        of_hand = self._of_hand(pieces.hand[row])  # (N, 2, 88)
        asked = due.to(dtype)
        counts = torch.stack([asked, level, asked * level], 1)  # (N, 3, 88)
        each = counts @ of_hand.transpose(1, 2)  # (N, 3, 2)
        both = (1 - options.own) * _f1(each.sum(2)) - 1.0
        rewards = options.own * _f1(each) + both[:, None]
        if options.strikes > 0:
            worth = self._struck(piece, row, step, before, sounding).to(dtype)
            rewards = rewards + options.strikes * (worth[:, None] @ of_hand.transpose(1, 2))[:, 0]
        if options.guidance > 0:
            rewards = rewards + options.guidance * self._closeness(row)
        return rewards[:, self._hands]

    def _of_hand(self, labelled: Tensor) -> Tensor:
        """Return 1 for each hand's labelled or nearest keys, (N, 2, 88)."""
        across = self._heard.fingertips[..., 1]
        nearest = (across[:, :, None] - self._key_y).abs().argmin(1) // FINGERS_PER_HAND
        hand = torch.where(labelled < 0, nearest, labelled.long())
        return torch.stack([hand == 0, hand == 1], 1).to(self._worlds.dtype)

    def _struck(
        self, piece: Tensor, row: Tensor, step: Tensor, before: Tensor, sounding: Tensor
    ) -> Tensor:
        """Return hits less misses of the strikes of each key, (N, 88)."""
        went_down = sounding & ~torch.cat([before[:, None], sounding[:, :-1]], 1)
        number, length = went_down.cumsum(1), self._pieces.goals[0].roll.control_timestep
        worth = torch.zeros_like(before, dtype=torch.long)
        for nth in range(1, int(number[:, -1].max()) + 1):  # a bouncing key strikes again
            this = went_down & (number == nth)
            struck = this.any(1)
            share = (this * self._substep).amax(1).to(self._worlds.dtype) / sounding.shape[1]
            hit = self._strikes.hit(piece, row, struck, (step[:, None] + share) * length)
            worth += 2 * hit.long() - struck.long()
        return worth

    def _closeness(self, row: Tensor) -> Tensor:
        """Return how close each hand is to holding its due keys, (N, 2)."""
        pieces, heard = self._pieces, self._heard
        key, there = pieces.key[row], pieces.share[row] > 0
        held = closeness(1.0 - heard.key_state.gather(1, key), KEY_TOLERANCE)
        near = self._set.fingering * self._task.near(row)
        hand = pieces.finger[row] // FINGERS_PER_HAND
        own = [there & (hand == side) for side in range(len(SIDES))]
        each = [0.5 * (mean_where(near, one) + mean_where(held, one)) for one in own]
        return torch.stack(each, 1)


def _f1(counts: Tensor) -> Tensor:
    """Return the F1 of (N, 3, ...) counts: due, sounding and both; 1 if the first two are 0."""
    total = counts[:, 0] + counts[:, 1]
    return torch.where(total > 0, 2 * counts[:, 2] / total.clamp(min=1e-9), 1.0)
