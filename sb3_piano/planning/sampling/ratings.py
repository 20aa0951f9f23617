"""Ratings of each hand in simulated continuations, and of a whole performance."""

from __future__ import annotations

import numpy as np

from sb3_piano.arrays import BoolArray, FloatArray, IntArray
from sb3_piano.metrics import frame_f1
from sb3_piano.music import PianoRoll
from sb3_piano.music.constants import FINGERS_PER_HAND, NUM_KEYS, UNKNOWN_FINGER
from sb3_piano.music.dynamics import AT_ONE, PER_DOUBLING, SOFTEST
from sb3_piano.planning.plan import Plan
from sb3_piano.planning.sampling.cost import SamplingCost, wrong_keys
from sb3_piano.simulation import PianoScene
from sb3_piano.simulation.scene import SIDES

_COST = SamplingCost(discount=0.95)
_STRUCK = 0.5
"""Cost of a strike at which no note begins, and of a note that is silent in its first step."""
_LOUDNESS = 0.03
"""Cost of a strike that differs by a MIDI velocity of 1 from its note's."""
_HEARD = 5
"""Control steps of a continuation in which it counts: later strikes change by chance."""
_SLOWEST = 1e-3
"""Speed below which strikes are equally soft, rad/s."""


class HandRating:
    """Rating of the keys in simulations of a plan, separately for each hand.

    A key belongs to the hand whose finger has its note, or else to the hand with the nearer
    fingertips in the plan. The cost of keys in a control step is that of :class:`SamplingCost`,
    divided by half of the number of due keys plus one: as in F1, a key weighs less beside others.
    """

    def __init__(
        self, plan: Plan, scene: PianoScene, deviation: FloatArray, dynamics: bool = False
    ) -> None:
        """Assign the keys to the hands.

        Args:
            plan: The plan, T control steps.
            scene: The piano and the hands.
            deviation: (n,) unit of distances from the plan for each actuator, rad or m.
            dynamics: Whether to rate the strikes' velocities, too.
        """
        roll = plan.roll
        self._velocity = _near_onsets(roll) if dynamics else None
        self._due = roll.active
        self._weight = 2.0 / (1.0 + np.maximum(roll.active.sum(axis=1), 1))
        self._sounding_angle = scene.key_sounding_angle
        self._onset = roll.onset
        # The onset scores allow for a control step, so that one step early is in time.
        self._in_time = roll.onset.copy()
        self._in_time[:-1] |= roll.onset[1:]
        self._n_hands = len(plan.hands)
        self._owner = _owners(plan, scene)
        self._planned = np.concatenate([hand.weightless for hand in plan.hands], axis=1)
        self._deviation = deviation
        self.silence = np.zeros(NUM_KEYS, dtype=bool)
        """(88,) keys that sound in silence: none."""

    def sounding(self, angles: FloatArray) -> BoolArray:
        """Find the keys that sound at some angles, both (..., 88)."""
        return np.asarray(angles >= self._sounding_angle)

    def f1(self, angles: FloatArray) -> float:
        """Compute the F1 of a piece from the keys' angles after each control step, (T, 88) rad."""
        return frame_f1(self._due, self.sounding(angles))

    def rate(
        self,
        step: int,
        sounding: BoolArray,
        angles: FloatArray,
        ends: FloatArray,
        speeds: FloatArray,
    ) -> tuple[FloatArray, IntArray]:
        """Rate m continuations of s control steps.

        Args:
            step: The first control step.
            sounding: (88,) keys that sound before it.
            angles: (m, s, 88) angles of the keys after each control step, rad.
            ends: (m, n) actuator positions at the end, rad or m.
            speeds: (m, s, 88) speeds of the keys that begin to sound, rad/s, else 0.

        Returns:
            (m, h) cost of each hand; (m,) number of keys that sounded wrongly or were missing, over
            all control steps.
        """
        count, steps = angles.shape[:2]
        cost, mistakes = np.zeros((count, self._n_hands)), np.zeros(count, dtype=int)
        before = np.broadcast_to(sounding, (count, NUM_KEYS))
        for ahead in range(steps):
            here, now = angles[:, ahead], step + ahead
            struck = speeds[:, ahead] if ahead < _HEARD else np.zeros_like(here)
            cost += _COST.discount**ahead * self._of_keys(now, before, here, struck)
            mistakes += wrong_keys(self._due[now], here, self._sounding_angle)
            before = self.sounding(here)
        planned = np.split(self._planned[step + steps], self._n_hands)
        parts = np.split(ends, self._n_hands, axis=1)
        units = np.split(self._deviation, self._n_hands)
        for hand, (where, part, unit) in enumerate(zip(planned, parts, units, strict=True)):
            cost[:, hand] += _COST.plan_cost(where, part, unit)
        return cost, mistakes

    def each_step(self, angles: FloatArray, speeds: FloatArray) -> FloatArray:
        """Compute the cost of each hand's keys in each control step of a piece, (T, h).

        ``angles`` are those of the keys after each control step, (T, 88) rad; ``speeds`` those of
        keys that begin to sound, (T, 88) rad/s.
        """
        sounding = np.concatenate([self.silence[None], self.sounding(angles)[:-1]])
        rows = enumerate(zip(sounding, angles, speeds, strict=True))
        return np.concatenate(
            [self._of_keys(step, *(array[None] for array in row)) for step, row in rows]
        )

    def missing_velocity(self, step: int, speeds: FloatArray) -> FloatArray:
        """Compute by how much strikes are softer than their notes.

        Args:
            step: The first of s control steps.
            speeds: (..., s, 88) speeds of the keys that begin to sound, rad/s, else 0.

        Returns:
            (..., s, 88) MIDI velocities; 0 without a strike or a note, and without dynamics.
        """
        if self._velocity is None:
            return np.zeros_like(speeds)
        asked = self._velocity[step : step + speeds.shape[-2]]
        struck = AT_ONE + PER_DOUBLING * np.log2(np.maximum(speeds, _SLOWEST))
        struck = np.maximum(struck, SOFTEST)
        return np.where((asked > 0) & (speeds > 0), asked - struck, 0.0)

    def _of_keys(
        self, step: int, before: BoolArray, angles: FloatArray, speeds: FloatArray
    ) -> FloatArray:
        """Compute the cost of each hand's keys in a control step, (m, h)."""
        keys = _COST.key_cost(self._due[step], angles, self._sounding_angle) * self._weight[step]
        sounds = self.sounding(angles)
        keys += _STRUCK * (sounds & ~before & ~self._in_time[step])
        keys += _STRUCK * (~sounds & self._onset[step])
        if self._velocity is not None:
            missing = self.missing_velocity(step, speeds[:, None])[:, 0]
            keys += _LOUDNESS * np.abs(missing)
        owner = self._owner[step]
        return np.stack(
            [keys[:, owner == hand].sum(axis=1) for hand in range(self._n_hands)], axis=1
        )


def _near_onsets(roll: PianoRoll) -> FloatArray:
    """Return the velocity that is due when a key is struck in each control step, (T, 88), or 0.

    It is that of the onset in this step, else in the one before, the one after, or two before.
    """
    due = near = roll.velocity.astype(float)
    for late in (1, -1, 2):
        moved = np.zeros_like(due)
        moved[max(late, 0) : len(due) + min(late, 0)] = due[max(-late, 0) : len(due) - max(late, 0)]
        near = np.where(near > 0, near, moved)
    return near


def _owners(plan: Plan, scene: PianoScene) -> IntArray:
    """Assign each key to one of the plan's hands in each control step, (T, 88)."""
    across = scene.key_boxes[0][:, 1]
    tips = plan.fingertips[1:, :, 1].reshape(len(plan), len(plan.hands), -1)
    away = np.stack(
        [np.abs(tips[:, hand, :, None] - across).min(axis=1) for hand in range(len(plan.hands))]
    )
    nearest = away.argmin(axis=0)
    finger = plan.roll.finger
    for index, side in enumerate(scene.sides):
        has_it = finger // FINGERS_PER_HAND == SIDES.index(side)
        nearest[has_it & (finger != UNKNOWN_FINGER)] = index
    return np.asarray(nearest)
