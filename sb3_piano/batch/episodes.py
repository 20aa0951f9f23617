"""Episode metrics of many worlds, equal to those of a single environment."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np
import torch

from sb3_piano.arrays import BoolArray
from sb3_piano.batch.tables import Pieces
from sb3_piano.batch.task import Heard
from sb3_piano.batch.worlds import Tensor, Worlds
from sb3_piano.envs.record import EnvState, EpisodeRecord
from sb3_piano.metrics.episode import RETURN_PREFIX, normalized_return
from sb3_piano.music.constants import NUM_KEYS


class Sums:
    """Sums over an episode: F1 and returns, N numbers of each."""

    def __init__(self, pieces: Pieces, worlds: Worlds, heard: Heard, terms: Sequence[str]):
        self._pieces, self._heard, self._terms = pieces, heard, tuple(terms)
        new = worlds.qpos.new_zeros
        self.returns = new(worlds.count, len(terms))
        """(N, n) sums of the weighted terms."""
        self.earned = new(worlds.count)
        """(N,) sums of the rewards, of any reward function."""
        self._f1 = new(worlds.count)

    def begin(self, mask: Tensor) -> None:
        """Start the episodes of a mask."""
        for array in (self.returns, self.earned, self._f1):
            array[mask] = 0.0

    def add(self, row: Tensor, weighted: Tensor) -> None:
        """Add a control step, with its (N, n) weighted terms."""
        self.returns += weighted
        due, sounding = self._pieces.target[row], self._heard.sounding
        both = due.sum(1) + sounding.sum(1)
        f1 = 2 * (due & sounding).sum(1) / both.clamp(min=1)
        self._f1 += torch.where(both > 0, f1, 1.0)

    def summaries(self, worlds: Sequence[int], piece: Tensor, step: Tensor) -> list[dict]:
        """Return mean F1 and returns by name of worlds, after ``step`` steps of their episodes."""
        index = torch.tensor(list(worlds), device=step.device)
        f1 = (self._f1[index] / step[index]).tolist()
        returns, pieces = self.returns[index].tolist(), piece[index].tolist()
        found = []
        for value, sums, number in zip(f1, returns, pieces, strict=True):
            highest = self._pieces.goals[number].highest_return
            names = {RETURN_PREFIX + n: s for n, s in zip(self._terms, sums, strict=True)}
            share = normalized_return(sum(sums), highest)
            found.append({"f1": value, "normalized_return": share, **names})
        return found


class History(Sums):
    """Record of each control step, from which all metrics are computed."""

    def __init__(self, pieces: Pieces, worlds: Worlds, heard: Heard, terms: Sequence[str]):
        super().__init__(pieces, worlds, heard, terms)
        self._scene, self._n_substeps = worlds.scene, worlds.n_substeps
        # Tensors of all worlds, one entry for each control step since the start of the batch.
        self._steps: deque[tuple[Tensor, ...]] = deque(maxlen=int(pieces.length.max()))
        self._count = 0
        self._start = np.zeros(worlds.count, dtype=int)

    def begin(self, mask: Tensor) -> None:
        """Start the episodes of a mask."""
        super().begin(mask)
        self._start[mask.cpu().numpy()] = self._count

    def add(self, row: Tensor, weighted: Tensor) -> None:
        """Record a control step, with its (N, n) weighted terms."""
        del row
        self.returns += weighted
        heard = self._heard
        self._steps.append((heard.sounding, heard.since, heard.pedal, heard.fingertips))
        self._count += 1

    def summaries(self, worlds: Sequence[int], piece: Tensor, step: Tensor) -> list[dict]:
        """Return each world's metrics as in the final ``info`` of a single environment."""
        found = piece.tolist(), step.tolist()
        return [self.record(world, *(each[world] for each in found)).summary() for world in worlds]

    def record(self, world: int, piece: int, steps: int) -> EpisodeRecord:
        """Return the record of a world's episode."""
        goal = self._pieces.goals[piece]
        first = self._start[world] - (self._count - len(self._steps))
        rows = [self._steps[row] for row in range(first, first + steps)]
        sounding, since, pedal, tips = (
            torch.stack([tensor[world] for tensor in part]).cpu().numpy()
            for part in zip(*rows, strict=True)
        )
        pedal_down = pedal >= self._heard.pedal_threshold
        state = EnvState(
            physics=np.empty(0),
            score=goal.source,
            finished=True,
            pedal=0.0,
            key_active=sounding,
            sustain=pedal_down,
            fingertips=tips.astype(float),
            within=self._within(sounding, since),
            returns=self.returns[world].double().cpu().numpy(),
        )
        record = EpisodeRecord(goal, self._scene)
        record.restore(state)
        return record

    def _within(self, sounding: BoolArray, since: np.ndarray) -> dict[int, BoolArray]:
        """Return the sounding keys after each physics step, for control steps with changed keys."""
        before = np.concatenate([np.zeros((1, NUM_KEYS), dtype=bool), sounding[:-1]])
        changed = np.flatnonzero((sounding != before).any(axis=1))
        substep = np.arange(self._n_substeps)[:, None]
        return {
            int(step): np.where(substep >= since[step], sounding[step], ~sounding[step])
            for step in changed
        }
