"""Changes of a motion around its strikes, which make them softer or louder.

A key's speed as it begins to sound depends on how far the finger falls, on contacts and on the
hand's other notes. So it is found by playing: :class:`~sb3_piano.planning.refinement.Refinement`
tries changes of the fingertips' heights before each strike, and in it.
"""

from __future__ import annotations

import numpy as np

from sb3_piano.arrays import FloatArray, IntArray
from sb3_piano.planning.plan import Plan
from sb3_piano.planning.roll_outs import Way

_UP = 2
_SHAPE = np.array([[0.3, 1.0, 0.0], [0.0, 0.0, 1.0]])
"""Two changes of a fingertip's height, by control step: before the strike, and in it."""
_LEAD = 2
"""Control steps by which they begin before the strike."""
_WRIST = 0.1
"""Share of the wrist, which moves fingers that are bent down and hardly move up by themselves."""
_LOUDER = np.array([0.4e-3, -0.3e-3])
"""Sizes of both for a strike louder by a MIDI velocity of 1, m."""
_TRUST = np.square(2e-3)
"""Trust in these: as in a measurement of a strike whose heights changed by 2 mm, m^2."""
_SHARES = (0.5, 1.0, 2.0)
"""Shares of the missing velocity for which candidates make up."""
_NOISE = 3e-3
"""Standard deviation of the other candidates' heights, m; times one of the sizes."""
_SIZES = (0.4, 1.0, 2.0)


class Touches:
    """Changes around the k strikes of a plan, by joints that move no other finger, and wrists."""

    def __init__(self, plan: Plan) -> None:
        strikes: list[tuple[int, int, int, FloatArray]] = []
        begin = 0
        for index, hand in enumerate(plan.hands):
            kinematics = hand.task.hand.kinematics
            _, slopes = kinematics.fingertips_and_jacobian(hand.positions[:-1])
            moves = (slopes != 0).any(axis=(0, 2))
            share = (moves & (moves.sum(axis=0) == 1)).astype(float)  # (f, n)
            share += _WRIST * np.array([role == "wrist" for role in kinematics.roles])
            for one in hand.task.presses:
                if one.press.velocity:
                    up = slopes[one.first - 1, one.press.finger, _UP]
                    row = share[one.press.finger] * up
                    change = np.zeros(plan.commands.shape[1])
                    change[begin : begin + len(row)] = row / max(float(row @ up), 1e-12)
                    strikes.append((one.first - 1, one.press.key, index, change))
            begin += kinematics.size
        strikes.sort(key=lambda strike: strike[0])
        self.step = np.array([strike[0] for strike in strikes], dtype=int)
        """(k,) control step of each strike, ascending."""
        self.hand = np.array([strike[2] for strike in strikes], dtype=int)
        """(k,) index of its hand."""
        self._key = np.array([strike[1] for strike in strikes], dtype=int)
        self._up = [strike[3] for strike in strikes]

    def near(self, step: int, steps: int) -> IntArray:
        """Return the strikes that changes in ``steps`` control steps from ``step`` on affect."""
        return np.arange(*np.searchsorted(self.step, (step, step + steps + 1)))

    def way(
        self, followed: Way, step: int, steps: int, which: IntArray, heights: FloatArray
    ) -> Way:
        """Apply changes of m strikes, (m, 2) m, to the followed motion from ``step`` on."""
        way = Way(*(array[step : step + steps].copy() for array in followed))
        for index, change in zip(which.tolist(), heights @ _SHAPE, strict=True):
            for at, height in enumerate(change.tolist(), int(self.step[index]) - _LEAD - step):
                if 0 <= at < len(way.commands):
                    way.commands[at] += height * self._up[index]
        return way

    def short(self, which: IntArray, step: int, missing: FloatArray) -> FloatArray:
        """Return by how much each of m strikes was too soft, (m,) MIDI velocities; 0 if silent.

        ``missing``, (s, 88), are the velocities by which keys were struck too softly.
        """
        pairs = zip((self.step[which] - step).tolist(), self._key[which].tolist(), strict=True)
        return np.array([missing[max(at - 1, 0) : at + 3, key].sum() for at, key in pairs])

    def drawn(
        self,
        heights: list[FloatArray],
        short: list[FloatArray],
        random: np.random.Generator,
    ) -> list[FloatArray]:
        """Draw changes of m strikes around those tried last, (m, 2) m each.

        Args:
            heights: (m, 2) changes that were tried, the last one the best, m.
            short: (m,) velocities by which strikes were then too soft, 0 for silent ones.
            random: The random generator.
        """
        centre, least = heights[-1], short[-1]
        # How velocities follow the heights, measured where changes made a difference.
        moved = np.stack(heights) - centre
        gained = least - np.stack(short)
        heard = ((np.stack(short) != 0) & (least != 0))[..., None]
        guess = _LOUDER / (_LOUDER @ _LOUDER)
        squares = np.einsum("cmi,cmj->mij", heard * moved, moved) + _TRUST * np.eye(2)
        products = (heard * moved * gained[..., None]).sum(axis=0) + _TRUST * guess
        gain = np.linalg.solve(squares, products[..., None])[..., 0]
        size = np.maximum(np.square(gain).sum(axis=1), 0.25 * (guess @ guess))
        louder = gain * (least / size)[:, None]
        found = [centre + share * louder for share in _SHARES]
        for made_up in (0.0, 1.0, 1.0):
            noise = random.choice(_SIZES) * _NOISE * random.standard_normal(centre.shape)
            found.append(centre + made_up * louder + noise)
        return found
