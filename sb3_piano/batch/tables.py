"""Pieces as tables of tensors, one row for each control step."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import torch

from sb3_piano.arrays import Arrays
from sb3_piano.batch.worlds import Tensor
from sb3_piano.envs.goal import Goal
from sb3_piano.metrics.onsets import ONSET_TOLERANCE
from sb3_piano.music import PianoRoll
from sb3_piano.music.constants import NUM_KEYS


class Pieces:
    """P concatenated pieces: due keys, and the score's part of the observations.

    ``first[p] + t`` is the row of control step t of piece p.

    Args:
        goals: Goals of the pieces.
        tables: Precomputed part of each piece's observations, see
            :meth:`~sb3_piano.envs.encodings.Encoding.tables`.
        like: Tensor with the device and dtype of the tables.
    """

    def __init__(self, goals: Sequence[Goal], tables: Sequence[Arrays], like: Tensor):
        self.goals = tuple(goals)
        self._like = like
        music = [_music(goal) for goal in goals]
        rows = [
            max(len(rows) for rows in (*own.values(), *known.values()))
            for own, known in zip(music, tables, strict=True)
        ]
        self.length = self._tensor(np.array([len(goal) for goal in goals]))
        """(P,) control steps."""
        self.first = self._tensor(np.concatenate([[0], np.cumsum(rows)[:-1]]))
        """(P,) row of the first control step."""
        own = self._stacked(music, rows)
        self.due, self.sustain, self.target = own["due"], own["sustain"], own["target"]
        """(R, 88), (R,) keys and pedal asked for; (R, 88) keys that the metrics compare."""
        self.due_key, self.due_share = own["due_key"], own["due_share"]
        """(R, d) keys of ``due``, and the weight of each in their mean; 0 for unused entries."""
        self.target_sustain = own["target_sustain"]
        """(R,) whether the pedal should be down."""
        self.key, self.finger, self.share = own["key"], own["finger"], own["share"]
        """(R, k) due keys with a labelled finger, their fingers, weights in their mean likewise."""
        self.hand = own["hand"]
        """(R, 88) hand labelled for each key, -1 if none."""
        self.known = self._stacked(tables, rows)
        """Precomputed part of the observations, by name."""
        self.onsets = Onsets([goal.roll for goal in goals], rows, like)

    def _tensor(self, array: npt.NDArray[np.generic]) -> Tensor:
        made = torch.from_numpy(np.ascontiguousarray(array)).to(self._like.device)
        return made.to(self._like.dtype) if made.dtype == torch.float64 else made

    def _stacked(self, pieces: Sequence[Arrays], rows: Sequence[int]) -> dict[str, Tensor]:
        """Concatenate tables by name, each padded to its number of rows."""
        stacked = {}
        for name in pieces[0]:
            tables = _as_wide([piece[name] for piece in pieces])
            filled = [
                np.pad(table, [(0, count - len(table)), *[(0, 0)] * (table.ndim - 1)])
                for table, count in zip(tables, rows, strict=True)
            ]
            stacked[name] = self._tensor(np.concatenate(filled))
        return stacked


class Onsets:
    """Strikes due in each piece, and which of them are open in each world.

    The batched form of :class:`~sb3_piano.metrics.onsets.OpenOnsets`.
    """

    def __init__(self, rolls: Sequence[PianoRoll], rows: Sequence[int], like: Tensor):
        strikes = [list(roll.strikes()) for roll in rolls]
        self.count = torch.tensor([len(one) for one in strikes], device=like.device)
        """(P,) strikes of each piece."""
        most = max(map(len, strikes))
        time = np.full((len(rolls), most + 1), np.inf)  # the last entry means none
        near = [
            _near(roll, one, count, most)
            for roll, one, count in zip(rolls, strikes, rows, strict=True)
        ]
        for own, one in zip(time, strikes, strict=True):
            own[: len(one)] = [when for _, _, when in one]
        self.time = torch.from_numpy(time).to(like)
        """(P, m + 1) times, s."""
        candidates = np.concatenate(_as_wide(near, most))
        self.candidates = torch.from_numpy(candidates).to(like.device)
        """(R, 88, c) each key's onsets that a strike in the control step may match."""

    def begun(self, count: int) -> Tensor:
        """Return that all strikes of N new episodes are open, (N, m + 1) bool."""
        still_open = torch.ones((count, self.time.shape[1]), dtype=torch.bool)
        still_open[:, -1] = False
        return still_open.to(self.time.device)


def _music(goal: Goal) -> Arrays:
    asked, steps = goal.asked, goal.steps
    most = max([len(step.labelled) for step in steps] + [1])
    pairs = np.full((len(steps), most, 2), -1)
    for row, step in zip(pairs, steps, strict=True):
        row[: len(step.labelled)] = np.array(step.labelled).reshape(-1, 2)
    # Due keys first: a stable sort of whether each key is not due.
    counts = asked.active.sum(axis=1)
    due_key = np.argsort(~asked.active, axis=1, kind="stable")[:, : max(int(counts.max()), 1)]
    return {
        "due": asked.active,
        "due_key": due_key,
        "due_share": _shares(np.arange(due_key.shape[1]) < counts[:, None]),
        "sustain": asked.sustain,
        "target": goal.roll.active,
        "target_sustain": goal.roll.sustain,
        "key": np.maximum(pairs[..., 0], 0),
        "finger": np.maximum(pairs[..., 1], 0),
        "share": _shares(pairs[..., 0] >= 0),
        "hand": np.where(asked.finger >= 0, asked.finger // 5, -1).astype(np.int8),
    }


def _shares(there: npt.NDArray[np.bool_]) -> npt.NDArray[np.float64]:
    """Return weights with which a sum along the last axis is the mean of the entries there."""
    return there / np.maximum(there.sum(axis=-1, keepdims=True), 1)


def _near(
    roll: PianoRoll, strikes: list[tuple[int, int, float]], rows: int, none: int
) -> npt.NDArray[np.int32]:
    """Return the strikes within the tolerance, by control step and key, (rows, 88, c)."""
    length = roll.control_timestep
    found: dict[tuple[int, int], list[int]] = {}
    for number, (_, key, time) in enumerate(strikes):
        first = math.floor((time - ONSET_TOLERANCE) / length) - 1
        last = math.ceil((time + ONSET_TOLERANCE) / length)
        for step in range(max(first, 0), min(last, len(roll) - 1) + 1):
            found.setdefault((step, key), []).append(number)
    most = max(map(len, found.values()), default=1)
    near = np.full((rows, NUM_KEYS, most), none, dtype=np.int32)
    for (step, key), numbers in found.items():
        near[step, key, : len(numbers)] = numbers
    return near


def _as_wide(
    tables: Sequence[npt.NDArray[np.generic]], fill: int = 0
) -> list[npt.NDArray[np.generic]]:
    """Pad the last axes of tables to the longest."""
    widest = max(table.shape[-1] for table in tables)
    return [
        table
        if table.ndim == 1 or table.shape[-1] == widest
        else np.pad(
            table,
            [*[(0, 0)] * (table.ndim - 1), (0, widest - table.shape[-1])],
            constant_values=fill,
        )
        for table in tables
    ]
