"""Takes: recorded performances with their motion, metrics and origin."""

from __future__ import annotations

import base64
import contextlib
import dataclasses
import functools
import html
import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from sb3_piano.array_files import read_arrays
from sb3_piano.arrays import Float32Array, FloatArray, IntArray
from sb3_piano.exceptions import ConfigError, RenderingError, RunError, one_line
from sb3_piano.files import write_atomically, write_text
from sb3_piano.links import make_folder
from sb3_piano.music import PianoRoll, Score, synthesize, write_midi, write_wav
from sb3_piano.music.constants import NUM_FINGERS
from sb3_piano.music.difficulty import MotionFeatures
from sb3_piano.music.roll import EarlyRelease
from sb3_piano.music.synthesis import mp3_bytes
from sb3_piano.performance import Performance
from sb3_piano.simulation import PianoScene, compile_scene
from sb3_piano.unfinished import scratch_folder
from sb3_piano.viewing.film import film, moment_count, moments
from sb3_piano.viewing.human_renderer import HumanRenderer
from sb3_piano.viewing.video import write_video
from sb3_piano.viewing.views import DEFAULT_PICTURE, Picture, View

SUFFIX = ".npz"
"""Suffix of the files."""

_FORMAT = 1
_MOST_BYTES = 2**28
"""Most bytes of a file's arrays; a control step takes less than 3000."""

_OF_PERFORMANCE = (
    "key_active",
    "sustain",
    "strike_time",
    "strike_speed",
    "release_time",
    "press_finger",
)
_OF_ROLL = ("active", "finger", "onset", "sustain", "onset_time", "onset_velocity")
_EXPECTED = "Expected a file that 'sb3-piano play' or 'evaluate --motion' wrote."


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """Motion of T control steps, and the actions that caused it."""

    actions: Float32Array
    """(T, n) the action of each step in the bare environment."""
    qpos: FloatArray
    """(T + 1, nq) all joint positions at the start and after each step, rad or m."""
    hand_qpos: IntArray
    """(m,) columns of ``qpos`` with the hands' joints; the others are keys."""
    fingertips: FloatArray
    """(T + 1, 10, 3) world positions of the fingertips at the same times, in the order of finger
    labels, m. They are constant for a missing hand."""

    def features(self) -> MotionFeatures:
        """Compute the amounts of motion.

        Raises:
            ConfigError: If the arrays do not fit together, or a value is not finite.
        """
        self.check()
        joints = self.qpos[:, self.hand_qpos]
        return MotionFeatures(
            action_variance=float(np.var(self.actions, axis=0, dtype=np.float64).mean()),
            hand_motion=float(np.abs(np.diff(joints, axis=0)).mean()),
            fingertip_motion=float(
                np.linalg.norm(np.diff(self.fingertips, axis=0), axis=-1).mean()
            ),
        )

    def check(self) -> None:
        """Check that the arrays fit together and have only finite values.

        Raises:
            ConfigError: If they do not.
        """
        rows, hands = len(self.actions) + 1, self.hand_qpos
        expected = (rows, NUM_FINGERS, 3)
        if self.actions.ndim != 2 or self.actions.size == 0:
            problem = f"actions have shape {self.actions.shape}: expected (T, n), T steps from 1"
        elif self.qpos.ndim != 2 or len(self.qpos) != rows:
            problem = f"qpos has shape {self.qpos.shape}: expected ({rows}, nq), a row more"
        elif hands.ndim != 1 or hands.dtype.kind not in "iu" or not len(hands):
            problem = f"hand_qpos is {hands}: expected indices of columns of qpos"
        elif not 0 <= hands.min() <= hands.max() < self.qpos.shape[1]:
            problem = f"hand_qpos is {hands}: expected indices of the {self.qpos.shape[1]} columns"
        elif self.fingertips.shape != expected:
            problem = f"fingertips have shape {self.fingertips.shape}: expected {expected}"
        elif not all(np.isfinite(a).all() for a in (self.actions, self.qpos, self.fingertips)):
            problem = "a value is not finite: expected numbers only"
        else:
            return
        raise ConfigError(f"The motion of a take is unusable: {problem}.")


