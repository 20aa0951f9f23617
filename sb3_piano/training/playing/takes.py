"""Takes: a run's model, a planner or the piece itself plays, into MIDI, sound and video."""

from __future__ import annotations

import contextlib
import os
import re
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

from sb3_piano.callbacks.own_env import EnvWrapper
from sb3_piano.envs import GENERAL_ID, EpisodeRecorder, PianoEnv, PianoEnvConfig, Recording
from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.metrics import presses_of
from sb3_piano.music import PianoRoll, Score, is_path, load_score
from sb3_piano.performance import Performance
from sb3_piano.planning import PianoPolicy, PlannedPianist, Refinement, save_plan
from sb3_piano.planning.policy import roll_with_fingers
from sb3_piano.planning.refinement import OnStep
from sb3_piano.players import TreeSearch, TreeSettings
from sb3_piano.simulation import PianoScene, compile_scene
from sb3_piano.training.configuration.config import PlannedConfig
from sb3_piano.training.playing.player import SavedPlayer
from sb3_piano.training.runs.builders import build_planner
from sb3_piano.training.runs.folder import RunFolder
from sb3_piano.viewing import DEFAULT_PICTURE, Picture, Played, Progress, Take, write_take

FILE_NAME = "performance"
"""Name of the files, without their suffixes."""

PLANNED_IN: Mapping[str, Any] = {
    "reduced_action_space": False,
    "initial_buffer_time": 0.5,
    "fingering": "robot",
}
"""Options of the environments in which planners play unless told otherwise: all joints, half a
second to get to the first note, and the fingers that suit the hands."""


def play_run(
    run: str | os.PathLike[str],
    out: str | os.PathLike[str] | None = None,
    *,
    seed: int = 0,
    physics: str | None = None,
    score: Score | str | os.PathLike[str] | None = None,
    best: str | None = None,
    tree: TreeSettings | None = None,
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
        tree: Let the model look ahead, see :class:`~sb3_piano.players.TreeSearch`.
        picture: How the video looks; ``None`` for no video.
        progress: Is told how far the video is.

    Raises:
        ConfigError: If a setting is out of range, or the run's config is damaged.
        RunError: If there is no run, it has no model that can be loaded, it is no piano's, it
            cannot play the piece, or the folder cannot be written.
        ScoreError: If the score cannot be read, or a file cannot be written.
    """
    piece = None if score is None else load_score(score)
    take = take_of_run(run, seed=seed, physics=physics, score=piece, best=best, tree=tree)
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

    Writes the same files as :func:`play_run`, which show what should be played. Arguments and
    errors are those of it; the score is what :func:`~sb3_piano.music.load_score` accepts, and goes
    to ``play/<title>`` by default.
    """
    piece = load_score(score)
    folder = default_folder(None, piece) if out is None else Path(out)
    return write_take(take_of_score(piece, physics=physics), folder / FILE_NAME, picture, progress)


def default_folder(run: str | os.PathLike[str] | None, score: Score | None) -> Path:
    """Return where a take is kept: of a run in its folder, of another piece by its title.

    Without a run a piece plays itself; without a score it is the run's own.
    """
    place = Path("play") if run is None else Path(run, "play")
    if score is None:
        return place
    return place / (re.sub(r"[^\w.+-]+", "_", score.title).strip("._") or "piece")


def take_of_run(
    run: str | os.PathLike[str],
    *,
    seed: int = 0,
    physics: str | None = None,
    score: Score | None = None,
    best: str | None = None,
    tree: TreeSettings | None = None,
) -> Take:
    """Return an episode of a run's saved model; arguments and errors as of :func:`play_run`."""
    with SavedPlayer.open(
        run, seed=seed, physics=physics, score=score, best=best, tree=tree
    ) as player:
        if not isinstance(player.env, PianoEnv):
            raise RunError(
                f"Run '{run}' cannot be watched: its environment {player.config.env_id!r} is no "
                "piano. Expected a run of a piano environment."
            )
        (recording,) = player.play()
        return _take_of_recording(player.env.scene, recording)


def _take_of_recording(scene: PianoScene, recording: Recording) -> Take:
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
        strike_speed=np.full(len(roll.onset_time), np.nan),
        release_time=np.multiply(presses_of(roll.active).end, roll.control_timestep, dtype=float),
        press_finger=roll.finger,
        title=score.title,
    )
    # Green would hide the fingers' colours, and here nothing can be wrong.
    return Take(scene=scene, performance=performance, qpos=qpos, score=score, mark_sounding=False)


@dataclass(frozen=True, kw_only=True)
class PlannedTake:
    """Result of :func:`take_of_planner`."""

    take: Take
    """Pictures and sound."""
    score: Score
    """Score that should have been played."""
    metrics: Mapping[str, float]
    """Metrics, by their names in ``info``."""
    planning: float
    """Time until the first command, s."""
    playing: float
    """Time of the others, s."""


def where_played(what: str) -> tuple[str, dict[str, Any]]:
    """Return the environment that plays a piece, a file or is named itself, and its options."""
    if what in gym.registry:
        return what, {}
    if is_path(what) and not os.path.exists(what):
        raise ConfigError(
            f"There is no {what!r}: expected an environment's id, a file such as a MIDI file, or "
            "the name of a piece (see 'sb3-piano pieces list')."
        )
    return GENERAL_ID, {"score": what}


