"""Players opened to play: each in its environment, whose performances are recorded."""

from __future__ import annotations

import contextlib
import dataclasses
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy.typing as npt

from sb3_piano.envs import GENERAL_ID, EpisodeRecorder, PianoEnv
from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.layers import layers
from sb3_piano.music import Score
from sb3_piano.music.catalogue import is_path
from sb3_piano.players import Player, PlayerSpec, Transition, rollout
from sb3_piano.players.policy import singles_of
from sb3_piano.settings import Count, Index, checked
from sb3_piano.threads import torch_computing
from sb3_piano.training.configuration.env_spec import Env, EnvSpec
from sb3_piano.training.runs.provenance import versions
from sb3_piano.viewing.take import Take
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
        run = None
        if spec.is_run:
            from sb3_piano.training.runs.folder import RunFolder  # training needs torch

            run = RunFolder.open(spec.name)
            former = run.read_player()
            if former is not None:  # of versions that made a folder for a player, too
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
        """Return what plays in an environment, or in a vector of one, which has a recorder."""
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
    def wrapped(self) -> Env:
        """The environment with its wrappers."""
        return singles_of(self._env)[0]

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
        arguments = (state, episode_start, deterministic)
        if isinstance(self._env, gym.Env):
            played: tuple[Any, Any] = self.model.predict(observation, *arguments)
            return played

        from sb3_piano.training.runs.saved import act

        with torch_computing():
            return act(self.model, self._env, observation, *arguments)

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
def closed_if_it_fails(env: Env | VecEnv) -> Iterator[None]:
    """Close an environment if the block raises."""
    try:
        yield
    except BaseException:
        env.close()
        raise


def _own_piece(spec: EnvSpec, env: Env, titles: Mapping[str, str]) -> str:
    """Return what an environment's own piece is called; all that wrappers may choose are named."""
    if not isinstance(env.unwrapped, PianoEnv):
        return spec.id
    if len(spec.pieces) > 1:
        return f"{len(spec.pieces)} pieces"
    scores = possible_scores(env) if spec.wrappers else [env.unwrapped.default_score]
    played = dict.fromkeys(titles.get(s.title, s.title) for s in scores)
    return " or ".join(played) or spec.id
