"""Watch and hear: a run's model plays, or a piece plays itself, into MIDI, sound and video."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError, RenderingError, RunError
from sb3_piano.metrics import presses_of
from sb3_piano.music import PianoRoll, Score, load_score, synthesize, write_midi, write_wav
from sb3_piano.performance import Performance
from sb3_piano.simulation import PianoScene, compile_scene
from sb3_piano.training.playing import SavedPlayer
from sb3_piano.viewing import SceneWindow, film, moments, write_video

CONTROL_TIMESTEP = 0.05
"""Length of a step of a piece that plays itself, s: that of the environments."""

Progress = Callable[[int, int], object]
"""Is called with the number of pictures that are drawn, and of all."""


@dataclass(frozen=True, kw_only=True)
class Picture:
    """How a video looks.

    Raises:
        ConfigError: If a number is out of range.
    """

    width: int = 640
    """Pixels, even, at most 1920."""
    height: int = 360
    """Pixels, even, at most 1080."""
    camera: str = "overview"
    """Camera of the scene: "overview" or "topdown"."""

    def __post_init__(self) -> None:
        for name, value, most in (("width", self.width, 1920), ("height", self.height, 1080)):
            if not 2 <= value <= most or value % 2:
                raise ConfigError(f"{name} is {value}: expected an even number from 2 to {most}.")
        if self.camera not in ("overview", "topdown"):
            raise ConfigError(f"camera is {self.camera!r}: expected 'overview' or 'topdown'.")


@dataclass(frozen=True, kw_only=True, eq=False)
class Take:
    """A performance with all that is needed to hear and see it."""

    scene: PianoScene
    """Where it was played."""
    performance: Performance
    """What was played, beside what should have been."""
    qpos: npt.NDArray[np.float64]
    """(t + 1, nq) joint positions at the start and after each control step, rad or m."""
    score: Score | None
    """What is heard; ``None`` if no key was pressed."""
    mark_sounding: bool
    """Whether keys that sound are green in pictures."""

    @property
    def period(self) -> float:
        """Time from one picture to the next, s."""
        return self.performance.roll.control_timestep

    @property
    def duration(self) -> float:
        """How long its pictures last, s."""
        return len(self.qpos) * self.period


@dataclass(frozen=True, kw_only=True)
class Played:
    """The files of a take."""

    folder: Path
    """Where they are."""
    midi: Path | None
    """What was played; ``None`` if no key was pressed."""
    wav: Path
    """How it sounds."""
    video: Path | None
    """How it looks and sounds; ``None`` if it was not asked for or cannot be drawn here."""
    problem: str | None
    """Why a video that was asked for could not be made."""


def play_run(
    run: str | os.PathLike[str],
    out: str | os.PathLike[str] | None = None,
    *,
    seed: int = 0,
    physics: str | None = None,
    score: Score | str | os.PathLike[str] | None = None,
    picture: Picture | None = Picture(),
    progress: Progress | None = None,
) -> Played:
    """Let a run's saved model play one episode, without exploring, and write it down.

    Writes ``performance.mid``, ``performance.wav`` and ``performance.mp4``, in place of those that
    were there. A machine that cannot draw gets the first two.

    Args:
        run: The run's folder.
        out: The folder to write into; by default ``play`` in the run's, and for another piece a
            folder in that with the piece's title.
        seed: Seeds the environment, at least 0.
        physics: Name of the physics profile to play on; by default the run's own.
        score: What to play in place of the run's own piece.
        picture: How the video looks; ``None`` for no video.
        progress: Is told how far the video is.

    Raises:
        ConfigError: If a setting is out of range, or the run's config is damaged.
        RunError: If there is no run, it has no model that can be loaded, it is no piano's, it
            cannot play the piece, or the folder cannot be written.
        ScoreError: If the score cannot be read, or a file cannot be written.
    """
    piece = None if score is None else load_score(score)
    take = take_of_run(run, seed=seed, physics=physics, score=piece)
    folder = default_folder(run, piece) if out is None else Path(out)
    return write_take(take, folder, picture, progress)


def play_score(
    score: Score | str | os.PathLike[str],
    out: str | os.PathLike[str] | None = None,
    *,
    physics: str = "reference",
    picture: Picture | None = Picture(),
    progress: Progress | None = None,
) -> Played:
    """Let a piece play itself: keys go down in their fingers' colours while the hands rest.

    Writes the same files as :func:`play_run`; they show what should be played.

    Args:
        score: A score, or what :func:`~sb3_piano.music.load_score` accepts.
        out: The folder to write into; by default ``play/<title>``.
        physics: Name of the physics profile whose piano is shown.
        picture: How the video looks; ``None`` for no video.
        progress: Is told how far the video is.

    Raises:
        ConfigError: If a setting is out of range.
        RunError: If the folder cannot be written.
        ScoreError: If the score cannot be read, or a file cannot be written.
        UnknownPieceError: If ``score`` is neither a study nor a file.
    """
    piece = load_score(score)
    folder = default_folder(None, piece) if out is None else Path(out)
    return write_take(take_of_score(piece, physics=physics), folder, picture, progress)


def take_of_run(
    run: str | os.PathLike[str],
    *,
    seed: int = 0,
    physics: str | None = None,
    score: Score | None = None,
) -> Take:
    """Return an episode of a run's saved model; arguments and errors as of :func:`play_run`."""
    with SavedPlayer.open(run, seed=seed, physics=physics, score=score) as player:
        env = player.env
        if not isinstance(env, PianoEnv):
            raise RunError(
                f"Run '{run}' cannot be watched: its environment {player.config.env_id!r} is no "
                "piano. Expected a run of a piano environment."
            )
        (recording,) = player.play()
    performance, motion = recording.performance, recording.motion
    assert performance is not None, "a piano's episode has a performance"
    assert motion is not None, "a piano's episode has a motion"
    return Take(
        scene=env.scene,
        performance=performance,
        qpos=motion.qpos,
        score=performance.to_score(),
        mark_sounding=True,
    )


