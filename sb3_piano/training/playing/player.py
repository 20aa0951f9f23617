"""Players opened in their environments, with recorded performances."""

from __future__ import annotations

import contextlib
import dataclasses
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy.typing as npt

from sb3_piano.envs import GENERAL_ID, PianoEnv
from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.layers import layers
from sb3_piano.music import Score
from sb3_piano.music.catalogue import is_path
from sb3_piano.players import EpisodeRecorder, Player, PlayerSpec, Transition, rollout
from sb3_piano.players.policy import singles_of
from sb3_piano.settings import Count, Index, checked
from sb3_piano.take import Take
from sb3_piano.threads import torch_computing
from sb3_piano.training.configuration.env_spec import Env, EnvSpec
from sb3_piano.training.runs.provenance import versions
from sb3_piano.wrappers.score_wrapper import possible_scores

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env import VecEnv

    from sb3_piano.callbacks.own_env import EnvWrapper
    from sb3_piano.training.runs.folder import RunFolder

PLANNED_IN: Mapping[str, Any] = {
    "reduced_action_space": False,
    "initial_buffer_time": 0.5,
    "fingering": "robot",
}
"""Default options of the environment for playing a piece: all joints, half a second before the
first note, and fingering for the simulated hands."""

Source = Score | str | os.PathLike[str]


