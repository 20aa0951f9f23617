"""Batched piano environment: many worlds, with tensors as inputs and outputs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Literal, NamedTuple

import gymnasium as gym
import numpy as np
import torch
from gymnasium.wrappers import OrderEnforcing, PassiveEnvChecker, TimeLimit
from stable_baselines3.common.monitor import Monitor

from sb3_piano.arrays import Arrays
from sb3_piano.batch.episodes import History, Sums
from sb3_piano.batch.hands import HandControls, HandRewards
from sb3_piano.batch.observations import observations_of
from sb3_piano.batch.tables import Pieces
from sb3_piano.batch.task import Heard, Strikes, Task
from sb3_piano.batch.varied import Varied
from sb3_piano.batch.worlds import Tensor, Worlds
from sb3_piano.envs import PianoEnv, PianoEnvConfig
from sb3_piano.envs.goal import Goal
from sb3_piano.envs.piano_env import HAND_OFFSET
from sb3_piano.envs.score_choice import ScoreSource
from sb3_piano.exceptions import ConfigError, EnvStateError, InvalidActionError, one_line
from sb3_piano.layers import layers
from sb3_piano.settings import Count, checked
from sb3_piano.wrappers import DomainRandomization, HandActions, HandReward, ScoreWrapper
from sb3_piano.wrappers.piano import unwrap_piano

Backend = Literal["cpu", "warp"]
"""Physics: MuJoCo's own threads, or MuJoCo Warp."""

Wrapper = Callable[[Any], gym.Env[Any, Any]]

_HARMLESS = (Monitor, OrderEnforcing, PassiveEnvChecker)
_KNOWN = (ScoreWrapper, HandActions, HandReward, DomainRandomization, TimeLimit, *_HARMLESS)


class BatchStep(NamedTuple):
    """Result of a control step, N rows each."""

    observation: Tensor
    """(N, n) float32."""
    reward: Tensor
    """(N,)."""
    terminated: Tensor
    """(N,) bool."""
    truncated: Tensor
    """(N,) bool."""