def planner_config(
    what: str,
    algo: str = "planned",
    *,
    seed: int = 0,
    env_kwargs: Mapping[str, Any] | None = None,
    **arguments: Any,
) -> PlannedConfig:
    """Return the settings of a run that plays without training.

    Args:
        what: An environment's id, a file such as MIDI, or a piece by its name.
        algo: One of :data:`~sb3_piano.training.PLANNERS`.
        seed: Seeds the environment and what is drawn at random, at least 0.
        env_kwargs: Options of the environment, before those of :data:`PLANNED_IN`.
        **arguments: Arguments of the planner, such as ``samples``, in plain values.
    """
    env_id, options = where_played(what)
    return PlannedConfig(
        algo=algo,
        env_id=env_id,
        seed=seed,
        env_kwargs={**PLANNED_IN, **options, **(env_kwargs or {})},
        algorithm_kwargs=arguments,
    )


def plan_run(
    config: PlannedConfig,
    folder: str | os.PathLike[str] | None = None,
    *,
    runs_dir: str | os.PathLike[str] = "runs",
) -> tuple[RunFolder, str, float]:
    """Make the folder of a run without training; return it, the piece's name, and seconds.

    The plan is made, so that a :class:`~sb3_piano.exceptions.PlanWarning` tells what cannot be
    played; it is not kept, as making it again takes those seconds. Folders are those of
    :func:`~sb3_piano.training.train`.
    """
    with (
        RunFolder.making(config, folder, runs_dir) as run,
        _planner(config) as (player, env, piano),
    ):
        observation, _ = env.reset(seed=config.seed)
        start = time.perf_counter()
        player.predict(observation)
        return run, piano.score.title, time.perf_counter() - start


class Refined(NamedTuple):
    """Result of :func:`refine_run`."""

    passes: int
    """Passes in all, those of before included."""
    before: float
    """F1 of the plan in simulation as it was before."""
    f1: float
    """F1 of the best plan."""


def refine_run(
    run: RunFolder,
    *,
    minutes: float | None = None,
    passes: int | None = None,
    on_step: OnStep = lambda done, total, f1: None,
    should_stop: Callable[[], bool] = lambda: False,
) -> Refined:
    """Refine the plan of a run of the planned pianist, see :class:`~sb3_piano.planning.Refinement`.

    The best plan is kept as the run's ``plan.npz`` after each pass, and followed from then on; a
    run that has one goes on from it.

    Args:
        run: The run.
        minutes: For how long at most, min of the clock.
        passes: How often the piece is played at most.
        on_step: Is told how far a pass is.
        should_stop: Whether to end soon.

    Raises:
        RunError: If the run is of something else.
    """
    config = run.read_config()
    if not isinstance(config, PlannedConfig) or config.algo != "planned":
        raise RunError(
            f"Run '{run.path}' is of {config.algo!r}: expected a run of the planned pianist, which "
            "'sb3-piano plan PIECE' makes without --sampling."
        )
    with run.owned(), _planner(config) as (player, env, piano):
        assert isinstance(player, PlannedPianist), "this is the planned pianist"
        env.reset(seed=config.seed)
        settings, roll = player.settings, roll_with_fingers(piano)
        refinement = Refinement(
            player.plan(),
            piano.scene,
            settings,
            seed=config.seed or 0,
        )
        before = refinement.f1

        def keep() -> None:
            plan, f1 = refinement.plan, refinement.f1
            save_plan(run.plan_file, plan, roll, piano.scene, settings, f1=f1)
            run.write_config(config.playing(plan=str(run.plan_file)))

        with contextlib.closing(refinement):
            refinement.run(minutes, passes, on_step=on_step, on_pass=keep, should_stop=should_stop)
        return Refined(refinement.plan.passes, before, refinement.f1)


def take_of_planner(
    config: PlannedConfig,
    on_step: Callable[[int, int], object] = lambda done, total: None,
    *,
    tree: TreeSettings | None = None,
    innermost: EnvWrapper | None = None,
) -> PlannedTake:
    """Play a piece without training and without a run's folder.

    ``on_step`` is told how many control steps are over, and of how many; first 0, before planning.
    With a ``tree`` the player looks ahead, see :class:`~sb3_piano.players.TreeSearch`.
    ``innermost`` is put around the bare environment.
    """
    with _planner(config, innermost) as (player, env, piano):
        if tree is not None:
            player = TreeSearch(player, env, tree, seed=config.seed or 0)
        observation, _ = env.reset(seed=config.seed)
        on_step(0, len(piano.roll))
        times = [time.perf_counter()]
        state = None
        while not env.finished:
            action, state = player.predict(observation, state)
            times.append(time.perf_counter())
            observation, *_ = env.step(action)
            on_step(piano.steps_played, len(piano.roll))
        times.append(time.perf_counter())
        (recording,) = env.finished
        return PlannedTake(
            take=_take_of_recording(piano.scene, recording),
            score=piano.score,
            metrics=recording.metrics,
            planning=times[1] - times[0],
            playing=times[-1] - times[1],
        )


@contextlib.contextmanager
def _planner(
    config: PlannedConfig, innermost: EnvWrapper | None = None
) -> Iterator[tuple[PianoPolicy, EpisodeRecorder, PianoEnv]]:
    """Give what plays, where it plays, and the piano inside of that."""
    with contextlib.closing(EpisodeRecorder(config.env.make(innermost))) as env:
        player = build_planner(config, env)
        assert isinstance(env.unwrapped, PianoEnv), "planners play nothing else"
        yield player, env, env.unwrapped
