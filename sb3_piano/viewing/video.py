"""Write video files: H.264 pictures with AAC sound, by imageio-ffmpeg's ffmpeg."""

from __future__ import annotations

import contextlib
import os
import subprocess
import tempfile
from collections.abc import Callable, Iterable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from sb3_piano.exceptions import ConfigError, RenderingError, one_line
from sb3_piano.links import check_inside
from sb3_piano.unfinished import partial_file

Frame = npt.NDArray[np.uint8]

_FFMPEG = (
    "Expected the ffmpeg that 'pip install imageio-ffmpeg' brings, or one named by "
    "IMAGEIO_FFMPEG_EXE."
)

_PRESET, _DETAILS = "superfast", "mbtree=1:rc-lookahead=10"
"""x264's effort; "veryfast" takes a quarter more time, and files are a sixth smaller. Without the
two settings of a slower preset they are twice as large."""
_QUALITY = "20"
"""x264's constant rate factor: 0 is lossless, 51 is worst, 18 to 23 look good."""


def write_video(
    path: str | os.PathLike[str],
    frames: Iterable[Frame],
    fps: float,
    audio: str | os.PathLike[str] | None,
    size: tuple[int, int],
    *,
    progress: Callable[[int], object] | None = None,
) -> None:
    """Write a stream of pictures, and sound, as an MP4 file, atomically.

    The sound is cut or padded with silence to the length of the pictures.

    Args:
        path: The file; its folder must exist.
        frames: (height, width, 3) uint8 each.
        fps: Pictures per second.
        audio: A sound file that starts with the first picture; ``None`` for a silent video.
        size: Width and height in pixels, both even for this format.
        progress: Called after each picture with the number of pictures so far.

    Raises:
        ConfigError: If size or pictures per second are out of range, or the sound file is missing.
        RenderingError: If there are no pictures, one has another size, or ffmpeg fails.
    """
    path = Path(path)
    _check(fps, audio, size)
    check_inside(path)
    rate = Fraction(fps).limit_denominator(100000)
    with contextlib.ExitStack() as partial:
        try:
            files = [partial.enter_context(partial_file(path)) for _ in range(2)]
        except OSError as error:
            raise RenderingError(f"Cannot write the video '{path}': {error.strerror}.") from error
        silent, whole = (Path(file.name) for file in files)
        with _ffmpeg_running(path, _encoding(silent, rate, size)) as pipe:
            count = 0
            for count, frame in enumerate(frames, start=1):
                _check_frame(frame, size)
                pipe.write(np.ascontiguousarray(frame).data)
                if progress is not None:
                    progress(count)
            if count == 0:
                raise RenderingError(f"Cannot write '{path}': there are no pictures.")
        # The length of the sound is known only now.
        with _ffmpeg_running(path, _muxing(silent, audio, count / rate, whole)):
            pass
        if not whole.exists() or whole.stat().st_size == 0:
            raise RenderingError(
                f"Cannot write '{path}': {ffmpeg_program()!r} writes no file. {_FFMPEG}"
            )
        os.replace(whole, path)


def _encoding(path: Path, rate: Fraction, size: tuple[int, int]) -> list[str]:
    """Return ffmpeg's arguments to encode pictures from a pipe.

    Paths are absolute, as ffmpeg reads the part of a relative path before a colon as a protocol.
    """
    pictures = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{size[0]}x{size[1]}"]
    source = [*pictures, "-r", str(rate), "-i", "pipe:0"]
    effort = ["-preset", _PRESET, "-x264-params", _DETAILS, "-crf", _QUALITY]
    h264 = ["-c:v", "libx264", *effort, "-pix_fmt", "yuv420p"]
    return [*source, *h264, "-f", "mp4", os.path.abspath(path)]


def _muxing(
    silent: Path, audio: str | os.PathLike[str] | None, duration: Fraction, path: Path
) -> list[str]:
    """Return ffmpeg's arguments to add sound, if any, cut to a duration in s."""
    sources = ["-i", os.path.abspath(silent)]
    sound = []
    if audio is not None:
        sources += ["-i", os.path.abspath(audio), "-map", "0:v:0", "-map", "1:a:0"]
        sound = ["-af", f"apad,atrim=end={float(duration):.6f}", "-c:a", "aac", "-b:a", "160k"]
    file = ["-movflags", "+faststart", "-f", "mp4", os.path.abspath(path)]
    return [*sources, "-c:v", "copy", *sound, *file]


@contextlib.contextmanager
def _ffmpeg_running(path: Path, arguments: list[str]) -> Iterator[IO[bytes]]:
    """Context manager that runs ffmpeg and yields its input; ends it after an error."""
    with tempfile.TemporaryFile() as messages:
        program = ffmpeg_program()
        try:
            process = subprocess.Popen(
                [program, "-y", "-v", "error", *arguments],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=messages,
                start_new_session=True,  # this process handles Ctrl-C
            )
        except OSError as error:
            raise RenderingError(
                f"Cannot write a video: {program!r} cannot be run ({error.strerror}). {_FFMPEG}"
            ) from error
        assert process.stdin is not None, "a pipe was asked for"
        try:
            with contextlib.suppress(BrokenPipeError):  # ffmpeg has ended; its messages say why
                yield process.stdin
                process.stdin.close()
            process.wait()
        finally:
            process.kill()
            process.wait()
            with contextlib.suppress(BrokenPipeError):
                process.stdin.close()
        if process.returncode != 0:
            messages.seek(0)
            said = " ".join(messages.read().decode(errors="replace").split())
            raise RenderingError(
                f"Cannot write the video '{path}': ffmpeg ended with {process.returncode} and "
                f"said: {said}"
            )


def ffmpeg_program() -> str:
    """Return the path of ffmpeg; a ``RenderingError`` says how to install it."""
    try:
        import imageio_ffmpeg
    except ImportError as error:
        raise RenderingError(
            "A video needs ffmpeg, which is not installed: pip install imageio-ffmpeg"
        ) from error
    try:
        return imageio_ffmpeg.get_ffmpeg_exe()
    except RuntimeError as error:
        raise RenderingError(f"Cannot write a video: {one_line(error)} {_FFMPEG}") from error


def _check(fps: float, audio: str | os.PathLike[str] | None, size: tuple[int, int]) -> None:
    if not 0 < fps <= 1000:
        raise ConfigError(f"fps is {fps}: expected more than 0, up to 1000 pictures per second.")
    if any(length < 2 or length % 2 for length in size):
        raise ConfigError(f"size is {size[0]}x{size[1]}: expected even numbers of pixels.")
    if audio is not None and not os.path.isfile(audio):
        raise ConfigError(f"audio is '{os.fspath(audio)}': expected a sound file.")


def _check_frame(frame: npt.NDArray[Any], size: tuple[int, int]) -> None:
    expected = (size[1], size[0], 3)
    if frame.shape != expected or frame.dtype != np.uint8:
        raise RenderingError(
            f"A picture has shape {frame.shape} and type {frame.dtype}: expected {expected} uint8."
        )
