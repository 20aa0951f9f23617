"""Takes in files (notes, sound and video) and in a window."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from sb3_piano.exceptions import RenderingError, RunError
from sb3_piano.links import make_folder
from sb3_piano.music import synthesize, write_midi, write_wav
from sb3_piano.take import Take
from sb3_piano.viewing.film import film, moments
from sb3_piano.viewing.human_renderer import HumanRenderer
from sb3_piano.viewing.video import write_video
from sb3_piano.viewing.views import Picture, View

Progress = Callable[[int, int], object]
"""Called with the number of pictures drawn so far, and of all."""


@dataclass(frozen=True, kw_only=True)
class Played:
    """The files of a take."""

    folder: Path
    """Their folder."""
    midi: Path | None
    """The notes; ``None`` if no key was pressed."""
    wav: Path
    """The sound."""
    take: Path | None
    """The take itself, which commands read; ``None`` if nobody played."""
    video: Path | None
    """The video with sound; ``None`` if it was not asked for or cannot be drawn here."""
    problem: str | None
    """Reason why a video that was asked for could not be made."""


def write_take(
    take: Take, base: Path, picture: Picture | None, progress: Progress | None = None
) -> Played:
    """Write a take's MIDI file, itself, its sound and its video, in place of former ones.

    Args:
        take: What to write.
        base: The files' path without their suffixes; its folder is made if it is not there.
        picture: How the video looks; ``None`` for no video.
        progress: Called with the number of pictures drawn so far, and of all.

    Raises:
        RunError: If the folder cannot be written.
        ScoreError: If a file cannot be written.
    """
    kinds = ("mid", "wav", "mp4", "npz")
    midi, wav, video, whole = (base.with_name(f"{base.name}.{kind}") for kind in kinds)
    try:
        make_folder(base.parent)
        for stale in (midi, wav, video, whole):
            stale.unlink(missing_ok=True)
    except OSError as error:
        raise RunError(
            f"'{base.parent}' cannot be written: {error.strerror}. Expected a folder."
        ) from error
    if take.score is not None:
        write_midi(take.score, midi)
    if take.player:
        take.write(whole)
    write_wav(wav, synthesize(take.score, at_least=take.duration))
    problem = None if picture is None else _write_video(take, video, wav, picture, progress)
    return Played(
        folder=base.parent,
        midi=None if take.score is None else midi,
        wav=wav,
        take=whole if take.player else None,
        video=None if picture is None or problem is not None else video,
        problem=problem,
    )


def show_take(take: Take, *, view: View = "stage") -> None:
    """Show a take in a window, in real time and without sound, until it is over or closed.

    Raises:
        RenderingError: If there is no screen; the message says what to do.
    """
    renderer = HumanRenderer(take.scene, fps=1 / take.period, view=view)
    with contextlib.closing(renderer):
        for moment in moments(take):
            renderer.render(take.piano.roll, "", moment)
            if not renderer.is_running:
                break


def _write_video(
    take: Take, path: Path, audio: Path, picture: Picture, progress: Progress | None
) -> str | None:
    """Write the video, and return why it could not be written, if so."""
    total, size = len(take.qpos), (picture.width, picture.height)
    tell = None if progress is None else lambda done: progress(done, total)
    try:
        with contextlib.closing(film(take, picture)) as frames:
            write_video(path, frames, 1.0 / take.period, audio, size, progress=tell)
    except RenderingError as error:
        return str(error)
    return None