class BatchedPiano:
    """Batch of N :class:`~sb3_piano.envs.PianoEnv` on tensors.

    On the CPU each world equals a single environment: equal keys, observations and metrics; rewards
    up to rounding. Reset worlds whose episode has ended with the mask of :meth:`reset`; later steps
    in them return meaningless values.

    Supported wrappers are those that change the score, ``HandActions``, ``HandReward``,
    ``DomainRandomization`` and ``TimeLimit``. With a wrapper that changes the score, ``draws``
    scores are drawn beforehand, and each episode draws one of these. Other scores are distributed:
    world i plays number i modulo their count.

    Args:
        num_envs: Number of worlds, N.
        score: One score for all worlds, or several; each world plays one.
        backend: "cpu" for MuJoCo's own threads, "warp" for MuJoCo Warp.
        device: Device of Warp: by default "cuda" if available, else "cpu".
        n_threads: Threads on the CPU; by default one for each usable core.
        wrappers: Wrappers of the single environment, innermost first.
        env: Single environment with its wrappers, in place of ``score``, ``wrappers`` and options.
        draws: Number of scores to draw if a wrapper draws them.
        metrics: "all" metrics of a final ``info``, which records every step; or "sums" for the
            additive ones: F1 and returns.
        moving_keys: Lowest and highest key that move; all others are rigid, which is faster, see
            :meth:`~sb3_piano.envs.PianoEnv.fix_keys`. By default all move.
        seed: Seed of all random draws.
        physics_options: Arguments of :class:`~sb3_piano.batch.WarpWorlds`, such as buffers.
        **options: Fields of :class:`~sb3_piano.envs.PianoEnvConfig`.

    Raises:
        ConfigError: If an argument is not valid, or a wrapper cannot be batched.
        ScoreError: If a score cannot be read or played.
    """

    def __init__(
        self,
        num_envs: int = 1,
        score: ScoreSource | Sequence[ScoreSource] = "TwinkleTwinkleLittleStar",
        *,
        backend: Backend = "cpu",
        device: str | None = None,
        n_threads: int | None = None,
        wrappers: Sequence[Wrapper] = (),
        env: gym.Env[Any, Any] | None = None,
        draws: int = 256,
        metrics: Literal["all", "sums"] = "all",
        moving_keys: tuple[int, int] | None = None,
        seed: int | None = None,
        physics_options: dict[str, Any] | None = None,
        **options: Any,
    ) -> None:
        self.num_envs = checked("num_envs", num_envs, Count)
        checked("backend", backend, Backend)
        checked("metrics", metrics, Literal["all", "sums"])
        scores = [score] if isinstance(score, str) or not isinstance(score, Sequence) else score
        given = env is not None
        if env is None:
            env = PianoEnv(scores[0], **options)
            if moving_keys is not None:
                env.fix_keys(*moving_keys)
            for wrapper in wrappers:
                env = wrapper(env)
        self.env: gym.Env[Any, Any] = env
        """The single environment with its wrappers."""
        self.piano: PianoEnv = unwrap_piano(env, "A batch")
        """The single environment: scene, spaces and settings; it is not one of the worlds."""
        _check_options(self.piano.config)
        self.np_random = np.random.default_rng(seed)
        self._take_wrappers()
        more = {"varied": self._random.varied} if self._random is not None else {}
        more |= physics_options or {}
        self.worlds: Worlds = _worlds(self.piano, self.num_envs, backend, device, n_threads, more)
        """Physics of all worlds."""
        self.device = self.worlds.device
        """Device of all tensors."""
        self.pieces = self._prepared(
            [None] if given else scores, checked("draws", draws, Count), seed
        )
        """Pieces as tables of tensors."""
        self._begin_all(metrics)
        self.action_space: Any = env.action_space
        self.observation_space: Any = env.observation_space

    def _take_wrappers(self) -> None:
        """Find the supported wrappers; refuse all others."""
        self._limit, self._drawn = 2**31, False
        self._actions: HandActions | None = None
        self._reward: HandReward | None = None
        self._random: DomainRandomization | None = None
        for layer in layers(self.env):
            if isinstance(layer, HandActions):
                self._actions = layer
                if self._random is not None:
                    raise ConfigError(
                        "DomainRandomization is around HandActions: expected it inside, so that "
                        "the actuators' targets come late."
                    )
            elif isinstance(layer, HandReward):
                self._reward = layer
                _refuse_dynamics(layer.dynamics)
            elif isinstance(layer, DomainRandomization):
                self._random = layer
            elif isinstance(layer, TimeLimit):
                self._limit = min(self._limit, layer._max_episode_steps)
            elif isinstance(layer, ScoreWrapper):
                self._drawn = True
            if layer is not self.piano and not isinstance(layer, _KNOWN):
                raise ConfigError(
                    f"{type(layer).__name__} is no wrapper that can be batched: expected wrappers "
                    "that change the score, HandActions, HandReward, DomainRandomization or "
                    "TimeLimit; or single environments."
                )

    def _prepared(
        self, scores: Sequence[ScoreSource | None], draws: int, seed: int | None
    ) -> Pieces:
        """Return the pieces as tables; note the piece of each draw."""
        goals: list[Goal] = []
        tables: list[Arrays] = []
        drawn: list[int] = []
        for number in range(draws if self._drawn else len(scores)):
            given = None if self._drawn else scores[number]
            chosen = {} if given is None else {"score": given}
            self.env.reset(seed=seed if number == 0 else None, options=chosen)
            goal = self.piano.goal
            same = [index for index, other in enumerate(goals) if other.source is goal.source]
            drawn.extend(same or [len(goals)])
            if not same:
                goals.append(goal)
                tables.append(self.piano.encoding.tables())
        self._draws = torch.tensor(drawn)
        return Pieces(goals, tables, self.worlds.qpos)

    def _begin_all(self, metrics: str) -> None:
        count, worlds, pieces, env = self.num_envs, self.worlds, self.pieces, self.piano
        self._begun = False
        self.piece = torch.arange(count, device=self.device) % len(pieces.goals)
        """(N,) number of each world's piece."""
        self.steps = torch.zeros(count, dtype=torch.long, device=self.device)
        """(N,) completed control steps of each episode."""
        self._take_pieces()
        self.terms: dict[str, Tensor] = {}
        """(N,) unweighted reward terms of the last step, by name."""
        self.heard = heard = Heard(worlds)
        """Keys, pedal and fingertips after the last step."""
        self._task = Task(env.config, pieces, worlds, heard)
        weights = env.config.reward_weights
        self._strikes = Strikes(pieces, count) if weights.get("strike") else None
        self._weights, self._nothing = tuple(weights), torch.zeros_like(heard.pedal)
        self._weight = worlds.qpos.new_tensor(list(weights.values()))
        made = History if metrics == "all" else Sums
        self.sums = made(pieces, worlds, heard, self._weights)
        """Sums or history of each episode."""
        self._middle, self._half = (
            torch.as_tensor(array).to(worlds.qpos)
            for array in (env.action_map.middle, env.action_map.half_range)
        )
        self._observations = observations_of(env.encoding, pieces, worlds, heard)
        actions, reward = self._actions, self._reward
        self._hand_controls = HandControls(actions, worlds) if actions is not None else None
        self._hand_rewards = (
            HandRewards(reward, self._task, pieces, worlds, heard) if reward is not None else None
        )
        self.hand_rewards: Tensor | None = None
        """(N, h) rewards of the hands in the last step, with ``HandReward`` only."""
        self._varied = Varied(self._random, worlds, heard) if self._random is not None else None
        parts = (heard, self.sums, self._strikes, self._hand_rewards)
        self._episodes = tuple(part for part in parts if part is not None)

    @property
    def config(self) -> Any:
        """Settings of each environment."""
        return self.piano.config

    def seed(self, seed: int | None) -> None:
        """Seed all later random draws."""
        self.np_random = np.random.default_rng(seed)

    def reset(self, mask: Tensor | None = None, piece: Tensor | None = None) -> Tensor:
        """Start episodes.

        Args:
            mask: (N,) bool, worlds whose episode starts; by default all.
            piece: (N,) numbers of the pieces; by default distributed or drawn.

        Returns:
            Observations of all worlds, (N, n) float32.
        """
        if mask is None:
            mask = torch.ones(self.num_envs, dtype=torch.bool)
            self._begun = True
        elif not self._begun:
            raise EnvStateError("No episode is under way: call reset() without a mask first.")
        mask = mask.to(self.device)
        if piece is None and self._drawn:
            draws = self.np_random.integers(len(self._draws), size=self.num_envs)
            piece = self._draws[torch.from_numpy(draws)]
        if piece is not None:
            self.piece = torch.where(mask, piece.to(self.device), self.piece)
            self._take_pieces()
        self.steps = torch.where(mask, 0, self.steps)
        sliders = None
        if self.config.randomize_hand_positions:
            drawn = self.np_random.uniform(-HAND_OFFSET, HAND_OFFSET, self.num_envs)
            sliders = torch.from_numpy(drawn).to(self.worlds.qpos)
        if self._varied is not None:
            self._varied.begin(mask, self.np_random)
        self.worlds.reset(mask, sliders)
        for part in self._episodes:
            part.begin(mask)
        return self.observe()

    def step(self, actions: Tensor) -> BatchStep:
        """Simulate one control step in all worlds.

        Args:
            actions: (N, n) numbers in [-1, 1].

        Raises:
            EnvStateError: Before the first reset.
            InvalidActionError: If the actions have the wrong shape or are not finite.
        """
        if not self._begun:
            raise EnvStateError("No episode is under way: call reset() before step().")
        heard, step = self.heard, torch.minimum(self.steps, self._last)
        row = self._first + step
        heard.pedal, controls = self._controls(self._checked(actions), row)
        if self._varied is not None:
            heard.pedal, controls = self._varied.late(heard.pedal, controls)
        self.worlds.step(controls)
        heard.read()
        self.terms = self._task.terms(self.piece, row)
        if self._strikes is not None:
            time = (step[:, None] + heard.share()) * self.config.control_timestep
            hit = self._strikes.hit(self.piece, row, heard.struck, time)
            worth = 2 * hit.sum(1) - heard.struck.sum(1)
            self.terms["strike"] = worth.to(self.worlds.dtype)
        weighted = torch.stack([self.terms.get(n, self._nothing) for n in self._weights], 1)
        weighted.mul_(self._weight)
        lost = self.worlds.lost[:, None] if self.worlds.may_be_lost else None
        if lost is not None:
            weighted = torch.where(lost, 0.0, weighted)  # their values may be NaN
        reward = weighted.sum(1)
        self.sums.add(row, weighted)
        if self._hand_rewards is not None:
            self.hand_rewards = self._hand_rewards.rewards(self.piece, row, step)
            if lost is not None:
                self.hand_rewards = torch.where(lost, 0.0, self.hand_rewards)
            reward = self.hand_rewards.mean(1)
        self.steps = step + 1
        truncated = self.steps >= self._end
        terminated = self.worlds.lost.clone()
        if self.config.wrong_press_termination:
            wrong = (heard.sounding & ~self.pieces.due[row]).any(1)
            terminated |= wrong & (self.steps <= self._last)
        self.sums.earned += reward
        observation = self.observe()
        if lost is not None:
            observation = torch.where(lost, 0.0, observation)
        return BatchStep(observation, reward, terminated, truncated)

    def observe(self) -> Tensor:
        """Return all observations, (N, n) float32; after an episode's end with its last goal."""
        step = torch.minimum(self.steps, self._last)  # that of an ended episode
        seen = self._observations.write(self._first + step)
        return seen if self._varied is None else self._varied.seen(seen)

    def summaries(self, worlds: Sequence[int]) -> list[dict[str, float]]:
        """Return the metrics and returns of some worlds' episodes so far."""
        return self.sums.summaries(worlds, self.piece, self.steps)

    def _take_pieces(self) -> None:
        """Look up each world's first row, last control step and end, (N,) each."""
        length = self.pieces.length[self.piece]
        self._first, self._last = self.pieces.first[self.piece], length - 1
        self._end = length.clamp(max=self._limit)

    def _controls(self, actions: Tensor, row: Tensor) -> tuple[Tensor, Tensor]:
        """Return the pedal's commands and the actuators' targets."""
        if self._hand_controls is None:
            actions = actions.clamp(-1, 1)
            told, pedal = actions[:, :-1], (actions[:, -1] + 1) / 2
        else:  # through the piano's own actions, which are float32
            controls = self._hand_controls.controls(actions)
            told = ((controls - self._middle) / self._half).float().to(controls.dtype).clamp(-1, 1)
            pedal = self.pieces.target_sustain[row].to(controls.dtype)
        return pedal, self._middle + self._half * told

    def _checked(self, actions: Tensor) -> Tensor:
        expected = (self.num_envs, *self.action_space.shape)
        if actions.shape != expected:
            raise InvalidActionError(
                f"The actions have shape {tuple(actions.shape)}: expected {expected}."
            )
        actions = actions.to(self.worlds.qpos)
        if not math.isfinite(actions.sum().item()):
            raise InvalidActionError("Some actions are not finite: expected numbers in [-1, 1].")
        return actions


