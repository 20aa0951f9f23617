"""Synthesise the sound of a score from samples of a grand piano."""

from __future__ import annotations

import importlib.resources
import io
import math
import os
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
from annotated_types import Ge
from numpy.typing import NDArray

from sb3_piano.exceptions import ScoreError
from sb3_piano.music.constants import MIN_PITCH
from sb3_piano.music.formats.common import write_score_file
from sb3_piano.music.formats.midi_writing import in_ticks, pedals_in_ticks
from sb3_piano.music.score import Score
from sb3_piano.settings import Number, Unit, checked

SAMPLE_RATE = 48_000
"""Samples per second of all sound, the rate of the recordings."""

_TAIL = 1.0
"""Time for the last note to fade, s."""

_SPACING, _HIGHEST = 3, 105
"""Keys between two recorded ones, from the lowest key, and the highest recorded pitch: the
recording of the last key is nearly a semitone sharp."""

_FULL_VELOCITY = 110
"""Velocity that sounds as loud as recorded, as in the page (``web/src/view/sound.ts``)."""
_LAYER = 8
"""Velocities in this range have the same overtones, not the same loudness."""

_GAIN = 1.0
"""Factor of the recordings: a piece with notes of velocity 80 peaks at about half of full scale."""

_PEAK = 0.9
"""Highest amplitude; louder sound is scaled down to it, so that nothing is clipped."""

_DAMPING = 0.09
"""Time constant in which a damper silences a string, s."""
_FIRST_UNDAMPED = 90
"""Lowest pitch whose string has no damper."""
_SILENCE = SAMPLE_RATE // 10
"""Samples within which a recording begins to sound."""
_ATTACK = 0.5
"""Time from the strike over which loudness is measured, s."""

_MAX_DURATION = 3600.0
"""Longest sound, s; 1.4 GB."""


