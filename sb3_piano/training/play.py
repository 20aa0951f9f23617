"""Watch and hear: a run's model plays, or a piece plays itself, into MIDI, sound and video."""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np

from sb3_piano.envs import PianoEnv, PianoEnvConfig, Recording
from sb3_piano.exceptions import RunError
from sb3_piano.metrics import presses_of
from sb3_piano.music import PianoRoll, Score, load_score
from sb3_piano.performance import Performance
from sb3_piano.simulation import PianoScene, compile_scene
from sb3_piano.training.playing import SavedPlayer
from sb3_piano.viewing import DEFAULT_PICTURE, Picture, Played, Progress, Take, write_take

FILE_NAME = "performance"
"""What the files are called, without their suffixes."""


def play_run(
    run: str | os.PathLike[str],
    out: str | os.PathLike[str] | None = None,
    *,
    seed: int = 0,
    physics: str | None = None,
    score: Score | str | os.PathLike[str] | None = None,
    best: str | None = None,
    picture: Picture | None = DEFAULT_PICTURE,
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
        best: Play the best model by this metric, such as "f1", in place of the last one.
        picture: How the video looks; ``None`` for no video.
        progress: Is told how far the video is.

    Raises:
        ConfigError: If a setting is out of range, or the run's config is damaged.
        RunError: If there is no run, it has no model that can be loaded, it is no piano's, it
            cannot play the piece, or the folder cannot be written.
        ScoreError: If the score cannot be read, or a file cannot be written.
    """
    piece = None if score is None else load_score(score)
    take = take_of_run(run, seed=seed, physics=physics, score=piece, best=best)
    folder = default_folder(run, piece) if out is None else Path(out)
    return write_take(take, folder / FILE_NAME, picture, progress)


def play_score(
    score: Score | str | os.PathLike[str],
    out: str | os.PathLike[str] | None = None,
    *,
    physics: str = "reference",
    picture: Picture | None = DEFAULT_PICTURE,
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
        UnknownPieceError: If ``score`` is neither a piece's name nor a file.
    """
    piece = load_score(score)
    folder = default_folder(None, piece) if out is None else Path(out)
    take = take_of_score(piece, physics=physics)
    return write_take(take, folder / FILE_NAME, picture, progress)


def take_of_run(
    run: str | os.PathLike[str],
    *,
    seed: int = 0,
    physics: str | None = None,
    score: Score | None = None,
    best: str | None = None,
) -> Take:
    """Return an episode of a run's saved model; arguments and errors as of :func:`play_run`."""
    with SavedPlayer.open(run, seed=seed, physics=physics, score=score, best=best) as player:
        env = player.env
        if not isinstance(env, PianoEnv):
            raise RunError(
                f"Run '{run}' cannot be watched: its environment {player.config.env_id!r} is no "
                "piano. Expected a run of a piano environment."
            )
        (recording,) = player.play()
    return take_of_recording(env.scene, recording)


def take_of_recording(scene: PianoScene, recording: Recording) -> Take:
    """Return a piano's episode as it is shown."""
    performance, motion = recording.performance, recording.motion
    assert performance is not None, "a piano's episode has a performance"
    assert motion is not None, "a piano's episode has a motion"
    return Take.of(scene, performance, motion.qpos)


def take_of_score(score: Score, *, physics: str = "reference") -> Take:
    """Return a piece that plays itself, exactly as it is written."""
    scene = compile_scene(physics=physics)
    roll = PianoRoll.from_score(score, PianoEnvConfig.control_timestep)
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