def take_of_score(score: Score, *, physics: str = "reference") -> Take:
    """Return a piece that plays itself, exactly as it is written."""
    scene = compile_scene(physics=physics)
    roll = PianoRoll.from_score(score, CONTROL_TIMESTEP)
    qpos = np.tile(scene.model.qpos0, (len(roll) + 1, 1))
    qpos[1:, scene.key_qpos] = roll.active * scene.key_max_angle
    performance = Performance(
        roll=roll,
        key_active=roll.active,
        sustain=roll.sustain,
        strike_time=roll.onset_time,
        release_time=np.multiply(presses_of(roll.active).end, roll.control_timestep, dtype=float),
        press_finger=roll.finger,
        title=score.title,
    )
    # Green would hide the fingers' colours, and here nothing can be wrong.
    return Take(scene=scene, performance=performance, qpos=qpos, score=score, mark_sounding=False)


def write_take(
    take: Take, folder: Path, picture: Picture | None, progress: Progress | None = None
) -> Played:
    """Write a take's MIDI file, then its sound, then its video.

    Args:
        take: What to write.
        folder: Where; it is made if it is not there.
        picture: How the video looks; ``None`` for no video.
        progress: Is told how far the video is.

    Raises:
        RunError: If the folder cannot be written.
        ScoreError: If a file cannot be written.
    """
    midi, wav, video = (folder / f"performance.{suffix}" for suffix in ("mid", "wav", "mp4"))
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for stale in (midi, wav, video):
            stale.unlink(missing_ok=True)
    except OSError as error:
        raise RunError(
            f"'{folder}' cannot be written: {error.strerror}. Expected a folder."
        ) from error
    if take.score is not None:
        write_midi(take.score, midi)
    write_wav(wav, synthesize(take.score, at_least=take.duration))
    problem = None if picture is None else _write_video(take, video, wav, picture, progress)
    return Played(
        folder=folder,
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


def default_folder(run: str | os.PathLike[str] | None, score: Score | None) -> Path:
    """Return where a take is kept: of a run in its folder, of another piece by its title.

    Args:
        run: The run's folder; ``None`` if a piece plays itself.
        score: The piece; ``None`` if it is the run's own.
    """
    place = Path("play") if run is None else Path(run, "play")
    return place if score is None else place / _file_name(score.title)


def _file_name(title: str) -> str:
    return re.sub(r"[^\w.+-]+", "_", title).strip("._") or "piece"


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
