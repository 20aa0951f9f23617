"""Players opened to play: each in its environment, whose performances are recorded."""

from __future__ import annotations

import contextlib
import dataclasses
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy.typing as npt
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from sb3_piano.callbacks.own_env import EnvWrapper
from sb3_piano.envs import GENERAL_ID, EpisodeRecorder, PianoEnv
from sb3_piano.exceptions import ConfigError, RunError, ScoreError
from sb3_piano.layers import layers
from sb3_piano.music import Score, load_score
from sb3_piano.music.catalogue import is_path
from sb3_piano.players import Player, PlayerSpec, Transition, TreeSearch, rollout
from sb3_piano.settings import Count, Index, checked
from sb3_piano.threads import torch_computing
from sb3_piano.training.configuration.env_spec import EnvSpec
from sb3_piano.training.runs.builders import Env, build_vec_env, first_env, one_env
from sb3_piano.training.runs.folder import RunFolder
from sb3_piano.training.runs.provenance import versions
from sb3_piano.training.runs.saved import (
    act,
    load_statistics,
    load_to_play,
    model_files,
)
from sb3_piano.viewing.take import Take
from sb3_piano.wrappers.score_wrapper import possible_scores

PLANNED_IN: Mapping[str, Any] = {
    "reduced_action_space": False,
    "initial_buffer_time": 0.5,
    "fingering": "robot",
}
"""Options of the environments in which players play a piece unless told otherwise: all joints, half
a second to get to the first note, and the fingers that suit the hands."""

Source = Score | str | os.PathLike[str]


def stage_for(piece: Any, *, defaults: Mapping[str, Any] = PLANNED_IN, **options: Any) -> EnvSpec:
    """Return where players play a piece: an environment by its id, a file, a name or a score.

    ``options`` of the environment come before the ``defaults``.

    Raises:
        ConfigError: If there is no such file, or an option does not fit.
    """
    if isinstance(piece, str) and piece in gym.registry:
        return EnvSpec(id=piece, options={**defaults, **options})
    if isinstance(piece, Score):
        piece = dataclasses.asdict(piece)
    elif is_path(piece) and not os.path.exists(piece):
        raise ConfigError(
            f"There is no {os.fspath(piece)!r}: expected an environment's id, a file such as a "
            "MIDI file, or the name of a piece (see 'sb3-piano pieces list')."
        )
    return EnvSpec(id=GENERAL_ID, options={**defaults, "score": piece, **options})


