"""Align the sound of a video with a score: when is each note struck in the video?"""

from __future__ import annotations

import os
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy import signal, stats

from sb3_piano.arrays import Float32Array, FloatArray
from sb3_piano.exceptions import ConfigError, RenderingError
from sb3_piano.music import Score
from sb3_piano.viewing.video import ffmpeg_program

RATE = 22050
"""Samples a second of the sound."""

_LOWEST, _HIGHEST = 60.0, 4000.0  # Hz: where the spectrum tells semitones apart, and notes sound
_MOST_FRAMES = 4000  # of the sound, for warping: 128 MB
_HOP = 512  # samples between two frames of the warping
_FINE_HOP = 256  # samples between two frames of the onset detection
_NEAR = 0.12  # s: an onset of the sound further from its place is another one
_HIT = 0.05  # s
_DECAY = 2.0  # s: a struck string loses all but 1/e of its energy
_LEAST_HITS = 0.5
_LEAST_ALIKE = 0.6  # mean cosine of the chroma
_NEIGHBOURS = 8  # onsets on each side with a common error, where the tempo changes
_STRIKES = 0.5  # how much beginnings of notes weigh beside their pitches
_STEPS = ((1, 1), (1, 2), (2, 1))  # frames of the score and of the sound: half to double tempo
_STEADY = 0.1  # s: a tempo that leaves a line less than this is steady


@dataclass(frozen=True, eq=False)
class Alignment:
    """When the notes of a score are struck in a video."""

    onsets: FloatArray
    """(n,) s, in the order of the score's notes."""
    offset: float
    """When the score begins in the video, s, as a line through the onsets says."""
    drift: float
    """Slope of that line: seconds of video for a second of score."""
    hits: float
    """Share of the score's onsets with an onset of the sound within 50 ms; NaN without sound."""


def read_sound(video: str | os.PathLike[str]) -> Float32Array:
    """Read the sound of a video, mono, at :data:`RATE`.

    Raises:
        ConfigError: If there is no such file, or it has no sound.
        RenderingError: If there is no ffmpeg.
    """
    path = Path(video).absolute()
    if not path.is_file():
        raise ConfigError(f"There is no video '{video}': expected an existing file.")
    command = [ffmpeg_program(), "-v", "error", "-i", f"file:{path}"]
    command += ["-vn", "-ac", "1", "-ar", str(RATE), "-f", "f32le", "-"]
    try:
        done = subprocess.run(command, capture_output=True, check=False)
    except OSError as error:
        raise RenderingError(f"ffmpeg, '{command[0]}', cannot be run: {error.strerror}.") from error
    if done.returncode or not done.stdout:
        raise ConfigError(
            f"No sound can be read from '{video}': expected a video with sound. Give the time of "
            "the first note with --offset, if the tempo is the score's."
        )
    return np.frombuffer(done.stdout, dtype=np.float32)


def constant_tempo(score: Score, offset: float) -> Alignment:
    """Return the alignment of a video in the score's tempo whose first note sounds at a time, s."""
    onsets = np.array([note.onset for note in score.notes])
    start = offset - onsets.min()
    return Alignment(onsets + start, start, 1.0, float("nan"))


