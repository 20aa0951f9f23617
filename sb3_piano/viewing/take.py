"""A take: a performance with its motion, as it is written to files or shown in a window."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import numpy.typing as npt
from annotated_types import Ge, Le, MultipleOf

from sb3_piano.exceptions import RenderingError, RunError
from sb3_piano.music import Score, synthesize, write_midi, write_wav
from sb3_piano.performance import Performance
from sb3_piano.settings import Unit, Whole, settings
from sb3_piano.simulation import PianoScene
from sb3_piano.viewing.film import film, moments
from sb3_piano.viewing.video import write_video
from sb3_piano.viewing.window import SceneWindow

Progress = Callable[[int, int], object]
"""Called with the number of pictures drawn so far, and of all."""


Camera = Literal["overview", "topdown"]
"""Name of a camera of the scene."""

_EVEN = Unit("pixels, even as the video's format demands")


@settings
class Picture:
    """Size and camera of a video.

    Raises:
        ConfigError: If a value is out of range.
    """

    width: Annotated[Whole, Ge(2), Le(1920), MultipleOf(2), _EVEN] = 640
    """Pixels, even, at most 1920."""
    height: Annotated[Whole, Ge(2), Le(1080), MultipleOf(2), _EVEN] = 360
    """Pixels, even, at most 1080."""
    camera: Camera = "overview"
    """Camera of the scene: "overview" or "topdown"."""


DEFAULT_PICTURE = Picture()
"""A small video from behind the keyboard."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Take:
    """A performance with all that is needed to hear and see it."""

    scene: PianoScene
    """The scene in which it was played."""
    performance: Performance
    """The performance, with the roll that should have been played."""
    qpos: npt.NDArray[np.float64]
    """(t + 1, nq) joint positions at the start and after each control step, rad or m."""
    score: Score | None
    """The notes that are heard; ``None`` if no key was pressed."""
    mark_sounding: bool = True
    """Whether keys that sound are green in pictures."""

    @classmethod
    def of(cls, scene: PianoScene, performance: Performance, qpos: npt.NDArray[np.float64]) -> Take:
        """Return a take of what was really played."""
        return cls(scene=scene, performance=performance, qpos=qpos, score=performance.to_score())

    @property
    def period(self) -> float:
        """Time from one picture to the next, s."""
        return self.performance.roll.control_timestep

    @property
    def duration(self) -> float:
        """Duration of its pictures, s."""
        return len(self.qpos) * self.period


@dataclass(frozen=True, kw_only=True)
class Played:
    """The files of a take."""

    folder: Path
    """Their folder."""
    midi: Path | None
    """The notes; ``None`` if no key was pressed."""
    wav: Path
    """The sound."""
    video: Path | None
    """The video with sound; ``None`` if it was not asked for or cannot be drawn here."""
    problem: str | None
    """Reason why a video that was asked for could not be made."""


def write_take(
    take: Take, base: Path, picture: Picture | None, progress: Progress | None = None
) -> Played:
    """Write a take's MIDI file, then its sound, then its video, in place of former ones.

    Args:
        take: What to write.
        base: The files' path without their suffixes; its folder is made if it is not there.
        picture: How the video looks; ``None`` for no video.
        progress: Called with the number of pictures drawn so far, and of all.

    Raises:
        RunError: If the folder cannot be written.
        ScoreError: If a file cannot be written.
    """
    midi, wav, video = (base.with_name(f"{base.name}.{kind}") for kind in ("mid", "wav", "mp4"))
    try:
        base.parent.mkdir(parents=True, exist_ok=True)
        for stale in (midi, wav, video):
            stale.unlink(missing_ok=True)
    except OSError as error:
        raise RunError(
            f"'{base.parent}' cannot be written: {error.strerror}. Expected a folder."
        ) from error
    if take.score is not None:
        write_midi(take.score, midi)
    write_wav(wav, synthesize(take.score, at_least=take.duration))
    problem = None if picture is None else _write_video(take, video, wav, picture, progress)
    return Played(
        folder=base.parent,
        midi=None if take.score is None else midi,
        wav=wav,
        video=None if picture is None or problem is not None else video,
        problem=problem,
    )


def show_take(take: Take, *, camera: str = "overview") -> None:
    """Show a take in a window, in real time and without sound, until it is over or closed.

    Raises:
        RenderingError: If there is no screen; the message says what to do.
    """
    seen = moments(take.scene, take.performance, take.qpos, mark_sounding=take.mark_sounding)
    with SceneWindow(take.scene, camera=camera) as window:
        window.replay(seen, take.period)


def _write_video(
    take: Take, path: Path, audio: Path, picture: Picture, progress: Progress | None
) -> str | None:
    """Write the video, and return why it could not be written, if so."""
    total = len(take.qpos)
    try:
        frames = film(
            take.scene,
            take.performance,
            take.qpos,
            width=picture.width,
            height=picture.height,
            camera=picture.camera,
            mark_sounding=take.mark_sounding,
        )
        with contextlib.closing(frames):
            write_video(
                path,
                frames,
                1.0 / take.period,
                audio,
                (picture.width, picture.height),
                progress=None if progress is None else lambda done: progress(done, total),
            )
    except RenderingError as error:
        return str(error)
    return None