@dataclass(kw_only=True, eq=False)
class OpenPlayer(contextlib.AbstractContextManager["OpenPlayer"]):
    """A player in its environment, playing without exploring.

    A run's model plays with the run's wrappers and normalisation; what is recorded is that of the
    bare environment inside::

        with OpenPlayer.open("runs/td3/RoboPianist-v0_1") as player:
            takes = player.play(episodes=3)

    :meth:`open` makes one.
    """

    spec: PlayerSpec
    """Who plays."""
    env_spec: EnvSpec
    """Where."""
    seed: int
    """The seed from which it plays unless another is given."""
    run: RunFolder | None
    """The folder of the run whose model plays; ``None`` of any other player."""
    algo: str
    """Name of the algorithm that trained it, or its own."""
    training_seed: int | None
    """Seed of its training, if it was trained."""
    piece: str
    """The name of what is played, of several pieces joined by "or"; the environment's id if it is
    no piano."""
    model: Any
    """What plays: a model of Stable-Baselines3, or a player of this package."""
    _titles: Mapping[str, str]
    """Titles of scores whose files were copied, by the titles of the copies."""
    _venv: VecEnv
    _recorder: EpisodeRecorder

    @classmethod
    def open(
        cls,
        player: PlayerSpec | str | os.PathLike[str],
        env: EnvSpec | None = None,
        *,
        seed: int = 0,
        physics: str | None = None,
        score: Source | None = None,
        best: str | None = None,
        disturbed: EnvWrapper | None = None,
    ) -> OpenPlayer:
        """Return a player in its environment.

        Args:
            player: Who plays: a spec, or its text, such as the folder of a run.
            env: Where; by default a run's own environment, and for other players that of
                :func:`stage_for` the score.
            seed: Seeds the environment and the player, at least 0.
            physics: Name of the physics profile to play on; by default the environment's own.
            score: What to play in place of the environment's own piece. In a run's environment it
                comes in through ``reset``, so that an observation that was fitted to the run's own
                piece keeps its meaning.
            best: Play a run's best model by this metric, such as "f1", in place of the last one.
            disturbed: Is put around the bare environment.

        Raises:
            ConfigError: If ``seed`` is out of range, a run's config is damaged, there is nothing to
                play, or a piece is given to an environment that is no piano.
            RunError: If there is no run, it has no model that can be loaded, or what it observes
                cannot show the piece.
            ScoreError: If the score cannot be read.
        """
        spec = player if isinstance(player, PlayerSpec) else PlayerSpec.parse(player)
        checked("seed", seed, Index)
        run = RunFolder.open(spec.name) if spec.is_run else None
        former = None if run is None else run.read_player()
        if former is not None:  # of versions that made a folder for a player, too
            planned, of_player = former
            spec, env, run = dataclasses.replace(planned, tree=spec.tree), env or of_player, None
        if run is not None:
            return cls._of_run(spec, run, seed, physics, score, best, disturbed)
        if best is not None:
            raise RunError(
                f"The player '{spec}' has no best model by {best!r}: expected a run, or no metric."
            )
        if env is None:
            if score is None:
                raise ConfigError(
                    f"The player '{spec}' has nothing to play: expected a piece, or an environment."
                )
            env = stage_for(score if isinstance(score, Score) else os.fspath(score))
        elif score is not None:
            env = env.for_others().with_options(score=stage_for(score).options["score"])
        if physics is not None:
            env = env.with_options(physics=physics)

        def innermost(bare: Env) -> EpisodeRecorder:
            return EpisodeRecorder(bare if disturbed is None else disturbed(bare))

        venv = one_env(env, seed, innermost)
        with _closed_if_it_fails(venv):
            return cls._in(spec, env, venv, spec.make(venv, seed), seed, algo=spec.name)

    @classmethod
    def _of_run(
        cls,
        spec: PlayerSpec,
        run: RunFolder,
        seed: int,
        physics: str | None,
        score: Source | None,
        best: str | None,
        disturbed: EnvWrapper | None,
    ) -> OpenPlayer:
        trained = run.read_config()
        config = dataclasses.replace(trained.alone(), seed=seed)
        if physics is not None:
            config = config.in_env(physics=physics)
        chosen = None if score is None else load_score(score)
        model_file, statistics = model_files(run, config, best)

        def innermost(env: Env) -> EpisodeRecorder:
            env = env if disturbed is None else disturbed(env)
            return EpisodeRecorder(env if chosen is None else _FixedPiece(env, chosen))

        venv = build_vec_env(config, innermost)
        with _closed_if_it_fails(venv):
            load_statistics(config, statistics, venv)
            if isinstance(venv, VecNormalize):
                venv.training = False
            env = first_env(venv)
            if chosen is not None:
                _check_playable(run, env, venv, chosen)
            model: Any = load_to_play(config, model_file, venv)
            if spec.tree is not None:
                model = TreeSearch(model, venv, spec.tree, seed=seed)
            return cls._in(
                spec,
                config.env,
                venv,
                model,
                seed,
                algo=config.algo,
                run=run,
                training_seed=trained.seed,
                titles={} if chosen is not None else titles_of_copies(run, env),
                piece=None if chosen is None else chosen.title,
            )

    @classmethod
    def _in(
        cls,
        spec: PlayerSpec,
        env_spec: EnvSpec,
        venv: VecEnv,
        model: Player,
        seed: int,
        *,
        algo: str,
        run: RunFolder | None = None,
        training_seed: int | None = None,
        titles: Mapping[str, str] = {},
        piece: str | None = None,
    ) -> OpenPlayer:
        env = first_env(venv)
        return cls(
            spec=spec,
            env_spec=env_spec,
            seed=seed,
            run=run,
            algo=algo,
            training_seed=training_seed,
            piece=_own_piece(env_spec, env, titles) if piece is None else piece,
            model=model,
            _titles=titles,
            _venv=venv,
            _recorder=[e for e in layers(env) if isinstance(e, EpisodeRecorder)][-1],
        )

    @property
    def env(self) -> Env:
        """The bare environment."""
        return self._recorder.unwrapped

    @property
    def piano(self) -> PianoEnv:
        """The piano that is played.

        Raises:
            RunError: If the environment is none.
        """
        if not isinstance(self.env, PianoEnv):
            raise RunError(
                f"{self.named} cannot be watched: its environment {self.env_spec.id!r} is no "
                "piano. Expected a run of a piano environment."
            )
        return self.env

    @property
    def vec_env(self) -> VecEnv:
        """The vector that it plays in, with the run's wrappers and normalisation."""
        return self._venv

    @property
    def num_timesteps(self) -> int:
        """Environment steps that it was trained for."""
        return int(self.model.num_timesteps)

    @property
    def named(self) -> str:
        """What messages call it."""
        return f"The player '{self.spec}'" if self.run is None else f"Run '{self.run.path}'"

    def play(self, episodes: int = 1, *, seed: int | None = None) -> list[Take]:
        """Play so many episodes from a freshly seeded environment.

        The seed, at least 0, is by default that of :meth:`open`.

        Raises:
            ConfigError: If a number is out of range.
        """
        return list(self.episodes(checked("episodes", episodes, Count), seed=seed))

    def episodes(
        self,
        episodes: int | None = None,
        *,
        seed: int | None = None,
        on_step: Callable[[Transition], object] = lambda transition: None,
    ) -> Iterator[Take]:
        """Play as :meth:`play` does, each episode as it is asked for; without a number, endlessly.

        Whatever is played next, or a rest, ends it.
        """
        return self._rollout(episodes, seed, resting=False, on_step=on_step)

    def rest(self) -> Take | None:
        """Return an episode in which the hands rest; ``None`` if the environment is no piano."""
        if not self._recorder.can_rest:
            return None
        return next(self._rollout(1, None, resting=True))

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: npt.NDArray[Any] | None = None,
        deterministic: bool = False,
    ) -> tuple[Any, Any]:
        """Return what the model plays for an observation as the environment gives it."""
        with torch_computing():
            return act(self.model, self._venv, observation, state, episode_start, deterministic)

    def close(self) -> None:
        """Close the environment."""
        self._venv.close()

    def __exit__(self, *error: object) -> None:
        self.close()

    def _rollout(self, episodes: int | None, seed: int | None, **more: Any) -> Iterator[Take]:
        own = self.seed if seed is None else seed
        played = rollout(self.model, self._venv, episodes=episodes, seed=own, **more)
        return (self._noted(take, own) for take in played)

    def _noted(self, take: Take, seed: int) -> Take:
        """Return a take with who played where, and the title of the file that was copied."""
        title, performance = self._titles.get(take.title, take.title), take.performance
        if performance is not None and title != take.title:
            performance = dataclasses.replace(performance, title=title)
        return dataclasses.replace(
            take,
            title=title,
            performance=performance,
            player=str(self.spec),
            env=self.env_spec.to_mapping(),
            seed=seed,
            versions=versions(),
        )


