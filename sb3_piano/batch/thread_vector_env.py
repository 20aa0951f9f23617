"""Gymnasium vector environment of several piano environments."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, TypeVar

import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import TimeLimit

from sb3_piano.arrays import BoolArray, Float32Array, FloatArray
from sb3_piano.envs.actions import action_numbers
from sb3_piano.envs.piano_env import PianoEnv
from sb3_piano.envs.score_choice import ScoreSource, own_score, reset_options
from sb3_piano.exceptions import ConfigError, EnvStateError, InvalidActionError
from sb3_piano.music import Score, load_score
from sb3_piano.settings import Count, checked
from sb3_piano.threads import ThreadTeam

T = TypeVar("T")


class PianoVectorEnv(SyncVectorEnv[Any, Any]):
    """Vector environment whose :class:`~sb3_piano.envs.PianoEnv` step in parallel threads.

    ``gymnasium.make_vec("RoboPianist-v0", num_envs=4)`` makes one. Its results equal those of
    gymnasium's ``SyncVectorEnv`` around the same environments. ``envs`` are the environments
    themselves, with all their methods and attributes.

    An error in one environment is raised when all threads have finished; the other environments may
    have played that step. After an error, as after Ctrl-C, call ``reset``.

    Args:
        num_envs: Number of environments, at least 1.
        score: One score for all environments, or a sequence with one for each. A score is a
            ``Score``, a path or a piece's name.
        n_threads: Threads to use, the calling one included; by default one for each environment or
            each usable core, whichever are fewer.
        max_episode_steps: Steps after which a ``TimeLimit`` around each environment truncates its
            episode; by default no limit.
        autoreset_mode: When an environment begins its next episode: with the next step
            ("NextStep"), with the last step ("SameStep") or at ``reset`` only ("Disabled").
        render_mode: As for a single environment.
        **options: The fields of :class:`~sb3_piano.envs.PianoEnvConfig`, equal for all
            environments, and the options of a generated study that all of them play.

    Raises:
        ConfigError: If an argument is not valid, or the scores give observations of different
            sizes.
        ScoreError: If a score cannot be read or played.
    """

    def __init__(
        self,
        num_envs: int = 1,
        score: ScoreSource | Sequence[ScoreSource] = "TwinkleTwinkleLittleStar",
        *,
        n_threads: int | None = None,
        max_episode_steps: int | None = None,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        num_envs = checked("num_envs", num_envs, Count)
        limit = checked("max_episode_steps", max_episode_steps, Count | None)
        mode = checked_mode(autoreset_mode)
        self._team = ThreadTeam(num_envs, n_threads)
        if isinstance(score, str) or not isinstance(score, Sequence):
            score, options = own_score(score, options)
        envs = [
            PianoEnv(source, render_mode=render_mode, **options)
            for source in _scores(score, num_envs)
        ]
        _check_same_size(envs)
        # Built first, so that errors have this package's messages.
        built = iter(envs if limit is None else [TimeLimit(env, limit) for env in envs])
        super().__init__([built.__next__] * num_envs, autoreset_mode=mode)
        self._env_obs: list[Any] = [None] * num_envs
        self._slot_infos: list[list[dict[str, Any]]] = [[] for _ in envs]

    @property
    def n_threads(self) -> int:
        """Number of threads that step the environments, the calling one included."""
        return self._team.n_threads

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Float32Array, dict[str, Any]]:
        """Begin an episode in all environments, or in some.

        Args:
            seed: Seed of the first environment (each other one adds 1), or a seed for each.
            options: ``"score"``: scores of this episode, one for all environments or a sequence
                with one for each. ``"transform"``: as for a single environment, for all of them.
                ``"reset_mask"``: (num_envs,) bool, the environments to reset.

        Raises:
            ConfigError: If ``seed`` or ``options`` does not fit the environments.
            ScoreError: If a score cannot be read or played.
        """
        count = self.num_envs
        seeds = (
            [None if seed is None else int(seed) + slot for slot in range(count)]
            if seed is None or isinstance(seed, int | np.integer)
            else _one_for_each("seed", seed, count)
        )
        options = dict(reset_options(options))
        mask = self._checked_mask(options.pop("reset_mask", None))
        scores = _scores(options["score"], count) if "score" in options else []

        def begin(slot: int) -> None:
            self._slot_infos[slot] = []
            if mask[slot]:
                own = {**options, "score": scores[slot]} if scores else options
                result = self.envs[slot].reset(seed=seeds[slot], options=dict(own))
                self._env_obs[slot], self._slot_infos[slot] = result[0], [result[1]]

        self._team.run(begin)
        for ended in (self._terminations, self._truncations, self._autoreset_envs):
            ended[mask] = False
        return np.stack(self._env_obs), self._infos()

    def step(
        self, actions: npt.ArrayLike
    ) -> tuple[Float32Array, FloatArray, BoolArray, BoolArray, dict[str, Any]]:
        """Play one control step in every environment.

        Args:
            actions: (num_envs, n) numbers in [-1, 1].

        Returns:
            Observations, rewards, terminated, truncated, infos; the first four are new arrays.

        Raises:
            InvalidActionError: If an action has the wrong shape or is not finite.
            EnvStateError: If an environment has not been reset; see ``autoreset_mode``.
            SimulationDivergedError: If the physics of an environment became unstable.
        """
        rows = action_numbers(actions)  # the environments check the numbers of their rows
        if rows.shape != self.action_space.shape:
            raise InvalidActionError(
                f"The actions have shape {rows.shape}: expected {self.action_space.shape}."
            )
        self._team.run(lambda slot: self._play(slot, rows[slot]))
        self._autoreset_envs = self._terminations | self._truncations
        return (
            np.stack(self._env_obs),
            self._rewards.copy(),
            self._terminations.copy(),
            self._truncations.copy(),
            self._infos(),
        )

    def render(self) -> tuple[Any, ...]:
        """Draw a picture of every environment, or ``None`` for each without a render mode."""
        pictures: list[Any] = [None] * self.num_envs

        def draw(slot: int) -> None:
            pictures[slot] = self.envs[slot].render()

        self._team.run(draw)
        return tuple(pictures)

    def close_extras(self, **kwargs: Any) -> None:
        """Close every environment, then end the threads."""
        del kwargs  # gymnasium passes the arguments of close()
        try:
            self._team.run(lambda slot: self.envs[slot].close())
        finally:
            self._team.close()

    def _play(self, slot: int, action: npt.NDArray[Any]) -> None:
        """Play a step in one environment or begin its next episode, and write only its rows."""
        env = self.envs[slot]
        if self._autoreset_envs[slot] and self.autoreset_mode == AutoresetMode.NEXT_STEP:
            self._env_obs[slot], info = env.reset()
            result: list[Any] = [0.0, False, False]
            infos = [info]
        else:
            self._env_obs[slot], *result, info = env.step(action)
            infos = [info]
            if any(result[1:]) and self.autoreset_mode == AutoresetMode.SAME_STEP:
                final = {"final_obs": self._env_obs[slot], "final_info": info}
                self._env_obs[slot], info = env.reset()
                infos = [final, info]
        self._rewards[slot], self._terminations[slot], self._truncations[slot] = result
        self._slot_infos[slot] = infos

    def _infos(self) -> dict[str, Any]:
        merged: dict[str, Any] = {}
        for slot, infos in enumerate(self._slot_infos):
            for info in infos:
                merged = self._add_info(merged, info, slot)
        return merged

    def _checked_mask(self, mask: Any) -> BoolArray:
        if mask is None:
            mask = np.ones(self.num_envs, dtype=np.bool_)
        wanted = getattr(mask, "dtype", None) == np.bool_ and mask.shape == (self.num_envs,)
        if not wanted or not mask.any():
            raise ConfigError(
                f"reset_mask is {mask!r}: expected a numpy array of {self.num_envs} bool with at "
                "least one True."
            )
        for slot, observation in enumerate(self._env_obs):
            if observation is None and not mask[slot]:
                raise EnvStateError(
                    f"Environment {slot} has never been reset: expected True for it in reset_mask."
                )
        return mask


def checked_mode(mode: str | AutoresetMode) -> AutoresetMode:
    """Convert to an autoreset mode; raise a ConfigError if it is unknown."""
    name = mode.value if isinstance(mode, AutoresetMode) else mode
    return AutoresetMode(
        checked("autoreset_mode", name, Literal["NextStep", "SameStep", "Disabled"])
    )


def _scores(score: ScoreSource | Sequence[ScoreSource], count: int) -> list[Score]:
    if isinstance(score, str) or not isinstance(score, Sequence):
        return [load_score(score)] * count
    return [load_score(source) for source in _one_for_each("score", score, count)]


def _one_for_each(name: str, given: Sequence[T], count: int) -> Sequence[T]:
    if len(given) != count:
        raise ConfigError(
            f"{name} has {len(given)} entries: expected one {name}, or one for each of {count} "
            "environments."
        )
    return given


def _check_same_size(envs: Sequence[PianoEnv]) -> None:
    sizes = [(env.observation_layout.size, env.score.title) for env in envs]
    if len({size for size, _ in sizes}) > 1:
        listed = ", ".join(f"{i}: {size} ({title!r})" for i, (size, title) in enumerate(sizes))
        raise ConfigError(
            f"The environments' observations differ in size - {listed}: expected scores with "
            f"one size, or another observation than {envs[0].config.observation!r}."
        )
