"""Synthesise the sound of a score."""

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
"""Samples per second of all sound; the synthesiser supports no other rate."""

_TAIL = 1.0
"""Time for the last note to fade, s."""

_GAIN = 5.0 / 32_768
"""Factor of the synthesiser's 16-bit samples, which leave room for all keys at once: a piece with
notes of velocity 80 peaks at about half of full scale."""

_PEAK = 0.9
"""Highest amplitude; louder sound is scaled down to it, so that nothing is clipped."""

_MAX_DURATION = 3600.0
"""Longest sound, s; 0.7 GB."""

_TICKS_PER_SECOND = 2000
"""Finer than the synthesiser's blocks of 64 samples, and an hour is less than the 1e7 ticks that
pretty_midi takes."""


def synthesize(score: Score | None, *, at_least: float = 0.0) -> NDArray[np.float32]:
    """Render a score with the grand piano of pretty_midi's SoundFont.

    A note sounds until the release of its key or of the pedal, whichever is later, but at most
    until its key is struck again. Velocity sets the loudness, equally in all pieces: half the
    velocity is 12 dB softer. A sound that would clip is made softer throughout.

    Args:
        score: The piece; ``None`` is silence.
        at_least: Minimum length of the sound, s; it is padded with silence at the end.

    Returns:
        (n, 2) float32, left and right, ``SAMPLE_RATE`` a second, in [-0.9, 0.9]; a second longer
        than the last note, or than the pedal that holds it.

    Raises:
        ConfigError: If the length is not a finite number, 0 or more.
        ScoreError: If the sound would be longer than an hour.
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
    """Write sound as a 16-bit WAV file, atomically.

    Args:
        path: The file; its folder must exist.
        samples: (n, channels) floats in [-1, 1], ``SAMPLE_RATE`` a second.

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
    """Return the time at which the last string is damped, s."""
    held = (pedal.offset for pedal in score.pedals if pedal.onset <= score.duration)
    return max([score.duration, *held])


def _midi_bytes(score: Score, end: float) -> bytes:
    """Write a MIDI file of one channel, whose pedal acts on it alone, that lasts until ``end``."""
    piano = pretty_midi.Instrument(program=0)
    struck_again: dict[int, int] = {}
    tick = 1 / _TICKS_PER_SECOND
    for note in reversed(score.notes):
        onset, offset = in_ticks(note, tick)
        offset = min(offset, struck_again.get(note.pitch, offset))
        if offset > onset:  # of two simultaneous strikes the longer one is heard
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
