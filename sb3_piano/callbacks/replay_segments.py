"""A replay buffer on disk, written in segments.

A full buffer of piano observations has about 9 GB. Each checkpoint therefore appends one file, a
*segment*, with the rows added since the last one, and drops the segments whose rows have all been
overwritten. Rows are counted from the beginning of training: row ``r`` stands at index
``r % capacity`` of the buffer, and the rows ``total - size`` to ``total - 1`` are valid.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.spaces import flatdim
from stable_baselines3.common.buffers import ReplayBuffer

from sb3_piano.array_files import read_arrays
from sb3_piano.arrays import Arrays
from sb3_piano.buffers.rows import buffer_rows
from sb3_piano.exceptions import RunError
from sb3_piano.files import write_atomically

SEGMENT_PATTERN = "replay-*.npz"


@dataclass(frozen=True, kw_only=True)
class Segment:
    """The rows ``first`` to ``last - 1``, in a file."""

    file: str
    first: int
    last: int


@dataclass(frozen=True, kw_only=True)
class ReplayManifest:
    """Segments that make up a saved buffer, and its write position."""

    capacity: int
    n_envs: int
    total: int
    full: bool
    segments: tuple[Segment, ...]


class ReplaySegments:
    """Write new rows of a replay buffer since the last commit into an existing folder.

    ``saved`` is what is already on disk, after :func:`restore_replay_buffer`. The last saved row is
    written once more, since resuming marks it as the end of an episode.

    Raises:
        RunError: If the buffer's rows cannot be taken out of it.
    """

    def __init__(
        self, folder: Path, buffer: ReplayBuffer, saved: ReplayManifest | None = None
    ) -> None:
        self._folder = folder
        self._buffer = buffer
        self._rows = buffer_rows(buffer)
        self._position = buffer.pos
        self._segments: tuple[Segment, ...] = () if saved is None else saved.segments
        if saved is None:
            self._total = buffer.pos + (buffer.buffer_size if buffer.full else 0)
            self._written = self._total - buffer.size()
        else:
            self._total = saved.total
            self._written = max(saved.total - 1, 0)

    def observe(self) -> None:
        """Count the rows added since the last call.

        To be called at least once in ``capacity - 1`` rows, since the buffer itself does not tell
        how often it went round; once per environment step will do.
        """
        capacity = self._buffer.buffer_size
        self._total += (self._buffer.pos - self._position) % capacity
        self._position = self._buffer.pos

    def write(self) -> ReplayManifest:
        """Write the new rows as one segment; return the manifest of the whole buffer.

        Nothing is deleted and this object is unchanged: :meth:`committed` follows once the returned
        manifest is safe on disk.
        """
        self.observe()
        oldest = self._total - self._buffer.size()
        kept = tuple(segment for segment in self._segments if segment.last > oldest)
        first = max(self._written, oldest)
        if first < self._total:
            kept = (*kept, self._write_segment(first, self._total))
        return ReplayManifest(
            capacity=self._buffer.buffer_size,
            n_envs=self._buffer.n_envs,
            total=self._total,
            full=self._buffer.full,
            segments=kept,
        )

    def committed(self, manifest: ReplayManifest) -> None:
        """Mark a manifest of :meth:`write` as the valid one."""
        self._segments = manifest.segments
        self._written = manifest.total

    def _write_segment(self, first: int, last: int) -> Segment:
        indices = np.arange(first, last) % self._buffer.buffer_size
        rows = self._rows.take_rows(indices)
        segment = Segment(file=f"replay-{first}-{last}.npz", first=first, last=last)
        # The stubs take the names of rows for options.
        compress = getattr(self._buffer, "is_compressible", True)
        save: Any = np.savez_compressed if compress else np.savez
        write_atomically(self._folder / segment.file, lambda file: save(file, **rows))
        return segment


def restore_replay_buffer(buffer: ReplayBuffer, folder: Path, saved: ReplayManifest) -> None:
    """Fill a new buffer with the saved rows, position and ``full`` flag.

    With ``optimize_memory_usage`` the observation after the last row is not restored; resuming
    ends the episode at that row, so that it is never used.

    Raises:
        RunError: If the buffer has another size or kind, or a segment is missing or damaged.
    """
    ours, theirs = (buffer.buffer_size, buffer.n_envs), (saved.capacity, saved.n_envs)
    if ours != theirs:
        raise RunError(
            f"The replay buffer saved in '{folder}' has {theirs[0]} rows of {theirs[1]} "
            f"environment(s), the model's has {ours[0]} of {ours[1]}: expected equal sizes, "
            "by the buffer_size and n_envs of the run."
        )
    rows = buffer_rows(buffer)
    # A row has two observations, an action and some numbers more.
    numbers = 2 * flatdim(buffer.observation_space) + flatdim(buffer.action_space) + 64
    for segment in saved.segments:
        path, count = folder / segment.file, segment.last - segment.first
        if not 0 < count <= saved.capacity:
            raise RunError(
                f"Replay segment '{path}' has {count} rows by the checkpoint: expected 1 to "
                f"{saved.capacity}."
            )
        content = _read_segment(path, 2**20 + count * buffer.n_envs * numbers * 8)
        try:
            rows.put_rows(np.arange(segment.first, segment.last) % saved.capacity, content)
        except (RunError, IndexError) as error:
            raise RunError(
                f"Replay segment '{path}' does not fit a {type(buffer).__name__}: {error} Was the "
                "environment or the kind of buffer changed since?"
            ) from error
    buffer.pos = saved.total % saved.capacity
    buffer.full = saved.full


def end_last_episode(buffer: ReplayBuffer) -> None:
    """Mark the last row as the end of a truncated episode.

    A resumed training starts a new episode; n-step returns must not run across that border.
    """
    if buffer.size() == 0 or not hasattr(buffer, "dones"):  # its rows are independent
        return
    last = buffer.pos - 1
    if buffer.handle_timeout_termination:
        buffer.timeouts[last] = np.maximum(buffer.timeouts[last], buffer.dones[last] == 0)
    buffer.dones[last] = 1.0


def _read_segment(path: Path, most: int) -> Arrays:
    try:
        return read_arrays(path, most=most)
    except (OSError, ValueError) as error:
        raise RunError(
            f"Replay segment '{path}' cannot be read ({error}): expected the file that the "
            "checkpoint wrote."
        ) from error
