"""The files that an evaluation leaves of what was played: MIDI, and how everything moved."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from sb3_piano.envs import Recording
from sb3_piano.exceptions import RunError
from sb3_piano.music import Score, write_midi
from sb3_piano.music.difficulty import MotionRecording, write_motion
from sb3_piano.training.run_folder import RunFolder


def clear_performances(run: RunFolder) -> None:
    """Make the folder for the files, without those that were there.

    Raises:
        RunError: If that is not possible.
    """
    try:
        run.evaluation_dir.mkdir(exist_ok=True)
        for kind in ("mid", "npz"):
            for stale in run.evaluation_dir.glob(f"performance_*.{kind}"):
                stale.unlink()
    except OSError as error:
        raise RunError(
            f"'{run.evaluation_dir}' cannot be written: {error.strerror}. Expected a folder."
        ) from error


def write_performances(run: RunFolder, scores: Sequence[Score | None]) -> tuple[Path | None, ...]:
    """Write a MIDI file for each episode, numbered from 1 on; none where nothing was played."""
    paths = [_file(run, number, "mid") for number in range(1, len(scores) + 1)]
    for score, path in zip(scores, paths, strict=True):
        if score is not None:
            write_midi(score, path)
    return tuple(None if score is None else path for score, path in zip(scores, paths, strict=True))


def write_motions(run: RunFolder, motions: Sequence[MotionRecording]) -> tuple[Path, ...]:
    """Write how everything moved in each episode, numbered as the MIDI files are."""
    paths = tuple(_file(run, number, "npz") for number in range(1, len(motions) + 1))
    for motion, path in zip(motions, paths, strict=True):
        write_motion(motion, path)
    return paths


def motion_recording(recording: Recording, piece: str) -> MotionRecording:
    """Return what is written of an episode's motion.

    Args:
        recording: An episode of a piano environment.
        piece: The name of what is played, of several pieces joined by "or".
    """
    played, motion = recording.performance, recording.motion
    assert played is not None, "a piano's episode has a performance"
    assert motion is not None, "a piano's episode has motion"
    # A score file that was copied into the run's folder has lost its title.
    known = played.title in piece.split(" or ")
    return MotionRecording(
        title=played.title if known else piece,
        actions=motion.actions,
        qpos=motion.qpos,
        hand_qpos=motion.hand_qpos,
        fingertips=motion.fingertips,
    )


def _file(run: RunFolder, number: int, kind: str) -> Path:
    return run.evaluation_dir / f"performance_{number}.{kind}"
