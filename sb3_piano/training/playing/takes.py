"""Takes: play with a player or the score itself, write MIDI, sound and video; write plans."""

from __future__ import annotations

import contextlib
import itertools
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sb3_piano.envs import PianoEnv, PianoEnvConfig
from sb3_piano.exceptions import ConfigError
from sb3_piano.jobs.folders import unwritable
from sb3_piano.links import make_folder
from sb3_piano.metrics import presses_of
from sb3_piano.music import PianoRoll, Score, load_score
from sb3_piano.music.constants import NUM_FINGERS
from sb3_piano.performance import Performance
from sb3_piano.planning import PlanSettings, Refinement
from sb3_piano.planning.plan_file import save_plan, settings_of_plan
from sb3_piano.planning.refinement import OnStep
from sb3_piano.players import PlayerSpec
from sb3_piano.players.hand_model import SIGHT_READER
from sb3_piano.players.planned import PlannedPianist
from sb3_piano.settings import Index, checked
from sb3_piano.simulation import compile_scene
from sb3_piano.take import Motion, Played, Progress, Take, write_take
from sb3_piano.training.configuration.env_spec import EnvSpec
from sb3_piano.training.playing.player import OpenPlayer, Source, stage_for
from sb3_piano.viewing import Picture
from sb3_piano.viewing.views import DEFAULT_PICTURE

FILE_NAME = "performance"
"""Name of the files, without suffixes."""


def play_run(
    player: PlayerSpec | str | os.PathLike[str],
    out: str | os.PathLike[str] | None = None,
    env: EnvSpec | None = None,
    *,
    seed: int = 0,
    physics: str | None = None,
    score: Source | None = None,
    best: str | None = None,
    picture: Picture | None = DEFAULT_PICTURE,
    progress: Progress | None = None,
) -> Played:
    """Play one episode with a saved run or another player, and write MIDI, sound and video.

    Writes ``performance.mid``, ``performance.wav`` and ``performance.mp4``, and replaces former
    ones. A machine that cannot render writes no video.

    Args:
        player: The run's folder, or the spec of another player, such as ``"sight-reader"``.
        out: Output folder; by default :func:`default_folder`.
        env: Environment, as for :meth:`~sb3_piano.training.OpenPlayer.open`, like the next four
            arguments.
        seed: Seed of environment and player.
        physics: Name of the physics profile.
        score: Piece to play.
        best: Metric of a run's best model.
        picture: Settings of the video; ``None`` for no video.
        progress: Called with the progress of the video.

    Raises:
        ConfigError: If a setting is out of range, or the run's config is damaged.
        RunError: If there is no run, its model cannot be loaded, its environment is no piano, it
            cannot play the piece, or the folder cannot be written.
        ScoreError: If the score cannot be read, or a file cannot be written.
    """
    piece = None if score is None else load_score(score)
    with OpenPlayer.open(player, env, seed=seed, physics=physics, score=piece, best=best) as opened:
        take = take_of(opened)
        folder = default_folder(opened, piece) if out is None else Path(out)
    return write_take(take, folder / FILE_NAME, picture, progress)


def play_score(
    score: Score | str | os.PathLike[str],
    out: str | os.PathLike[str] | None = None,
    *,
    physics: str = "reference",
    picture: Picture | None = DEFAULT_PICTURE,
    progress: Progress | None = None,
) -> Played:
    """Show a score without a player: keys go down in their fingers' colours, the hands rest.

    Writes the same files as :func:`play_run`, with the notes as written. Arguments and errors are
    the same; :func:`~sb3_piano.music.load_score` reads the score, and the default folder is
    ``play/<title>``.
    """
    piece = load_score(score)
    folder = default_folder(None, piece) if out is None else Path(out)
    return write_take(take_of_score(piece, physics=physics), folder / FILE_NAME, picture, progress)


def play(
    score: Source,
    player: PlayerSpec | str | os.PathLike[str] = SIGHT_READER,
    *,
    seed: int = 0,
    **options: Any,
) -> Take:
    """Play a piece with a player, and return the take.

    ::

        take = sb3_piano.play("my.mid")
        print(take.f1, take.onset_f1)
        take.save_video("my.mp4")

    Args:
        score: A file such as MIDI, the name of a piece, or a score.
        player: The player, see :class:`~sb3_piano.players.PlayerSpec`.
        seed: Seed of environment and player.
        **options: Options of the environment, such as ``physics="fast"``; for a run only that one.

    Raises:
        ConfigError: If there is no such player, or an option is not valid.
        RunError: If a run cannot play the piece.
        ScoreError: If the score cannot be read.
    """
    spec = player if isinstance(player, PlayerSpec) else PlayerSpec.parse(player)
    stage = None if spec.is_run else stage_for(score, **options)
    given = {"score": score, **options} if spec.is_run else {}
    with OpenPlayer.open(spec, stage, seed=seed, **given) as opened:
        return take_of(opened)


def default_folder(player: OpenPlayer | None, score: Score | None) -> Path:
    """Return the default folder of a take: in the run's folder, or by piece and player.

    No player means the piece as written; no score means the player's own piece.
    """
    place = Path("play") if player is None or player.run is None else player.run.path / "play"
    if score is None and (player is None or player.run is not None):
        return place
    title = str(player.piece if score is None and player is not None else score and score.title)
    by = "" if player is None or player.run is not None else f"-{player.spec.label}"
    return place / f"{_file_name(title)}{by}"