@dataclass(frozen=True, kw_only=True, eq=False)
class Take:
    """A recorded performance: sound, motion, metrics, player and environment.

    Roll-outs yield takes. One with a motion can be written to a file by :meth:`write`, which
    commands accept in place of a player.
    """

    title: str = ""
    """Title of the piece; empty if the environment is no piano."""
    metrics: Mapping[str, float]
    """``return``, ``length`` in steps and, for pianos, the music metrics and the sums of the
    reward's weighted terms, by their names in ``info``."""
    performance: Performance | None = None
    """Sound and due notes; ``None`` if the environment is no piano."""
    motion: Motion | None = None
    """The motion; ``None`` likewise."""
    scene_options: Mapping[str, Any] = field(default_factory=dict)
    """Arguments of :func:`~sb3_piano.simulation.compile_scene` for its scene."""
    player: str = ""
    """The player, as the text of a :class:`~sb3_piano.players.PlayerSpec`."""
    env: Mapping[str, Any] = field(default_factory=dict)
    """Id, options and wrappers of the environment, in JSON's types."""
    seed: int | None = None
    """The seed of the roll-out."""
    versions: Mapping[str, str] = field(default_factory=dict)
    """Versions of the packages it was played with."""
    written_score: Score | None = None
    """Notes to hear in place of the played ones, if any."""
    judged: bool = True
    """Whether pictures show right and wrong keys, and the F1 so far."""

    @functools.cached_property
    def scene(self) -> PianoScene:
        """The scene of the performance."""
        return compile_scene(**self.scene_options)

    @functools.cached_property
    def score(self) -> Score | None:
        """The audible notes; ``None`` if no key was pressed."""
        if self.written_score is not None or self.performance is None:
            return self.written_score
        return self.performance.to_score()

    @property
    def piano(self) -> Performance:
        """The performance of a piano.

        Raises:
            RunError: If the environment was no piano.
        """
        if self.performance is None or self.motion is None:
            raise RunError("This take is of no piano: expected one with a performance and motion.")
        return self.performance

    @property
    def qpos(self) -> FloatArray:
        """(t + 1, nq) joint positions at the start and after each control step, rad or m."""
        assert self.motion is not None, "a piano's take has a motion"
        return self.motion.qpos

    @property
    def period(self) -> float:
        """Time between two pictures, s."""
        return self.piano.roll.control_timestep

    @property
    def duration(self) -> float:
        """Duration of its pictures, s."""
        return len(self.qpos) * self.period

    @property
    def f1(self) -> float:
        """F1 of the keys, step by step."""
        return self.metrics["f1"]

    @property
    def onset_f1(self) -> float:
        """F1 of the strikes, within 50 ms."""
        return self.metrics["onset_f1"]

    def musicianship(self, score: Score | None = None) -> dict[str, float]:
        """Compute endings, loudness, chords, timing, legato and pedal by name; NaN if undefined.

        They are the numbers of :meth:`~sb3_piano.performance.Performance.musicianship`.

        Args:
            score: The piece, for a take that was recorded without it.

        Raises:
            RunError: If the piece is neither known nor given, or the environment was no piano.
        """
        return self.piano.musicianship(score)

    def save_midi(self, path: str | os.PathLike[str]) -> None:
        """Write the notes and the pedal as a MIDI file of one track.

        Raises:
            RunError: If no key was pressed.
            ScoreError: If the file cannot be written.
        """
        if self.score is None:
            raise RunError("No key was pressed in this take: expected notes for a MIDI file.")
        write_midi(self.score, path, by_finger=False)

    def save_wav(self, path: str | os.PathLike[str]) -> None:
        """Write the sound, with the loudness of the strikes.

        Raises:
            ScoreError: If the file cannot be written.
        """
        write_wav(path, synthesize(self.score, at_least=self.duration))

    def save_video(self, path: str | os.PathLike[str], picture: Picture = DEFAULT_PICTURE) -> None:
        """Write a video with sound.

        Raises:
            RenderingError: If this machine cannot draw; the message says what to install.
        """
        with scratch_folder() as folder:
            sound = Path(folder, "sound.wav")
            self.save_wav(sound)
            _write_video(self, Path(path), sound, picture, None)

    def save_report(
        self, path: str | os.PathLike[str], *, replay: bool = False, **about: Any
    ) -> None:
        """Write an HTML page about the performance, optionally with a replay in three dimensions.

        Args:
            path: The file.
            replay: Whether to add the replay in three dimensions.
            **about: Further fields of :class:`~sb3_piano.viewing.report.Report`, such as
                ``baseline`` and ``facts``.

        Raises:
            ConfigError: If this installation lacks the replay's script.
        """
        from sb3_piano.viewing.report import Report, report_html
        from sb3_piano.viewing.report.replay import player_script, replay_of

        script = player_script() if replay else None
        shown = None
        if script is not None:
            shown = replay_of(self.scene, self.qpos, self.piano, self.metrics, script)
        given = {"subtitle": f"{self.player} · seed {self.seed}", "facts": self._facts(), **about}
        report = Report(performance=self.piano, metrics=self.metrics, replay=shown, **given)
        write_text(Path(path), report_html(report))

    def _facts(self) -> list[tuple[str, str]]:
        versions = ", ".join(f"{name} {version}" for name, version in self.versions.items())
        facts = {"Piece": self.title, "Environment": self.env.get("id"), "Player": self.player}
        return [
            *((name, str(fact)) for name, fact in facts.items() if fact),
            ("Seed", str(self.seed)),
            ("Played with", versions or "unknown"),
        ]

    def _repr_html_(self) -> str:
        """Return the view of a notebook: player, metrics, and the sound."""
        sound = mp3_bytes(synthesize(self.score, at_least=self.duration))
        data = base64.b64encode(sound).decode()
        text = f"{self.title}, {self.player}: F1 {self.f1:.3f}, onset F1 {self.onset_f1:.3f}"
        player = f'<audio controls src="data:audio/mpeg;base64,{data}"></audio>'
        return f"<p>{html.escape(text)}</p>{player}"

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the take to a file; an existing one is replaced.

        Raises:
            ConfigError: If the file cannot be written.
        """
        performance, motion, roll = self.piano, self.motion, self.piano.roll
        own = ("title", "metrics", "scene_options", "player", "env", "seed", "versions")
        header = {
            "format": _FORMAT,
            **{name: getattr(self, name) for name in own},
            "control_timestep": roll.control_timestep,
            "early_releases": [dataclasses.asdict(early) for early in roll.early_releases],
        }
        arrays = {f"performance_{name}": getattr(performance, name) for name in _OF_PERFORMANCE}
        arrays |= {f"roll_{name}": getattr(roll, name) for name in _OF_ROLL}
        arrays |= vars(motion)
        if performance.score is not None:
            arrays["score"] = _packed(dataclasses.asdict(performance.score))
        write: Any = np.savez_compressed  # its stub takes the names of arrays for options
        try:
            write_atomically(Path(path), lambda file: write(file, header=_packed(header), **arrays))
        except OSError as error:
            raise ConfigError(
                f"Cannot write '{path}': {error.strerror}; expected a file in a writable folder."
            ) from error

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Take:
        """Read a take from a file. A file of version 0.2 has only title and motion.

        Raises:
            ConfigError: If there is no such file, or it is not a take.
        """
        if not os.path.isfile(path):
            raise ConfigError(f"There is no take '{path}': expected an existing {SUFFIX} file.")
        try:
            arrays: dict[str, Any] = read_arrays(path, most=_MOST_BYTES)
            motion = Motion(**{one.name: arrays[one.name] for one in dataclasses.fields(Motion)})
            motion.check()
            if "header" not in arrays:
                if arrays["title"].ndim != 0 or arrays["title"].dtype.kind != "U":
                    raise ValueError("its title is no text")
                return cls(title=str(arrays["title"]), metrics={}, motion=motion)
            header = json.loads(arrays["header"].tobytes())
            return cls._of_file(header, arrays, motion)
        except Exception as error:  # zipfile and NumPy raise any error for a damaged archive
            said = one_line(error).rstrip(".")
            raise ConfigError(f"'{path}' is no take: {said}. {_EXPECTED}") from error

    @classmethod
    def _of_file(cls, header: dict[str, Any], arrays: Mapping[str, Any], motion: Motion) -> Take:
        if header.pop("format") != _FORMAT:
            raise ValueError("its format is of another version")
        early = tuple(EarlyRelease(**one) for one in header.pop("early_releases"))
        roll = PianoRoll(
            control_timestep=header.pop("control_timestep"),
            early_releases=early,
            # Takes of earlier versions have no velocities.
            **{n: arrays[f"roll_{n}"] for n in _OF_ROLL if f"roll_{n}" in arrays},
        )
        score = json.loads(arrays["score"].tobytes()) if "score" in arrays else None
        performance = Performance(
            roll=roll,
            title=header["title"],
            score=None if score is None else Score.from_fields(score),
            **{name: arrays[f"performance_{name}"] for name in _OF_PERFORMANCE},
        )
        steps, presses = len(motion.actions), len(performance.presses.key)
        shapes = {"key_active": (steps, 88), "sustain": (steps,), "press_finger": (steps, 88)}
        shapes |= dict.fromkeys(("strike_time", "strike_speed", "release_time"), (presses,))
        for name, expected in shapes.items():
            if (found := getattr(performance, name).shape) != expected:
                raise ValueError(f"{name} has shape {found}, not {expected}")
        options = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in header.pop("scene_options").items()
        }
        take = cls(performance=performance, motion=motion, scene_options=options, **header)
        if take.qpos.shape[1] != take.scene.model.nq:
            raise ValueError(f"its scene has {take.scene.model.nq} joints")
        return take


def _packed(content: Any) -> npt.NDArray[np.uint8]:
    """Return JSON as an array of a file."""
    return np.frombuffer(json.dumps(content).encode(), dtype=np.uint8)


Progress = Callable[[int, int], object]
"""Called with the number of finished pictures, and the total."""


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
    """The take itself, which commands read; ``None`` without a player."""
    video: Path | None
    """The video with sound; ``None`` if not requested or not possible here."""
    problem: str | None
    """Reason why a requested video could not be made."""


def write_take(
    take: Take, base: Path, picture: Picture | None, progress: Progress | None = None
) -> Played:
    """Write a take's MIDI file, the take, its sound and its video; existing ones are replaced.

    Args:
        take: The take to write.
        base: Path of the files without their suffixes; its folder is created if missing.
        picture: Size and view of the video; ``None`` for no video.
        progress: Called with the number of finished pictures, and the total.

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
        write_midi(take.score, midi, by_finger=False)
    if take.player:
        take.write(whole)
    write_wav(wav, synthesize(take.score, at_least=take.duration))
    problem = None
    if picture is not None:
        try:
            _write_video(take, video, wav, picture, progress)
        except RenderingError as error:
            problem = str(error)
    return Played(
        folder=base.parent,
        midi=None if take.score is None else midi,
        wav=wav,
        take=whole if take.player else None,
        video=None if picture is None or problem is not None else video,
        problem=problem,
    )


def show_take(take: Take, *, view: View = "stage") -> None:
    """Show a take in a window, in real time and without sound, until it ends or is closed.

    Raises:
        RenderingError: If there is no screen; the message gives the remedy.
    """
    renderer = HumanRenderer(take.scene, fps=1 / take.period, view=view)
    with contextlib.closing(renderer):
        for moment in moments(take):
            renderer.render(take.piano.roll, "", moment)
            if not renderer.is_running:
                break


def _write_video(
    take: Take, path: Path, audio: Path, picture: Picture, progress: Progress | None
) -> None:
    total, size = moment_count(take, picture.fps), (picture.width, picture.height)
    tell = None if progress is None else lambda done: progress(done, total)
    if tell is not None:
        tell(0)
    with contextlib.closing(film(take, picture)) as frames:
        write_video(path, frames, picture.fps, audio, size, progress=tell)
