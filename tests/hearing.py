"""Listening to sound by its samples alone."""

from __future__ import annotations

import numpy as np


def onsets_in(samples: np.ndarray, sample_rate: int) -> np.ndarray:
    """Return the times at which the sound, (n,) or (n, channels), grows louder at once, s.

    That is where the loudest moment of 5 ms is at least twice that of the 30 ms before, which is
    more than a period of the lowest notes; the notes must not overlap much.
    """
    loudest = np.abs(samples.astype(float)).reshape(len(samples), -1).max(axis=1)
    block = sample_rate // 1000
    n_blocks = len(loudest) // block
    per_ms = loudest[: n_blocks * block].reshape(n_blocks, block).max(axis=1)
    threshold = 1e-3 * per_ms.max(initial=0.0)
    onsets: list[float] = []
    for i in range(n_blocks):
        time = i * block / sample_rate
        if onsets and time < onsets[-1] + 0.06:
            continue
        before, after = per_ms[max(i - 30, 0) : i].max(initial=0.0), per_ms[i : i + 5].max()
        if per_ms[i] > max(threshold, before) and after > 2.0 * before:
            onsets.append(time)
    return np.array(onsets)


def loudness(samples: np.ndarray, sample_rate: int, start: float, end: float) -> float:
    """Return the root mean square between two times in s."""
    part = samples[round(start * sample_rate) : round(end * sample_rate)].astype(float)
    return float(np.sqrt((part**2).mean()))


def dominant_frequency(samples: np.ndarray, sample_rate: int, near: float) -> float:
    """Return the strongest frequency of (n,) samples within two semitones of ``near``, Hz."""
    spectrum = np.abs(np.fft.rfft(samples * np.hanning(len(samples)), 1 << 20))
    frequency = np.arange(len(spectrum)) * sample_rate / (1 << 20)
    spectrum[np.abs(12.0 * np.log2(np.maximum(frequency, 1e-9) / near)) > 2.0] = 0.0
    return float(frequency[spectrum.argmax()])
