"""The plan of one hand, made stretch by stretch."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from sb3_piano.music import PianoRoll
from sb3_piano.planning.dynamics import HandDynamics
from sb3_piano.planning.hand_cost import HandCost
from sb3_piano.planning.key_frames import key_frames
from sb3_piano.planning.key_places import THUMB, KeyPlaces
from sb3_piano.planning.kinematics import HandKinematics
from sb3_piano.planning.leaps import TimedPress, time_presses
from sb3_piano.planning.least_squares import HandProblem
from sb3_piano.planning.posture import resting_posture
from sb3_piano.planning.presses import presses_of_hand
from sb3_piano.planning.problems import Problem, unmovable, unreached
from sb3_piano.planning.settings import PlanSettings
from sb3_piano.planning.smoothness import Smoothness
from sb3_piano.planning.tracking_control import TrackingControl
from sb3_piano.simulation import PianoScene

FloatArray = npt.NDArray[np.float64]

_UP = 2


class HandPlanner:
    """Knows what a hand has to do, and collects how it does it.

    Args:
        roll: The piece, all notes with fingers.
        scene: The piano and the hands.
        hand: 0 for the right hand, 1 for the left one.
        keys: The keyboard.
        settings: The plan's constants.
        n_substeps: Physics steps in a control step.
    """

    def __init__(
        self,
        roll: PianoRoll,
        scene: PianoScene,
        hand: int,
        keys: KeyPlaces,
        settings: PlanSettings,
        n_substeps: int,
    ):
        self._roll, self._scene, self._keys, self._settings = roll, scene, keys, settings
        self.kinematics = HandKinematics(scene, hand)
        self.posture = resting_posture(self.kinematics, keys, settings)
        sign = self.kinematics.sign
        n_states, size = len(roll) + 1, self.kinematics.size
        self.take(time_presses(presses_of_hand(roll, hand), sign, keys, settings))
        self._dynamics = HandDynamics.of(scene, self.kinematics, self.posture.rest, n_substeps)
        self._start = np.zeros(2 * size)
        self.planned = np.zeros((n_states, size))
        """(T + 1, n) where they would be if they had no inertia."""
        self.positions = np.zeros((n_states, size))
        """(T + 1, n) where the hand's actuators should be."""
        self.commands = np.zeros((n_states - 1, size))
        """(T, n) what they are told for that."""
        self.gains = np.zeros((n_states - 1, size, size), dtype=np.float32)
        """(T, n, n) feedback."""

    def take(self, timed: list[TimedPress]) -> None:
        """Take over when and how keys are pressed."""
        kinematics = self.kinematics
        self.timed = timed
        """The presses as they are planned."""
        self.frames = key_frames(
            timed,
            kinematics.sign,
            len(self._roll) + 1,
            kinematics.radius,
            self._keys,
            self._settings,
        )
        """Targets of the fingertips, by state."""

    def begin(
        self, start: int, stop: int, bound: FloatArray, wanted: FloatArray | None
    ) -> HandProblem:
        """Return the problem of a stretch.

        Args:
            start: Its first state, 1 or more.
            stop: The state after its last.
            bound: Beyond which the arm must be, m.
            wanted: Where the hand would be if it were alone, m; ``None`` to start from the last
                plan.
        """
        if start == 1:
            self._start = np.zeros_like(self._start)
        kinematics = self.kinematics
        cost = HandCost(kinematics, self.frames.between(start, stop), self._settings, bound)
        before = self.planned[[max(start - 2, 0), start - 1]]
        smoothness = Smoothness(kinematics, self._settings, before, stop - start)
        guess = self.planned[start:stop].copy() if wanted is None else self._guess(wanted, bound)
        return HandProblem(cost, smoothness, self.posture, self._settings, guess)

    def _guess(self, wanted: FloatArray, bound: FloatArray) -> FloatArray:
        """Return the resting posture wherever the hand has to be, (s, n)."""
        kinematics = self.kinematics
        guess = np.tile(self.posture.rest, (len(wanted), 1))
        place = kinematics.sign * np.maximum(kinematics.sign * wanted, kinematics.sign * bound)
        guess[:, kinematics.index("forearm_tx")] = kinematics.slider_for_arm(place)
        return guess

    def finish(self, problem: HandProblem, start: int, keep: int) -> None:
        """Take over the first states of a stretch, now with the hand's inertia.

        Args:
            problem: The stretch, solved.
            start: Its first state.
            keep: The state after the last one to be kept.
        """
        planned = problem.positions
        control = TrackingControl(
            problem.cost,
            self._dynamics,
            planned,
            self._key_forces(planned, start),
            self._start,
            self._settings,
        ).solve()
        count = keep - start
        self.planned[start:keep] = planned[:count]
        self.positions[start:keep] = control.states[:count, : self.kinematics.size]
        self.commands[start - 1 : keep - 1] = control.commands[:count]
        self.gains[start - 1 : keep - 1] = control.gains[:count]
        self._start = control.states[count - 1]

    def fingertips(self) -> FloatArray:
        """Return where the fingertips are planned to be, (T + 1, 5, 3) m."""
        return self.kinematics.fingertips(self.positions)

    def problems(self) -> list[Problem]:
        """Return what the hand cannot do."""
        hand, timestep = self.kinematics.hand, self._roll.control_timestep
        tips = self.kinematics.fingertips(self.planned)
        found = unmovable(self.timed, hand, self._scene.moving_keys, timestep)
        return found + unreached(self.timed, hand, self.frames, tips, timestep)

    def _key_forces(self, positions: FloatArray, start: int) -> FloatArray:
        """Return the forces on the actuators of keys that are held, (s, n)."""
        settings, keys = self._settings, self._keys
        tips, jacobian = self.kinematics.fingertips_and_jacobian(positions)
        forces = np.zeros_like(positions)
        for one in self.timed:
            key, finger = one.press.key, one.press.finger
            first, stop = max(one.first - start, 0), min(one.last + 1 - start, len(positions))
            if first >= stop:
                continue
            firmness = settings.press_force_thumb if finger == THUMB else settings.press_force
            torque = keys.holding_torque[key]
            lever = tips[first:stop, finger, 0] - keys.hinge[key]
            force = one.adjustment.firmness * firmness * torque / lever
            forces[first:stop] += force[:, None] * jacobian[first:stop, finger, _UP]
        return forces