def _check_options(config: PianoEnvConfig) -> None:
    """Raise ConfigError for an option that sees one environment."""
    for name in ("observation_blocks", "reward_terms"):
        for own in getattr(config, name):
            raise ConfigError(
                f"{getattr(own, '__name__', repr(own))} of {name} sees one environment and cannot "
                f"be batched: expected no {name}; or single environments."
            )
    _refuse_dynamics(config.reward_weights.get("dynamics", 0.0))


def _refuse_dynamics(weight: float) -> None:
    if weight != 0:
        raise ConfigError(
            f"The reward of dynamics has weight {weight:g}, but needs the keys' speeds, which are "
            "not batched: expected 0; or single environments."
        )


def _worlds(
    piano: PianoEnv,
    count: int,
    backend: Backend,
    device: str | None,
    n_threads: int | None,
    more: dict[str, Any],
) -> Worlds:
    scene, n_substeps = piano.scene, piano.config.n_substeps
    if backend == "warp":
        try:
            from sb3_piano.batch.warp_worlds import WarpWorlds  # of the extra `gpu`
        except ImportError as error:
            raise ConfigError(
                f"MuJoCo Warp cannot be imported ({one_line(error)}): expected the packages of the "
                "extra gpu, mujoco-warp and warp-lang, or backend='cpu'."
            ) from error
        return WarpWorlds(scene, count, n_substeps, device=device, **more)
    if device not in (None, "cpu"):
        raise ConfigError(
            f"device is {device!r}, but MuJoCo's own threads are on the CPU: expected "
            "backend='warp'."
        )
    from sb3_piano.batch.cpu_worlds import CpuWorlds

    return CpuWorlds(scene, count, n_substeps, n_threads, **more)
