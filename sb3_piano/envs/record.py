"""Record of an episode (keys, pedal, fingertips, rewards), and saved states."""

from __future__ import annotations

import copy
import operator
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from numbers import Integral, Real
from typing import Any, NamedTuple

import numpy as np

from sb3_piano.arrays import BoolArray, FloatArray, IntArray
from sb3_piano.envs.goal import Goal
from sb3_piano.exceptions import EnvStateError
from sb3_piano.metrics import Presses, frame_f1, presses_of
from sb3_piano.metrics.episode import RETURN_PREFIX, normalized_return
from sb3_piano.metrics.fingers import KeyBoxes, nearest_fingers
from sb3_piano.metrics.onsets import OpenOnsets
from sb3_piano.metrics.presses import press_times, step_shares, strike_speeds
from sb3_piano.music import Score
from sb3_piano.music.constants import NUM_FINGERS, NUM_KEYS, UNKNOWN_FINGER
from sb3_piano.performance import Performance
from sb3_piano.simulation import PianoScene, Simulation

# Most physics steps kept as key angles, which take eight times the memory of booleans.
_MANY = 2000

Late = tuple[tuple[FloatArray, float], ...]
"""Actuators' targets and pedal of delayed actions, the next one first."""


@dataclass(frozen=True, eq=False, kw_only=True)
class EnvState:
    """Picklable copy of physics and episode progress, from ``PianoEnv.get_state``."""

    physics: FloatArray
    """MuJoCo's integration state."""
    score: Score
    """Score of the episode before the environment applied a fingering."""
    finished: bool
    """Whether the episode has ended."""
    pedal: float
    """The pedal's command in [0, 1]."""
    key_active: BoolArray
    """(step, 88) bool, keys sounding after each control step."""
    sustain: BoolArray
    """(step,) bool, whether the pedal was down."""
    fingertips: FloatArray
    """(step, 10, 3) positions of the fingertips after each control step, m."""
    within: Mapping[int, BoolArray]
    """By control step in which a key went down or up: (p, 88) bool, keys sounding after each of its
    p physics steps."""
    returns: FloatArray
    """(n,) sums of the n weighted reward terms so far."""
    speeds: Mapping[int, FloatArray] = field(default_factory=dict)
    """By the same control steps: (88,) speeds of keys going down, rad/s; empty in states saved
    without them."""
    simulation: str = ""
    """Options of the physics as text; empty in states saved without them."""
    terms: str = ""
    """Names of the reward terms as text; empty in states saved without them."""
    late: Late = ()

    def check(self, simulation: str, terms: Sequence[str]) -> None:
        """Raise an EnvStateError if the state is not from an environment with these options."""
        steps = len(self.key_active) if isinstance(self.key_active, np.ndarray) else 0
        within, speeds = (
            table if isinstance(table, Mapping) else {-1: None}
            for table in (self.within, self.speeds)
        )
        substeps = getattr(next(iter(within.values()), None), "shape", ())[:1]

        def fits(array: Any, kind: str, *shape: int) -> bool:
            return getattr(array, "shape", None) == shape and array.dtype.kind == kind

        parts = {
            "key_active": fits(self.key_active, "b", steps, NUM_KEYS),
            "sustain": fits(self.sustain, "b", steps),
            "fingertips": fits(self.fingertips, "f", steps, NUM_FINGERS, 3),
            "returns": fits(self.returns, "f", len(terms)),
            **{f"within[{n!r}]": fits(w, "b", *substeps, NUM_KEYS) for n, w in within.items()},
            **{f"speeds[{n!r}]": n in within and fits(v, "f", NUM_KEYS) for n, v in speeds.items()},
            "score": isinstance(self.score, Score),
            "finished": isinstance(self.finished, bool),
            "pedal": isinstance(self.pedal, Real) and 0 <= self.pedal <= 1,
            "simulation": isinstance(self.simulation, str),
            "terms": isinstance(self.terms, str),
            "late": isinstance(self.late, tuple) and all(len(pair) == 2 for pair in self.late),
            "within": all(isinstance(n, Integral) and 0 <= n < steps for n in within),
        }
        wrong = [name for name, is_right in parts.items() if not is_right]
        if wrong:
            raise EnvStateError(
                f"The state's {wrong[0]} is none of an episode of {steps} steps: expected a state "
                "of an environment with the same options."
            )
        for saved, here in ((self.simulation, simulation), (self.terms, _told(terms))):
            if saved not in ("", here):
                raise EnvStateError(
                    f"The state was saved with {saved}, but here is {here}: expected a state of an "
                    "environment with the same options."
                )

    @property
    def step(self) -> int:
        """Number of finished control steps."""
        return len(self.key_active)


