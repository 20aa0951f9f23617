"""From a score to its sound."""

from __future__ import annotations

import functools
import importlib.resources
import io
import os
from pathlib import Path
from typing import Annotated

import numpy as np
import pretty_midi
from annotated_types import Ge
from numpy.typing import NDArray

from sb3_piano.exceptions import ScoreError
from sb3_piano.music.formats.common import write_score_file
from sb3_piano.music.formats.midi_reading import SUSTAIN_CONTROLLER
from sb3_piano.music.formats.midi_writing import control_changes, in_ticks, pedals_in_ticks
from sb3_piano.music.score import Score
from sb3_piano.settings import Number, Unit, checked

SAMPLE_RATE = 48_000
"""Samples per second of all sound; the synthesiser knows no other."""

_TAIL = 1.0
"""Time in which the last note rings out, s."""

_GAIN = 5.0 / 32_768
"""Factor of the synthesiser's samples of 16 bits, which leave room for all keys struck at once: a
piece with notes of velocity 80 has its peak at about half of full scale."""

_PEAK = 0.9
"""Highest amplitude; what would be louder is scaled down to it, so that nothing is clipped."""

_MAX_DURATION = 3600.0
"""Longest sound, s; 0.7 GB."""

_TICKS_PER_SECOND = 2000
"""Finer than the synthesiser's blocks of 64 samples, and an hour is less than the 1e7 ticks that
pretty_midi takes."""


def synthesize(score: Score | None, *, at_least: float = 0.0) -> NDArray[np.float32]:
    """Play a score on the grand piano of the SoundFont that pretty_midi ships.

    A note sounds until its key is let go, or until the pedal is, if that is later; and at most
    until its key is struck again. A note is as loud as its velocity says, half the velocity being
    12 dB softer, in every piece alike; only what would be clipped is made softer throughout.

    Args:
        score: The piece; ``None`` is silence.
        at_least: The least length of the sound, s; what is missing is silence at the end.

    Returns:
        (n, 2) float32, left and right, ``SAMPLE_RATE`` a second, in [-0.9, 0.9]; a second longer
        than the last note, or than the pedal that holds it.

    Raises:
        ConfigError: If the length is no time.
        ScoreError: If the sound would last longer than an hour.
    """
    from scipy.io import wavfile  # here, because it takes long

    checked("at_least", at_least, Annotated[Number, Ge(0), Unit("s")])
    end = 0.0 if score is None else _end(score) + _TAIL
    if max(end, at_least) > _MAX_DURATION:
        raise ScoreError(
            f"The sound would last {max(end, at_least):.0f} s: expected {_MAX_DURATION:.0f} s at "
            "most, such as an excerpt of the piece."
        )
    sound = np.zeros((round(max(end, at_least) * SAMPLE_RATE), 2), dtype=np.float32)
    if score is None:
        return sound
    import midirenderer

    file = midirenderer.render_wave_from(_soundfont(), _midi_bytes(score, end))
    _, samples = wavfile.read(io.BytesIO(file))
    sound[: len(samples)] = samples[: len(sound)]
    peak = float(np.abs(sound).max())
    return sound * np.float32(_GAIN if _GAIN * peak <= _PEAK else _PEAK / peak)


def write_wav(path: str | os.PathLike[str], samples: NDArray[np.float32]) -> None:
    """Write sound as a WAV file of 16 bits, whole or not at all.

    Args:
        path: The file; its folder must exist.
        samples: (n, channels) floating-point numbers in [-1, 1], ``SAMPLE_RATE`` a second.

    Raises:
        ScoreError: If the file cannot be written.
    """
    from scipy.io import wavfile  # here, because it takes long

    steps = np.round(np.clip(samples, -1.0, 1.0) * 32767.0).astype(np.int16)
    file = io.BytesIO()
    wavfile.write(file, SAMPLE_RATE, steps)
    write_score_file(Path(path), file.getvalue())


@functools.lru_cache(maxsize=1)
def _soundfont() -> bytes:
    return (importlib.resources.files("pretty_midi") / "TimGM6mb.sf2").read_bytes()


def _end(score: Score) -> float:
    """Return when the last string is damped, s."""
    held = (pedal.offset for pedal in score.pedals if pedal.onset <= score.duration)
    return max([score.duration, *held])


def _midi_bytes(score: Score, end: float) -> bytes:
    """Return a MIDI file of one channel, on which alone a pedal acts, that lasts until ``end``."""
    piano = pretty_midi.Instrument(program=0)
    struck_again: dict[int, int] = {}
    tick = 1 / _TICKS_PER_SECOND
    for note in reversed(score.notes):
        onset, offset = in_ticks(note, tick)
        offset = min(offset, struck_again.get(note.pitch, offset))
        if offset > onset:  # of two strikes at one time the longer one is heard
            times = onset * tick, offset * tick
            piano.notes.append(pretty_midi.Note(note.velocity, note.pitch, *times))
        struck_again[note.pitch] = onset
    # The synthesiser stops at the last event.
    stop = pretty_midi.ControlChange(SUSTAIN_CONTROLLER, 0, end)
    piano.control_changes = [*control_changes(pedals_in_ticks(score, tick)), stop]
    midi = pretty_midi.PrettyMIDI(resolution=_TICKS_PER_SECOND // 2, initial_tempo=120.0)
    midi.instruments.append(piano)
    file = io.BytesIO()
    midi.write(file)
    return file.getvalue()