def stage_for(piece: Any, *, defaults: Mapping[str, Any] = PLANNED_IN, **options: Any) -> EnvSpec:
    """Return the environment for a piece: an environment id, a file, a name or a score.

    ``options`` of the environment override the ``defaults``.

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
    """A player opened in its environment; a model plays its deterministic policy.

    A run's model plays with the run's wrappers and normalisation; the recording is of the bare
    environment inside::

        with OpenPlayer.open("runs/td3/RoboPianist-v0_1") as player:
            takes = player.play(episodes=3)

    :meth:`open` makes one.
    """

    spec: PlayerSpec
    """Spec of the player."""
    env_spec: EnvSpec
    """Spec of the environment."""
    seed: int
    """Default seed."""
    run: RunFolder | None
    """Folder of the player's run; ``None`` for other players."""
    algo: str
    """Name of the training algorithm, or of the player."""
    training_seed: int | None
    """Seed of the training, if any."""
    piece: str
    """Title of the piece, several joined by "or"; the environment's id if it is no piano."""
    model: Any
    """Model of Stable-Baselines3, or player of this package."""
    _titles: Mapping[str, str]
    """Original titles of copied score files, by the titles of the copies."""
    _env: Env | VecEnv
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
        """Open a player in its environment.

        Args:
            player: Spec of the player, or its text, such as the folder of a run.
            env: Environment; by default a run's own, and for other players :func:`stage_for` of
                the score.
            seed: Seed of the environment and the player, at least 0.
            physics: Name of the physics profile; by default the environment's own.
            score: Piece to play instead of the environment's own. A run's environment gets it
                through ``reset``, so that an observation fitted to the run's own piece keeps its
                meaning.
            best: Use a run's best model by this metric, such as "f1", instead of the last.
            disturbed: Wrapper of the bare environment.

        Raises:
            ConfigError: If ``seed`` is out of range, a run's config is damaged, there is nothing to
                play, or a piece is given to an environment that is no piano.
            RunError: If there is no run, its model cannot be loaded, or its observation cannot show
                the piece.
            ScoreError: If the score cannot be read.
        """
        spec = player if isinstance(player, PlayerSpec) else PlayerSpec.parse(player)
        checked("seed", seed, Index)
        run = None
        if spec.is_run:
            from sb3_piano.training.runs.folder import RunFolder  # training needs torch

            run = RunFolder.open(spec.name)
            former = run.read_player()
            if former is not None:  # a player's folder of version 0.2
                planned, of_player = former
                spec, run = dataclasses.replace(planned, tree=spec.tree), None
                env = env or of_player
        if run is not None:
            from sb3_piano.training.playing.run_player import open_run

            return open_run(spec, run, seed, physics, score, best, disturbed)
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
        made = env.make(disturbed, EpisodeRecorder)
        with closed_if_it_fails(made):
            return cls.playing(spec.make(made, seed), made, spec, env, seed, algo=spec.name)

    @classmethod
    def playing(
        cls,
        model: Player,
        env: Env | VecEnv,
        spec: PlayerSpec,
        env_spec: EnvSpec,
        seed: int,
        *,
        algo: str,
        run: RunFolder | None = None,
        training_seed: int | None = None,
        titles: Mapping[str, str] = {},
        piece: str | None = None,
    ) -> OpenPlayer:
        """Wrap a player and its environment (or vector of one), which has a recorder."""
        single = singles_of(env)[0]
        return cls(
            spec=spec,
            env_spec=env_spec,
            seed=seed,
            run=run,
            algo=algo,
            training_seed=training_seed,
            piece=_own_piece(env_spec, single, titles) if piece is None else piece,
            model=model,
            _titles=titles,
            _env=env,
            _recorder=[e for e in layers(single) if isinstance(e, EpisodeRecorder)][-1],
        )

    @property
    def env(self) -> Env:
        """The bare environment."""
        return self._recorder.unwrapped

    @property
    def piano(self) -> PianoEnv:
        """The piano environment.

        Raises:
            RunError: If the environment is no piano.
        """
        if not isinstance(self.env, PianoEnv):
            raise RunError(
                f"{self.named} cannot be watched: its environment {self.env_spec.id!r} is no "
                "piano. Expected a run of a piano environment."
            )
        return self.env

    @property
    def wrapped(self) -> Env:
        """The environment with its wrappers."""
        return singles_of(self._env)[0]

    @property
    def num_timesteps(self) -> int:
        """Environment steps of the player's training."""
        return int(self.model.num_timesteps)

    @property
    def named(self) -> str:
        """Name of the player for messages."""
        return f"The player '{self.spec}'" if self.run is None else f"Run '{self.run.path}'"

    def play(self, episodes: int = 1, *, seed: int | None = None) -> list[Take]:
        """Play a number of episodes in a freshly seeded environment.

        The seed, at least 0, defaults to the seed of :meth:`open`.

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
        """Generate episodes as in :meth:`play`, lazily; without a number, endlessly.

        A later call of :meth:`play`, :meth:`episodes` or :meth:`rest` ends the generator.
        """
        return self._rollout(episodes, seed, resting=False, on_step=on_step)

    def rest(self) -> Take | None:
        """Return an episode with resting hands; ``None`` if the environment is no piano."""
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
        """Return the model's action for an observation of the environment, and its state."""
        arguments = (state, episode_start, deterministic)
        if isinstance(self._env, gym.Env):
            played: tuple[Any, Any] = self.model.predict(observation, *arguments)
            return played
        from sb3_piano.training.runs.saved import predict_single

        with torch_computing():
            return predict_single(self.model, self._env, observation, *arguments)

    def close(self) -> None:
        """Close the environment."""
        self._env.close()

    def __exit__(self, *error: object) -> None:
        self.close()

    def _rollout(self, episodes: int | None, seed: int | None, **more: Any) -> Iterator[Take]:
        own = self.seed if seed is None else seed
        played = rollout(self.model, self._env, episodes=episodes, seed=own, **more)
        return (self._noted(take, own) for take in played)

    def _noted(self, take: Take, seed: int) -> Take:
        """Return a take with player, environment, seed, versions and its original title."""
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
"""Deprecated name of :class:`OpenPlayer`."""


@contextlib.contextmanager
def closed_if_it_fails(env: Env | VecEnv) -> Iterator[None]:
    """Close an environment if the block raises."""
    try:
        yield
    except BaseException:
        env.close()
        raise


def _own_piece(spec: EnvSpec, env: Env, titles: Mapping[str, str]) -> str:
    """Return the name of an environment's piece, or of all pieces its wrappers may choose."""
    if not isinstance(env.unwrapped, PianoEnv):
        return spec.id
    if len(spec.pieces) > 1:
        return f"{len(spec.pieces)} pieces"
    scores = possible_scores(env) if spec.wrappers else [env.unwrapped.default_score]
    played = dict.fromkeys(titles.get(s.title, s.title) for s in scores)
    return " or ".join(played) or spec.id