def synthesize(score: Score | None, *, at_least: float = 0.0) -> NDArray[np.float32]:
    """Render a score with Salamander Grand Piano, by Alexander Holm (CC BY 3.0).

    A note sounds until the release of its key or of the pedal, whichever is later, but at most
    until its key is struck again. Velocity sets the loudness, equally in all pieces: half the
    velocity is 12 dB softer, and has fewer overtones. A sound that would clip is made softer
    throughout.

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
    music = sound[: round(end * SAMPLE_RATE)]
    alike = defaultdict(list)
    for string in _strings(score, len(music)):
        alike[string.pitch, string.velocity // _LAYER].append(string)
    for (pitch, layer), strings in alike.items():
        longest = max(string.end - string.start for string in strings)
        tone = _tone(pitch, (layer + 0.5) * _LAYER, longest)
        for string in strings:
            heard = tone[: string.end - string.start] * _loudness(string.velocity)
            fading = heard[string.damped - string.start :]
            fading *= np.exp(-np.arange(len(fading)) / (_DAMPING * SAMPLE_RATE))[:, None]
            music[string.start : string.start + len(heard)] += heard
    peak = float(np.abs(sound).max())
    sound *= np.float32(_GAIN if _GAIN * peak <= _PEAK else _PEAK / peak)
    return sound


def write_wav(path: str | os.PathLike[str], samples: NDArray[np.float32]) -> None:
    """Write sound as a 16-bit WAV file, atomically.

    Args:
        path: The file; its folder must exist.
        samples: (n, channels) floats in [-1, 1], ``SAMPLE_RATE`` a second.

    Raises:
        ScoreError: If the file cannot be written.
    """
    steps = np.round(np.clip(samples, -1.0, 1.0) * 32767.0).astype(np.int16)
    write_score_file(Path(path), _encoded(steps, "WAV"))


def mp3_bytes(samples: NDArray[np.float32]) -> bytes:
    """Encode such sound as an MP3 file, a tenth as large, which every browser plays."""
    return _encoded(samples, "MP3")


def _encoded(samples: NDArray[np.float32 | np.int16], kind: str) -> bytes:
    import soundfile  # here, as it loads a library

    file = io.BytesIO()
    soundfile.write(file, samples, SAMPLE_RATE, format=kind)
    return file.getvalue()


class _String(NamedTuple):
    """A string that sounds; times in samples."""

    pitch: int
    velocity: int
    start: int
    damped: int
    """When the damper falls, or ``end`` for never."""
    end: int


def _strings(score: Score, length: int) -> Iterator[_String]:
    """Yield the strings that the notes let sound within a number of samples."""
    tick = 1 / SAMPLE_RATE
    pedals = [in_ticks(pedal, tick) for pedal in pedals_in_ticks(score, tick)]
    struck_again: dict[int, int] = {}
    fade = round(8 * _DAMPING * SAMPLE_RATE)
    for note in reversed(score.notes):
        start, damped = in_ticks(note, tick)
        damped = next((up for down, up in pedals if down <= damped < up), damped)
        again = struck_again.get(note.pitch, length)
        struck_again[note.pitch] = start
        if again <= start:  # of two simultaneous strikes the longer one is heard
            continue
        damped = again if note.pitch >= _FIRST_UNDAMPED else min(damped, again)
        yield _String(note.pitch, note.velocity, start, damped, min(damped + fade, length))


def _loudness(velocity: float) -> np.float32:
    return np.float32((velocity / _FULL_VELOCITY) ** 2)


def _tone(pitch: int, velocity: float, length: int) -> NDArray[np.float32]:
    """Return (n, 2) samples of a string, as loud as recorded, n at most ``length``.

    A string that is struck softly has fewer overtones.
    """
    from scipy import fft

    recorded = MIN_PITCH + _SPACING * round((pitch - MIN_PITCH) / _SPACING)
    recorded = min(recorded, _HIGHEST)
    ratio = 2 ** ((pitch - recorded) / 12)
    take = _recording(recorded, math.ceil(length * ratio) + SAMPLE_RATE // 10).copy()
    fade = min(len(take), SAMPLE_RATE // 20)
    take[-fade:] *= np.linspace(1, 0, fade, dtype=np.float32)[:, None]
    # Another length of the same spectrum is another pitch.
    count = fft.next_fast_len(len(take), real=True)
    shifted = round(count / ratio)
    spectrum = fft.rfft(take, count, axis=0) * np.float32(shifted / count)
    brightest = 900 + 15_000 * _loudness(velocity) ** 2
    heard = np.arange(len(spectrum)) * (SAMPLE_RATE / count / brightest)
    soft = spectrum * (1 / np.sqrt(1 + heard**4)).astype(np.float32)[:, None]
    before, after = (
        fft.irfft(each[: shifted // 2 + 1], shifted, axis=0)[:length] for each in (spectrum, soft)
    )
    attack = round(_ATTACK * SAMPLE_RATE)
    levels = (np.sqrt((each[:attack] ** 2).mean()) for each in (before, after))
    return np.asarray(after * np.float32(next(levels) / next(levels)), dtype=np.float32)


def _recording(pitch: int, length: int) -> NDArray[np.float32]:
    """Return the recording of a key from its strike, (n, 2) samples, n at most ``length``."""
    import soundfile

    file = importlib.resources.files("sb3_piano.music") / "salamander" / f"{pitch}.ogg"
    with file.open("rb") as stream:
        samples, _ = soundfile.read(stream, length + _SILENCE, dtype="float32")
    loud = np.abs(samples).max(axis=1)
    first = int((loud > 0.02 * loud.max()).argmax()) - SAMPLE_RATE // 1000
    return np.asarray(samples[max(first, 0) :][:length])


def _end(score: Score) -> float:
    """Return the time at which the last string is damped, s."""
    held = (pedal.offset for pedal in score.pedals if pedal.onset <= score.duration)
    return max([score.duration, *held])
