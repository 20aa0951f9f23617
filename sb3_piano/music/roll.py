"""The piano roll: a score divided into control steps."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Gt, Lt
from numpy.typing import ArrayLike, NDArray

from sb3_piano.exceptions import ScoreError
from sb3_piano.music.constants import DEFAULT_VELOCITY, NUM_FINGERS, NUM_KEYS, UNKNOWN_FINGER
from sb3_piano.music.score import Score
from sb3_piano.settings import Number, Unit, checked

_TYPES = {
    "active": bool,
    "finger": np.int8,
    "onset": bool,
    "sustain": bool,
    "onset_time": float,
    "onset_velocity": np.int8,
}
"""The arrays of a roll with the types of their elements."""

_MAX_STEPS = 1_000_000
"""Longest grid, in control steps: 13.9 hours at 0.05 s, 260 MB. Longer ones are broken files."""

_S = Unit("s")
_Timestep = Annotated[Number, Gt(0), _S]

_DECIMALS = 6
"""Decimals of a time in steps: 0.15 s / 0.05 s is 2.9999999999999996, meant as 3."""


@dataclass(frozen=True, kw_only=True)
class EarlyRelease:
    """A note that its hand releases early, or skips, to play another."""

    key: int
    """0 to 87."""
    finger: int
    """The note's finger, 0 to 9."""
    onset: int
    """Its first control step."""
    offset: int
    """The control step after its last one."""
    release: int
    """First control step without the finger; ``onset`` if the note is skipped."""
    for_key: int
    """The key that the hand plays instead, 0 to 87."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PianoRoll:
    """Keys and pedal due at each of T control steps. All arrays are read-only copies.

    A note fills the steps floor(onset / dt) to ceil(offset / dt) - 1, at least one. T is
    floor(duration / dt) + 1, so a piece that ends on a step is followed by one silent step. Notes
    are laid in order of onset; a later note overwrites the finger labels of an earlier one on its
    key.

    A key may be struck again while it sounds, or at the step at which it would fall silent. It is
    then silent for the first step of the new note, so that the second strike is visible. If the
    earlier note outlasts the new one, the rest of it keeps its own label.

    Source: RoboPianist's note trajectory, with one difference: RoboPianist erases a new note that
    lasts a single step. Here the silent step is then the last one before the new note. If the
    earlier strike has sounded for that one step only, the two merge into one. So do two strikes of
    one key within one step.

    Attributes:
        control_timestep: Length of a step, dt, in s.
        active: (T, 88) bool, whether the key is due.
        finger: (T, 88) int8, the finger label (0-9) of the sounding note, -1 without one.
        onset: (T, 88) bool, the first active step of each strike.
        onset_time: (n,) due time of each of the n strikes, in s, ordered by step, then key: the
            onset of its note, but no earlier than the strike's first step. By default, the
            beginning of the first step of each strike.
        onset_velocity: (n,) int8, the MIDI velocity of each of these strikes; by default 80.
        sustain: (T,) bool, whether the sustain pedal is due: from step
            floor(onset / dt) until before step floor(offset / dt).
        early_releases: Notes without a finger label in some or all of their steps, as the hands
            cannot hold them beside others.
    """

    control_timestep: float
    active: NDArray[np.bool_]
    finger: NDArray[np.int8]
    onset: NDArray[np.bool_]
    sustain: NDArray[np.bool_]
    onset_time: NDArray[np.float64] = None  # type: ignore[assignment]  # never None once made
    onset_velocity: NDArray[np.int8] = None  # type: ignore[assignment]  # the same
    early_releases: tuple[EarlyRelease, ...] = ()

    def __post_init__(self) -> None:
        checked("control_timestep", self.control_timestep, _Timestep)
        if self.onset_time is None:
            times = np.nonzero(self.onset)[0] * self.control_timestep
            object.__setattr__(self, "onset_time", times)
        if self.onset_velocity is None:
            velocities = np.full(len(self.onset_time), DEFAULT_VELOCITY)
            object.__setattr__(self, "onset_velocity", velocities)
        for name, kind in _TYPES.items():
            object.__setattr__(self, name, np.array(getattr(self, name), dtype=kind))
        steps = self.active.shape[0] if self.active.ndim else 0
        for name, expected in {
            **dict.fromkeys(("active", "finger", "onset"), (steps, NUM_KEYS)),
            "sustain": (steps,),
            **dict.fromkeys(("onset_time", "onset_velocity"), (int(np.count_nonzero(self.onset)),)),
        }.items():
            shape = getattr(self, name).shape
            if shape != expected:
                raise ScoreError(f"Array {name!r} has shape {shape}: expected {expected}.")
        self._lock()

    @classmethod
    def from_score(
        cls, score: Score, control_timestep: float, initial_buffer_time: float = 0.0
    ) -> PianoRoll:
        """Divide a score into control steps.

        Args:
            score: The piece.
            control_timestep: Length of a step, in s, finite and above 0.
            initial_buffer_time: Initial silence, in s, finite and at least 0; rounded to whole
                steps.

        Raises:
            ConfigError: If one of the times is out of range.
            ScoreError: If the roll would have more than a million steps.
        """
        checked("control_timestep", control_timestep, _Timestep)
        longest = Lt(_MAX_STEPS * control_timestep)
        checked("initial_buffer_time", initial_buffer_time, Annotated[Number, Ge(0), longest, _S])
        lead = round(initial_buffer_time / control_timestep)
        if not lead + score.duration / control_timestep < _MAX_STEPS:
            raise ScoreError(
                f"Score {score.title!r} lasts {score.duration:g} s, too long for control steps of "
                f"{control_timestep:g} s: expected fewer than {_MAX_STEPS} steps."
            )
        steps = lead + int(floor_steps(score.duration, control_timestep)) + 1
        starts = lead + floor_steps([note.onset for note in score.notes], control_timestep)
        ends = lead + _ceil_steps([note.offset for note in score.notes], control_timestep)
        sustain = np.zeros(steps, dtype=bool)
        pedals = [(pedal.onset, pedal.offset) for pedal in score.pedals]
        for down, up in (lead + floor_steps(pedals, control_timestep)).reshape(-1, 2).tolist():
            sustain[down:up] = True
        sheet = _Sheet(steps)
        due: dict[tuple[int, int], tuple[float, int]] = {}
        for note, start, end in zip(score.notes, starts.tolist(), ends.tolist(), strict=True):
            first = sheet.lay(note.key, start, max(end, start + 1), note.finger)
            if first is not None:
                time = max(lead * control_timestep + note.onset, first * control_timestep)
                # Of two in one step the first one counts.
                due.setdefault((first, note.key), (time, note.velocity))
        strikes = [due[step, key] for step, key in np.argwhere(sheet.onset).tolist()]
        return cls(
            control_timestep=control_timestep,
            active=sheet.active,
            finger=sheet.finger,
            onset=sheet.onset,
            sustain=sustain,
            onset_time=np.array([time for time, _ in strikes]),
            onset_velocity=np.array([velocity for _, velocity in strikes]),
        )

    def __len__(self) -> int:
        return len(self.active)

    def __repr__(self) -> str:
        strikes = np.count_nonzero(self.onset)
        return f"PianoRoll({len(self)} steps of {self.control_timestep:g} s, {strikes} strikes)"

    def __setstate__(self, state: dict[str, Any]) -> None:
        # Pickling and deep-copying make arrays writable.
        self.__dict__.update(state)
        self._lock()

    @property
    def duration(self) -> float:
        """Length of all steps together, in s."""
        return len(self) * self.control_timestep

    @functools.cached_property
    def velocity(self) -> NDArray[np.int8]:
        """(T, 88) MIDI velocity of each strike in its first step, 0 elsewhere."""
        velocity = np.zeros(self.onset.shape, dtype=np.int8)
        velocity[self.onset] = self.onset_velocity
        return velocity

    @property
    def used_keys(self) -> list[int]:
        """Keys, 0 to 87, that are due in any step, ascending."""
        return list(map(int, np.flatnonzero(self.active.any(axis=0))))

    @property
    def unlabelled(self) -> NDArray[np.bool_]:
        """Due keys without a finger label, except notes released early, (T, 88) bool."""
        missing = self.active & (self.finger < 0)
        for one in self.early_releases:
            missing[one.release : one.offset, one.key] = False
        return missing

    def equals(self, other: PianoRoll) -> bool:
        """Return whether two rolls have equal content; ``==`` compares identity."""
        return self.control_timestep == other.control_timestep and all(
            np.array_equal(getattr(self, name), getattr(other, name)) for name in _TYPES
        )

    def labelled_fingers(self) -> NDArray[np.bool_]:
        """Return the fingers that should press at each step, by their labels, (T, 10) bool."""
        fingers = np.zeros((len(self), NUM_FINGERS), dtype=bool)
        steps, keys = np.nonzero(self.active & (self.finger >= 0))
        fingers[steps, self.finger[steps, keys]] = True
        return fingers

    def a_step_earlier(self) -> PianoRoll:
        """Shift all keys, but not the pedal, by one control step to an earlier time.

        A note in the first step loses that step; a note of only that step is lost.
        """
        time = np.zeros(self.onset.shape)
        time[self.onset] = self.onset_time
        time, finger = np.roll(time, -1, axis=0), np.roll(self.finger, -1, axis=0)
        active, onset = np.roll(self.active, -1, axis=0), np.roll(self.onset, -1, axis=0)
        active[-1], onset[-1], finger[-1] = False, False, UNKNOWN_FINGER
        onset[0] |= self.onset[0] & active[0]
        velocity = np.roll(self.velocity, -1, axis=0)
        velocity[0] = np.where(velocity[0] > 0, velocity[0], self.velocity[0])
        return replace(
            self,
            active=active,
            finger=finger,
            onset=onset,
            onset_time=np.maximum(time[onset] - self.control_timestep, 0.0),
            onset_velocity=velocity[onset],
            early_releases=tuple(
                replace(
                    one,
                    onset=max(one.onset - 1, 0),
                    offset=max(one.offset - 1, 0),
                    release=max(one.release - 1, 0),
                )
                for one in self.early_releases
            ),
        )

    def strikes(self) -> list[tuple[int, int, float]]:
        """List the control step, the key and the time (s) of each strike, in order."""
        pairs = zip(np.argwhere(self.onset).tolist(), self.onset_time.tolist(), strict=True)
        return [(step, key, time) for (step, key), time in pairs]

    def due(self, step: int) -> tuple[NDArray[np.intp], NDArray[np.int8]]:
        """Return the keys due at a step, and their fingers.

        Args:
            step: A control step, 0 to T - 1.

        Returns:
            The n due keys (0-87, ascending), and their n finger labels (-1 unlabelled).

        Raises:
            IndexError: If the roll has no such step.
        """
        if not 0 <= step < len(self):
            raise IndexError(f"Step {step} is outside the roll: expected 0 to {len(self) - 1}.")
        keys = np.flatnonzero(self.active[step])
        return keys, self.finger[step, keys]

    def _lock(self) -> None:
        for name in _TYPES:
            getattr(self, name).flags.writeable = False


class _Sheet:
    """The arrays of a roll under construction; notes are laid in order of onset."""

    def __init__(self, steps: int) -> None:
        self.active = np.zeros((steps, NUM_KEYS), dtype=bool)
        self.finger = np.full((steps, NUM_KEYS), UNKNOWN_FINGER, dtype=np.int8)
        self.onset = np.zeros((steps, NUM_KEYS), dtype=bool)
        self._last_onset = [-1] * NUM_KEYS

    def lay(self, key: int, start: int, end: int, finger: int) -> int | None:
        """Let `key` sound from step `start` until before `end`, as a new strike if possible.

        The step before a note decides whether it is a new strike; `first` is the step at which that
        strike becomes audible.

        Returns:
            The first step of the strike, or None if the note is no new strike.
        """
        last = self._last_onset[key]
        first, strikes, silent = start, True, None
        if start < last:
            # A strike at this step was laid before, and its silent step is this one.
            first, strikes = last, False
        elif start > 0 and self.active[start - 1, key]:
            if end - start > 1:
                first, silent = start + 1, start
            elif start - 1 > last:
                silent = start - 1
            else:
                strikes = False
        if silent is not None:
            self.active[silent, key] = False
            self.finger[silent, key] = UNKNOWN_FINGER
        self.active[first:end, key] = True
        self.finger[first:end, key] = finger
        if not strikes:
            return None
        self.onset[first, key] = True
        self._last_onset[key] = first
        return first


def floor_steps(times: ArrayLike, control_timestep: float) -> NDArray[np.int64]:
    """Return the steps of the given times (s); `_MAX_STEPS` for times beyond."""
    return np.floor(_in_steps(times, control_timestep)).astype(np.int64)


def _ceil_steps(times: ArrayLike, control_timestep: float) -> NDArray[np.int64]:
    """Return the first steps that begin at or after the given times (s)."""
    return np.ceil(_in_steps(times, control_timestep)).astype(np.int64)


def _in_steps(times: ArrayLike, control_timestep: float) -> NDArray[np.float64]:
    """Convert times (s) to multiples of the control time step, without rounding noise."""
    multiples = np.round(np.asarray(times, dtype=float) / control_timestep, _DECIMALS)
    return np.minimum(multiples, _MAX_STEPS)