def align(score: Score, sound: Float32Array) -> Alignment:
    """Align a sound with a score.

    Dynamic time warping of chroma finds the place of each note roughly; the onsets of the sound
    place it exactly. Between them times are interpolated.

    Source: the curriculum-strategies report, section 6.4, aligns onsets with the score by an offset
    and dynamic time warping.

    Args:
        score: The notes.
        sound: (m,) samples at :data:`RATE`.

    Raises:
        ConfigError: If the sound is silent, or does not fit the score.
    """
    if not len(sound) or np.abs(sound).max() < 1e-4:
        raise ConfigError("The video's sound is silent: expected the sound of the piece.")
    hop = _HOP * max(1, -(-len(sound) // (_HOP * _MOST_FRAMES)))
    heard, written = _heard(sound, hop), _written(score, hop / RATE)
    cost = 1 - written[0].T @ heard[0] + _STRIKES * np.abs(written[1][:, None] - heard[1])
    path = _warped(cost)
    if path is None:
        raise ConfigError(_misfit(score, sound, 0.0, 0.0))
    seconds = path * hop / RATE
    alike = float((written[0].T @ heard[0])[path[:, 0], path[:, 1]].mean())
    notes = np.array([note.onset for note in score.notes])
    rough = np.interp(notes, *_single(seconds))
    reach = _NEIGHBOURS
    if len(set(notes)) > 1:
        line = stats.theilslopes(rough, notes)
        straight = line.intercept + line.slope * notes
        if np.median(np.abs(straight - rough)) < _STEADY:
            rough, reach = straight, len(notes)
    onsets, hits = _snapped(notes, rough, _onsets(sound), reach)
    if hits < _LEAST_HITS or alike < _LEAST_ALIKE:
        raise ConfigError(_misfit(score, sound, hits, alike))
    drift, offset = np.polyfit(notes, onsets, 1) if len(set(notes)) > 1 else (1.0, onsets[0])
    return Alignment(onsets, float(offset), float(drift), hits)


def _misfit(score: Score, sound: Float32Array, hits: float, alike: float) -> str:
    return (
        f"The sound of {len(sound) / RATE:.0f} s does not fit the score {score.title!r} of "
        f"{score.duration:.0f} s: {hits:.0%} of its onsets are heard (expected {_LEAST_HITS:.0%}), "
        f"and harmonies are {alike:.0%} alike ({_LEAST_ALIKE:.0%}). Expected a video of this "
        "piece, played once from beginning to end, at half to twice its tempo."
    )


def _warped(cost: FloatArray) -> npt.NDArray[np.int_] | None:
    """Return the cheapest path through a cost matrix, (n, 2) growing rows and columns.

    It begins in the first row and ends in the last one, in any columns. Its steps are (1, 1),
    (1, 2) and (2, 1), whose costs count by rows, so that no tempo is cheaper than another. There is
    none if the sound is too short. (librosa, which has the same, compiles itself for 20 s when it
    is first imported, into files that two processes can damage; the next one then crashes.)
    """
    rows, columns = cost.shape
    total = np.full((rows + 2, columns + 2), np.inf)  # two rows and columns before the first
    total[2, 2:] = cost[0]
    steps = np.zeros((rows, columns), dtype=np.int8)
    for row in range(1, rows):
        ways = [total[row + 2 - down, 2 - right : columns + 2 - right] for down, right in _STEPS]
        ways = [way + down * cost[row] for way, (down, _) in zip(ways, _STEPS, strict=True)]
        steps[row] = np.argmin(ways, axis=0)
        total[row + 2, 2:] = np.min(ways, axis=0)
    row, column = rows - 1, int(total[-1, 2:].argmin())
    if not np.isfinite(total[-1, column + 2]):
        return None
    path = [(row, column)]
    while row > 0:
        down, right = _STEPS[steps[row, column]]
        row, column = row - down, column - right
        path.append((row, column))
    return np.array(path[::-1])


def _heard(sound: Float32Array, hop: int) -> tuple[FloatArray, FloatArray]:
    """Return chroma, (12, T), and how strongly notes begin, (T,) 0 to 1, of a sound."""
    frequency, energy = _spectrum(sound, 4096, hop)
    audible = (frequency > _LOWEST) & (frequency < _HIGHEST)
    pitch = np.round(69 + 12 * np.log2(frequency[audible] / 440)).astype(int)
    chroma = np.zeros((12, energy.shape[1]))
    np.add.at(chroma, pitch % 12, energy[audible])
    strength = _strength(sound, hop)[: chroma.shape[1]]
    return _normalized(chroma), np.minimum(strength / np.percentile(strength, 95), 1.0)


def _strength(sound: Float32Array, hop: int) -> FloatArray:
    """Return how strongly notes begin, (T,): what grows in the logarithmic spectrum.

    Source: spectral flux (Dixon 2006, "Onset Detection Revisited").
    """
    _, energy = _spectrum(sound, 1024, hop)
    level = np.log1p(100 * np.sqrt(energy / energy.max()))
    return np.maximum(np.diff(level, axis=1, prepend=level[:, :1]), 0).sum(axis=0)


def _spectrum(sound: Float32Array, window: int, hop: int) -> tuple[FloatArray, FloatArray]:
    """Return frequencies, Hz, and their energy, (n, T), around each ``hop`` samples."""
    frequency, _, found = signal.stft(sound, RATE, nperseg=window, noverlap=window - hop)
    return frequency, np.abs(found) ** 2


def _written(score: Score, step: float) -> tuple[FloatArray, FloatArray]:
    """Return the same as expected from a score, a frame every ``step`` s."""
    frames = int(score.duration / step) + 2
    found, begin = np.zeros((12, frames)), np.zeros(frames)
    for note in score.notes:
        first, last = int(note.onset / step), int(max(note.offset, note.onset + 0.1) / step) + 1
        times = np.arange(last - first) * step
        found[note.pitch % 12, first:last] += np.exp(-times / _DECAY)[: frames - first]
        begin[first] = 1.0
    return _normalized(found), begin


def _normalized(chroma: FloatArray) -> FloatArray:
    chroma = np.sqrt(np.maximum(chroma, 0)) + 1e-3  # the loudest note must not hide the others
    return chroma / np.linalg.norm(chroma, axis=0)


def _single(path: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a path as a function: the mean time of the sound at each time of the score."""
    times, places = np.unique(path[:, 0], return_inverse=True)
    return times, np.bincount(places, weights=path[:, 1]) / np.bincount(places)


def _onsets(sound: Float32Array) -> FloatArray:
    """Return the onsets of a sound, s."""
    strength = _strength(sound, _FINE_HOP)
    level = np.percentile(strength, 95)
    peaks, _ = signal.find_peaks(strength, prominence=0.1 * level, distance=3)
    return peaks * _FINE_HOP / RATE


def _snapped(
    notes: FloatArray, rough: FloatArray, heard: FloatArray, reach: int
) -> tuple[FloatArray, float]:
    """Move each onset to that of the sound; return the share that have one within 50 ms, too.

    What ``reach`` neighbours on each side have in common is removed first.
    """
    times, firsts, places = np.unique(notes, return_index=True, return_inverse=True)
    rough = rough[firsts]
    if len(heard) == 0:
        return rough[places], 0.0
    # The warping is as coarse as its frames, and late where a sound grows slowly.
    for _ in range(3):
        nearest = heard[np.abs(heard[:, None] - rough).argmin(axis=0)]
        off = np.where(np.abs(nearest - rough) < _NEAR, nearest - rough, np.nan)
        rough = rough + _running_median(off, reach)
    nearest = heard[np.abs(heard[:, None] - rough).argmin(axis=0)]
    hit = np.abs(nearest - rough) < _HIT
    if hit.any():
        moved = np.interp(times, times[hit], (nearest - rough)[hit])
        rough = np.maximum.accumulate(rough + moved)
    return rough[places], float(hit.mean())


def _running_median(values: FloatArray, reach: int) -> FloatArray:
    """Return the median of each value's neighbours without NaN; 0 if there are none."""
    padded = np.pad(values, reach, constant_values=np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1)
    return np.array([np.median(w[~np.isnan(w)]) if (~np.isnan(w)).any() else 0 for w in windows])