def folder_of(take: Take) -> Path:
    """Return the default folder for files made from a take, by piece and player."""
    by = re.sub(r"[^\w.+-]+", "-", take.player.rpartition("/")[2]).strip("-")
    return Path("play", f"{_file_name(take.title)}-{by or 'take'}")


def plan_file(env: EnvSpec) -> Path:
    """Return the default file of the plan of an environment's piece.

    Raises:
        ConfigError: If no piece is named.
    """
    played = env.all_options.get("score")
    title = load_score(played).title if played is not None else env.id
    return Path("play", f"{_file_name(title)}-planned", "plan.npz")


def _file_name(title: str) -> str:
    return re.sub(r"[^\w.+-]+", "_", title).strip("._") or "piece"


def take_of(player: OpenPlayer, on_step: Callable[[int, int], object] | None = None) -> Take:
    """Play one episode and return it.

    ``on_step`` gets the number of finished control steps and their total.

    Raises:
        RunError: If its environment is no piano.
    """
    piano, done = player.piano, itertools.count(1)

    def step(_: object) -> None:
        if on_step is not None:
            on_step(next(done), len(piano.roll))

    return next(player.episodes(1, on_step=step))


def take_of_score(score: Score, *, physics: str = "reference") -> Take:
    """Return a take of a score exactly as written, with resting hands."""
    scene = compile_scene(physics=physics)
    roll = PianoRoll.from_score(score, PianoEnvConfig.control_timestep)
    qpos = np.tile(scene.model.qpos0, (len(roll) + 1, 1))
    qpos[1:, scene.key_qpos] = roll.active * scene.key_max_angle
    performance = Performance(
        roll=roll,
        key_active=roll.active,
        sustain=roll.sustain,
        strike_time=roll.onset_time,
        strike_speed=np.full(len(roll.onset_time), np.nan),
        release_time=np.multiply(presses_of(roll.active).end, roll.control_timestep, dtype=float),
        press_finger=roll.finger,
        title=score.title,
        score=score,
    )
    steps, tips = len(roll), np.zeros((len(qpos), NUM_FINGERS, 3))
    actions = np.zeros((steps, scene.model.nu), dtype=np.float32)
    motion = Motion(actions=actions, qpos=qpos, hand_qpos=scene.hand_qpos, fingertips=tips)
    # Without judgement keys keep the fingers' colours; here no key can be wrong.
    return Take(
        title=score.title,
        metrics={},
        performance=performance,
        motion=motion,
        scene_options=scene.options,
        written_score=score,
        judged=False,
    )


class Planned(NamedTuple):
    """Result of :func:`write_plan`."""

    piece: str
    """The piece's title."""
    passes: int
    """Total passes of refinement, including earlier calls."""
    before: float
    """F1 of the plan in simulation before the refinement."""
    f1: float
    """F1 of the best plan."""


def write_plan(
    env: EnvSpec,
    file: str | os.PathLike[str],
    settings: PlanSettings | None = None,
    *,
    seed: int = 0,
    minutes: float | None = None,
    passes: int | None = 0,
    on_step: OnStep = lambda done, total, f1: None,
    should_stop: Callable[[], bool] = lambda: False,
) -> Planned:
    """Plan a piece and refine the plan, see :class:`~sb3_piano.planning.Refinement`.

    The best plan is written to the file after each pass. An existing plan is refined further.

    Args:
        env: Environment of the piece.
        file: File of the plan, for ``planned:plan=FILE``.
        settings: Settings of a new plan.
        seed: Seed of the refinement.
        minutes: Limit of the refinement's wall-clock time, min.
        passes: Limit of the number of passes; ``None`` for no limit.
        on_step: Called with the progress of a pass.
        should_stop: Returns whether to end soon.

    Raises:
        ConfigError: If the file holds another piece's plan, or something else.
        RunError: If the file cannot be written.
    """
    checked("seed", seed, Index)
    path = Path(file)
    known = str(path) if path.is_file() else None
    if known is not None:
        noted = settings_of_plan(path)
        if settings not in (None, noted):
            raise ConfigError(
                f"The plan '{path}' was made with {noted}: expected these settings, or another "
                "file."
            )
        settings = noted
    with contextlib.closing(env.make()) as made:
        piano = made.unwrapped
        assert isinstance(piano, PianoEnv), "planners play nothing else"
        player = PlannedPianist(made, settings, plan=known)
        made.reset(seed=seed)
        roll = piano.goal.fingered_roll
        refinement = Refinement(player.plan(), piano.scene, player.settings, seed=seed)
        before = refinement.f1

        def keep() -> None:
            plan, f1 = refinement.plan, refinement.f1
            try:
                make_folder(path.parent)
                save_plan(path, plan, roll, piano.scene, player.settings, f1=f1)
            except OSError as error:
                raise unwritable(path.parent, error) from error

        keep()
        refinement.run(minutes, passes, on_step=on_step, on_pass=keep, should_stop=should_stop)
        return Planned(piano.score.title, refinement.plan.passes, before, refinement.f1)
