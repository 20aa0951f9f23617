"""Feedback corrections of a plan's commands."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sb3_piano.arrays import Float32Array, FloatArray
from sb3_piano.planning.bends import EvenBends
from sb3_piano.planning.hand_plan import HandPlan

_ASIDE, _UP = 1, 2
_BESIDE = (0.008, 0.014)
"""Distances across the keys at which the lift of a fingertip begins and is full, m."""


class Correction:
    """Optimal feedback of the hands' plans, and a lift for fingertips that have caught.

    A fingertip far to the side of its place is above or between other keys. The feedback has no
    model of contacts and would push it against the obstacle. It is lifted instead, by the joints
    that move no other finger, until it is back.

    Args:
        hands: Plans of the hands.
        feedback: Share of the optimal feedback to use.
        lift: Height by which such a fingertip is lifted, m.
    """

    def __init__(self, hands: Sequence[HandPlan], feedback: float, lift: float):
        self._hands = [_OfHand(hand, feedback, lift) for hand in hands]

    def positions(self, joints: FloatArray) -> FloatArray:
        """Compute actuator positions in the sense of a plan from the joints of all hands.

        Plans assume evenly bent fingers: see :class:`EvenBends`.

        Args:
            joints: (m,) or (N, m) in the order of :attr:`PianoScene.hand_qpos`, rad or m.

        Returns:
            (n,) or (N, n) rad or m.
        """
        parts = np.split(joints, len(self._hands), axis=-1)
        pairs = zip(self._hands, parts, strict=True)
        return np.concatenate([hand.positions(part) for hand, part in pairs], axis=-1)

    def __call__(self, step: int, ahead: FloatArray) -> FloatArray:
        """Compute the corrections to add to the planned commands before a control step.

        ``ahead`` are the deviations from the plan, (n,) or (N, n), rad or m.
        """
        parts = np.split(ahead, len(self._hands), axis=-1)
        return np.concatenate(
            [hand.change(step, part) for hand, part in zip(self._hands, parts, strict=True)],
            axis=-1,
        )


class _OfHand:
    """Correction of one hand, linear around its planned positions."""

    def __init__(self, plan: HandPlan, feedback: float, lift: float):
        self._gains: Float32Array = (feedback * plan.gains).astype(np.float32)
        kinematics = plan.task.hand.kinematics
        self.positions = EvenBends(kinematics)
        _, slopes = kinematics.fingertips_and_jacobian(plan.positions[:-1])  # (T, 5, 3, n)
        moves = (slopes != 0).any(axis=(0, 2))
        own = moves & (moves.sum(axis=0) == 1)
        up = slopes[:, :, _UP] * own
        square = np.maximum((up * up).sum(axis=-1, keepdims=True), 1e-12)
        self._aside: Float32Array = slopes[:, :, _ASIDE].astype(np.float32)
        self._lift: Float32Array = (lift * up / square).astype(np.float32)

    def change(self, step: int, ahead: FloatArray) -> FloatArray:
        change = -ahead @ self._gains[step].T
        near, far = _BESIDE
        beside = np.abs(ahead @ self._aside[step].T)
        if (beside > near).any():
            change += np.clip((beside - near) / (far - near), 0.0, 1.0) @ self._lift[step]
        return np.asarray(change)