def _told(terms: Sequence[str]) -> str:
    return f"the reward terms {', '.join(terms)}"


class Snapshot(NamedTuple):
    """State of an episode, from ``PianoEnv.snapshot``, for that environment and its copies."""

    physics: FloatArray
    """MuJoCo's integration state."""
    record: EpisodeRecord
    """The record so far."""
    finished: bool
    """Whether the episode has ended."""
    pedal: float
    """The pedal's command in [0, 1]."""
    late: Late
    total_steps: int
    """Control steps of the environment since it was made."""


class EpisodeRecord:
    """Record of an episode, which grows by one control step at a time."""

    def __init__(self, goal: Goal, scene: PianoScene):
        """Begin an empty record."""
        self._goal, self._scene = goal, scene
        # Lists with an entry for each step: appending is faster than filling rows of an array.
        self._key_active: list[bytes] = []
        self._sustain: list[bool] = []
        self._fingertips: list[FloatArray] = []
        self._sounding = bytes(NUM_KEYS)  # after the last step; bytes compare fastest
        # Steps in which a key changed, the keys that sounded after each of their physics steps, and
        # the speeds of the keys that went down.
        self._changes: list[int] = []
        self._within = np.zeros((0, 1, NUM_KEYS), dtype=bool)
        self._speeds = np.zeros((0, NUM_KEYS))
        self._returns = [0.0] * len(goal.terms)
        self._open = OpenOnsets(goal.roll)
        self.struck = (0, 0)
        """Strikes of the last step given to :meth:`hear`: in time, and others."""
        self.hit_keys: list[int] = []
        """Keys of those in time."""
        # Not yet added to `_within` and `_returns`: adding many steps at once is faster.
        self._key_angles: list[bytes] = []
        self._weighted_terms: list[Sequence[float]] = []

    @property
    def steps(self) -> int:
        """Number of finished control steps."""
        return len(self._sustain)

    def hear(self, simulation: Simulation) -> None:
        """Count the strikes in a control step before it is added.

        Strikes and their times are the same as in the metrics.
        """
        self.struck, self.hit_keys = (0, 0), []
        if simulation.sounding == self._sounding:
            return
        keys = [key for key, now in enumerate(simulation.sounding) if now > self._sounding[key]]
        self.hit_keys = [key for key in keys if self._is_hit(key, simulation)]
        self.struck = len(self.hit_keys), len(keys) - len(self.hit_keys)

    def _is_hit(self, key: int, simulation: Simulation) -> bool:
        step, timestep = self.steps, self._goal.roll.control_timestep
        # The time within the step rarely matters, and takes ten times as long to compute.
        is_hit = self._open.hit_within(key, step * timestep, (step + 1) * timestep)
        if is_hit is not None:
            return is_hit
        within, steps = self._scene.sounding_at(simulation.key_angles)[None], np.array([step])
        share = step_shares(steps, np.array([key]), steps, within)
        return self._open.hit(key, ((steps + share) * timestep).item())

    def add(
        self, simulation: Simulation, pedal_down: bool, weighted_terms: Sequence[float]
    ) -> None:
        """Add a control step, read at its end; terms are in the order of the goal's."""
        sounding = simulation.sounding
        if sounding != self._sounding:
            self._changes.append(len(self._sustain))
            self._key_angles += (simulation.key_angles_before, *simulation.key_angles)
            self._sounding = sounding
            if len(self._key_angles) > _MANY:
                self._sounding_within()
        self._key_active.append(sounding)
        self._sustain.append(pedal_down)
        self._fingertips.append(simulation.fingertips)
        self._weighted_terms.append(weighted_terms)

    def f1(self) -> float | None:
        """Compute the F1 of the steps so far; ``None`` before the first step."""
        if not self.steps:
            return None
        return frame_f1(self._goal.roll.active[: self.steps], self._rows())

    def performance(self) -> Performance:
        """Return the performance so far, as a copy."""
        roll, (key_active, sustain, fingertips) = self._goal.roll, self._arrays()
        presses, changes = presses_of(key_active), np.array(self._changes, dtype=np.intp)
        within = self._sounding_within()
        strikes, releases = press_times(presses, changes, within, roll.control_timestep, self.steps)
        fingers = np.full(key_active.shape, UNKNOWN_FINGER, dtype=np.int8)
        if self._scene.sides:
            fingers = nearest_fingers(key_active, fingertips, KeyBoxes(*self._scene.key_boxes))
        return Performance(
            roll=roll,
            key_active=key_active,
            sustain=sustain,
            strike_time=strikes,
            strike_speed=self._strike_speeds(presses, changes),
            release_time=releases,
            press_finger=fingers,
            title=self._goal.score.title,
            score=self._goal.timed_score,
        )

    def summary(self) -> dict[str, float]:
        """Compute the music metrics and the returns by name, as in the final ``info``."""
        returns, performance = self._sums(), self.performance()
        return {
            **performance.metrics(),
            **(performance.musicianship() if self._goal.musicianship else {}),
            "normalized_return": normalized_return(sum(returns), self._goal.highest_return),
            **{RETURN_PREFIX + n: sum_ for n, sum_ in zip(self._goal.terms, returns, strict=True)},
        }

    def save(self, simulation: str, **own: Any) -> EnvState:
        """Return a state of the episode so far, with the environment's own values."""
        key_active, sustain, fingertips = self._arrays()
        return EnvState(
            **own,
            score=self._goal.source,
            key_active=key_active,
            sustain=sustain,
            fingertips=fingertips,
            within=dict(zip(self._changes, self._sounding_within(), strict=True)),
            returns=np.array(self._sums()),
            simulation=simulation,
            terms=_told(self._goal.terms),
            speeds=dict(zip(self._changes, self._speeds, strict=True)),
        )

    def fork(self) -> EpisodeRecord:
        """Return an independent copy of the record; it shares the data of finished steps."""
        copied, own = copy.copy(self), vars(self).items()
        copied.__dict__.update({name: [*value] for name, value in own if isinstance(value, list)})
        copied._open = self._open.copy()
        return copied

    def restore(self, state: EnvState) -> None:
        """Restore the steps of a saved state."""
        self._key_active = [keys.tobytes() for keys in state.key_active]
        self._sustain = state.sustain.tolist()
        self._fingertips = list(state.fingertips.copy())
        self._changes = list(state.within)
        if state.within:
            self._within = np.stack(list(state.within.values()))
            unknown = np.full(NUM_KEYS, np.nan)
            self._speeds = np.stack([state.speeds.get(step, unknown) for step in state.within])
        if self._key_active:
            self._sounding = self._key_active[-1]
        self._returns = state.returns.tolist()
        played = self.performance()
        strikes = zip(played.presses.key.tolist(), played.strike_time.tolist(), strict=True)
        for key, time in strikes:  # of one key in order of time
            self._open.hit(key, time)

    def _sounding_within(self) -> BoolArray:
        """Return the keys sounding after the p physics steps of the m ``_changes``, (m, p, 88)."""
        if self._key_angles:
            former, steps = self._within, len(self._changes) - len(self._within)
            angles = self._scene.angles_of(self._key_angles).reshape(steps, -1, NUM_KEYS)
            within = angles[:, 1:] >= self._scene.key_sounding_angle
            n_substeps = within.shape[1]
            speeds = strike_speeds(angles, within) * (n_substeps / self._goal.roll.control_timestep)
            self._within = np.concatenate([former, within]) if len(former) else within
            self._speeds = np.concatenate([self._speeds, speeds])
            self._key_angles = []
        return self._within

    def _strike_speeds(self, presses: Presses, changes: IntArray) -> FloatArray:
        """Return the downward key speed of each press, rad/s; NaN if not known."""
        if len(changes) == 0:
            return np.full(len(presses.key), np.nan)
        row = np.minimum(np.searchsorted(changes, presses.first), len(changes) - 1)
        known = changes[row] == presses.first
        return np.where(known, self._speeds[row, presses.key], np.nan)

    def _sums(self) -> list[float]:
        """Sum the weighted terms, step by step."""
        for weighted in self._weighted_terms:
            self._returns = list(map(operator.add, self._returns, weighted))
        self._weighted_terms = []
        return self._returns

    def _rows(self) -> BoolArray:
        """Return a copy of the keys that sounded, (t, 88)."""
        rows = np.frombuffer(b"".join(self._key_active), dtype=bool)
        return rows.reshape(self.steps, NUM_KEYS).copy()

    def _arrays(self) -> tuple[BoolArray, BoolArray, FloatArray]:
        """Return copies of sounding keys (t, 88), pedal (t,) and fingertips (t, 10, 3)."""
        tips = np.concatenate([np.empty((0, 3)), *self._fingertips])
        sustain = np.array(self._sustain, dtype=bool)
        return self._rows(), sustain, tips.reshape(self.steps, NUM_FINGERS, 3)
