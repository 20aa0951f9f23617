"""Actuator positions of evenly bent fingers from the joint positions of any fingers."""

from __future__ import annotations

import math

import numpy as np

from sb3_piano.arrays import ComplexArray, FloatArray
from sb3_piano.hands.kinematics import HandKinematics

_STEPS = 3
_LONGEST_STEP = 0.3  # rad
_STRAIGHT = 1e-7  # square of a slope, m per rad, below which a finger counts as straight


class EvenBends:
    """Conversion of a hand's joint positions to actuator positions with the same fingertips.

    In a simulation two joints with a shared actuator need not bend equally, so their sum does not
    determine the tip. The result has equally bent joints, with the knuckle adjusted so that the tip
    stays in place. A finger's last three joints are parallel: positions in its plane are complex
    numbers, with its first link on the real axis.
    """

    def __init__(self, kinematics: HandKinematics):
        """Take a hand, of which k fingers have last two joints that share an actuator."""
        self._hand, numbers, lengths = kinematics, [], []
        for path, tip in kinematics.chains:
            above = (kinematics.links[i] for i in path)
            knuckle, middle, end = [link for link in above if link.joint >= 0][-3:]
            before, both, last = (kinematics.driver[j.joint] for j in (knuckle, middle, end))
            if both == last:
                numbers.append((before, both, middle.joint))
                ways = (middle.offset, end.offset, tip)
                lengths.append([math.hypot(*(length for _, length in way)) for way in ways])
        self._knuckle, self._both, self._middle = np.array(numbers, np.intp).reshape(-1, 3).T
        self._lengths = np.array(lengths).reshape(-1, 3).T
        """(3, k) lengths of the links after the knuckle, m."""

    def __call__(self, joints: FloatArray) -> FloatArray:
        """Compute actuator positions, (..., n) rad or m, from joint positions, (..., m)."""
        positions = np.asarray(joints @ self._hand.actuator_of_joint.T)
        low, high = self._hand.low[self._both], self._hand.high[self._both]
        _, second, third = self._lengths
        even = positions[..., self._both]
        wanted = self._tips(joints[..., self._middle], even)
        for _ in range(_STEPS):  # Newton's method, for the tip's distance from the knuckle
            found = self._tips(even / 2, even)
            distance = np.abs(found)
            turned = 1j * (second / 2 * np.exp(0.5j * even) + third * np.exp(1j * even))
            slope = (found.conj() * turned).real / distance
            # The slope is 0 at a straight finger, which no bend makes longer.
            change = (np.abs(wanted) - distance) * slope / (slope**2 + _STRAIGHT)
            even = np.clip(even + np.clip(change, -_LONGEST_STEP, _LONGEST_STEP), low, high)
        positions[..., self._both] = even
        positions[..., self._knuckle] += np.angle(wanted / self._tips(even / 2, even))
        return positions

    def _tips(self, middle: FloatArray, end: FloatArray) -> ComplexArray:
        """Compute the fingertips, (..., k) m, from the angles of the second and third links."""
        first, second, third = self._lengths
        return np.asarray(first + second * np.exp(1j * middle) + third * np.exp(1j * end))