SavedPlayer = OpenPlayer
"""Name of :class:`OpenPlayer` in former versions."""


@contextlib.contextmanager
def _closed_if_it_fails(venv: VecEnv) -> Iterator[None]:
    try:
        yield
    except BaseException:
        venv.close()
        raise


class _FixedPiece(gym.Wrapper[Any, Any, Any, Any]):
    """Play one piece, whatever the wrappers further out ask for."""

    def __init__(self, env: Env, score: Score):
        super().__init__(env)
        self._score = score

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode of the piece."""
        others = {k: v for k, v in (options or {}).items() if k != "transform"}
        return self.env.reset(seed=seed, options={**others, "score": self._score})


def _check_playable(run: RunFolder, env: Env, venv: VecEnv, score: Score) -> None:
    if not isinstance(env.unwrapped, PianoEnv):
        raise ConfigError(
            f"Run '{run.path}' cannot play {score.title!r}: its environment "
            f"{run.read_config().env_id!r} is no piano. Expected a run of a piano environment, or "
            "no piece."
        )
    try:
        venv.reset()
    except ScoreError as error:
        raise RunError(
            f"Run '{run.path}' cannot play {score.title!r}: {error} Expected a piece that its "
            "observation can show."
        ) from error


def titles_of_copies(run: RunFolder, env: Env) -> dict[str, str]:
    """Return the name of the file that was copied into a run's folder, by the copy's title."""
    file, piano = run.read_provenance().get("score_file"), env.unwrapped
    if isinstance(file, str) and isinstance(piano, PianoEnv):
        return {piano.default_score.title: Path(file).stem}
    return {}


def _own_piece(spec: EnvSpec, env: Env, titles: Mapping[str, str]) -> str:
    """Return what an environment's own piece is called; all that wrappers may choose are named."""
    if not isinstance(env.unwrapped, PianoEnv):
        return spec.id
    if len(spec.pieces) > 1:
        return f"{len(spec.pieces)} pieces"
    scores = possible_scores(env) if spec.wrappers else [env.unwrapped.default_score]
    played = dict.fromkeys(titles.get(s.title, s.title) for s in scores)
    return " or ".join(played) or spec.id
