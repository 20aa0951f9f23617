"""Settings of runs: of a training, and of what plays without any."""

from __future__ import annotations

import dataclasses
import inspect
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from typing import Annotated, Any, Literal, Self

import gymnasium as gym
from annotated_types import Ge, Le
from pydantic import BeforeValidator, ValidationInfo
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.utils import get_device
from stable_baselines3.common.vec_env import VecEnvWrapper, VecNormalize

from sb3_piano.envs import GENERAL_ID, PianoEnvConfig
from sb3_piano.exceptions import ConfigError, near_names
from sb3_piano.music import Score, find_piece, is_path, select_pieces
from sb3_piano.music.catalogue import ScoreSource
from sb3_piano.music.fingering.apply import FINGERINGS
from sb3_piano.players import PlayerResidual, player_class
from sb3_piano.settings import Number, Whole, checked, settings
from sb3_piano.threads import MatmulPrecision
from sb3_piano.training.configuration.names import (
    PLANNERS,
    algorithm_class,
    import_name,
    registered_id,
)
from sb3_piano.training.configuration.plugins import Plugin, parse_plugins, with_arguments
from sb3_piano.training.configuration.values import (
    check_arguments,
    class_of,
    coerce_mapping,
    plain,
    zoo_number,
)
from sb3_piano.vec_env import HandsAsAgents

_RANDOM_PIECE = "sb3_piano.wrappers.RandomPiece"


def _plugins_below(base: type) -> BeforeValidator:
    return BeforeValidator(lambda value, info: parse_plugins(value, str(info.field_name), base))


def _read_arguments(value: Any, info: ValidationInfo) -> Any:
    return plain(coerce_mapping(value, str(info.field_name)), str(info.field_name))


def _arguments_of(function: Callable[..., Any], *reserved: str) -> BeforeValidator:
    def read(value: Any, info: ValidationInfo) -> Any:
        if isinstance(value, bool):
            return value
        return check_arguments(_read_arguments(value, info), function, reserved=reserved)

    return BeforeValidator(read)


def _read_pieces(value: Any) -> tuple[str, ...]:
    return () if value in (None, (), []) else tuple(map(_piece_name, select_pieces(value)))


def _piece_name(piece: ScoreSource) -> str:
    if isinstance(piece, Score):
        raise ConfigError(f"pieces has {piece.title!r} as a score: expected its name or file.")
    return os.fspath(piece)


_Whole = Annotated[Whole, BeforeValidator(zoo_number)]
_Number = Annotated[Number, BeforeValidator(zoo_number)]
_Arguments = Annotated[Mapping[str, Any], BeforeValidator(_read_arguments)]
_Plugins = tuple[Plugin, ...]

# What a run sets itself.
_OF_MONITOR = ("env", "filename", "override_existing", "reset_keywords")
_OF_ALGORITHM = ("policy", "env", "seed", "tensorboard_log", "action_noise")


@settings
class PlayConfig:
    """Settings that all runs have: what plays, and where, in types that YAML can hold."""

    algo: str
    """Name of what plays."""
    env_id: str
    """Id of the environment; ``module:Id`` imports the module that registers it."""
    env_module: str | None = None
    """Module to import before the environment is made."""
    seed: Annotated[_Whole, Ge(0)] | None = None
    """Seed of everything random, at least 0; ``None`` lets a training draw one and note it down."""
    env_kwargs: _Arguments = field(default_factory=dict)
    """Keyword arguments of the environment."""
    env_wrapper: Annotated[_Plugins, _plugins_below(gym.Wrapper)] = ()
    """Wrappers put around each environment, the first one innermost."""
    algorithm_kwargs: _Arguments = field(default_factory=dict)
    """Arguments of the constructor of what plays."""

    def __post_init__(self) -> None:
        module, env_id = registered_id(self.env_id, self.env_module)
        self._set(env_module=module, env_id=env_id)

    @property
    def full_env_id(self) -> str:
        """Id of the environment, as ``module:Id`` if a module registers it."""
        return self.env_id if self.env_module is None else f"{self.env_module}:{self.env_id}"

    @property
    def labels(self) -> dict[str, str]:
        """Identity of the run, by which its files are recognised."""
        return {"algo": self.algo, "env_id": self.env_id}

    def alone(self) -> Self:
        """Return the settings for one environment without log files."""
        return self

    def in_env(self, **options: Any) -> Self:
        """Return the settings with other options of the environment."""
        return dataclasses.replace(self, env_kwargs={**self.env_kwargs, **options})

    @property
    def own_pieces(self) -> Sequence[Any]:
        """What is played, as far as it has names: pieces, or the one of the environment's id."""
        options = {**gym.spec(self.env_id).kwargs, **self.env_kwargs}
        return [options.get("score")]

    @property
    def piece_options(self) -> set[str]:
        """Names of the options of the environment that belong to the pieces, generated studies."""
        return set(self.env_kwargs) & set().union(*map(_options_of, self.own_pieces))

    def for_others(self) -> Self:
        """Return the settings for other pieces: without score, its labels, or choice of a piece."""
        fingering = self.env_kwargs.get("fingering", FINGERINGS[0])
        own = {"score"} if fingering in FINGERINGS else {"score", "fingering"}
        own |= self.piece_options
        return dataclasses.replace(
            self,
            env_kwargs={name: value for name, value in self.env_kwargs.items() if name not in own},
            env_wrapper=tuple(
                one
                for one in self.env_wrapper
                if not getattr(import_name(one.path), "chooses_piece", False)
            ),
        )

    @property
    def network(self) -> str | None:
        """The file of the sight-reader's network that is corrected, if any is named."""
        files = [p.kwargs.get("model") for p in self.env_wrapper if p.is_a(PlayerResidual)]
        return files[0] if files else None

    def correcting(self, **arguments: Any) -> Self:
        """Return the settings with other arguments of the wrapper that corrects a player.

        Raises:
            ConfigError: If there is none.
        """
        if not any(plugin.is_a(PlayerResidual) for plugin in self.env_wrapper):
            raise ConfigError(
                "env_wrapper has no sb3_piano.players.PlayerResidual, which corrects a player: "
                "expected it after sb3_piano.wrappers.HandActions."
            )
        wrappers = with_arguments(self.env_wrapper, PlayerResidual, **arguments)
        return dataclasses.replace(self, env_wrapper=wrappers)

    @property
    def base(self) -> str | None:
        """The folder of the run whose model is corrected, if one is."""
        runs = [p.kwargs.get("run") for p in self.env_wrapper if p.is_a(CorrectsRun)]
        return runs[0] if runs else None

    def with_base(self, folder: str) -> Self:
        """Return the settings with another folder of that run."""
        wrappers = with_arguments(self.env_wrapper, CorrectsRun, run=folder)
        return dataclasses.replace(self, env_wrapper=wrappers)

    def to_mapping(self) -> dict[str, Any]:
        """Return the config in YAML's types, which the class can be called with again."""
        mapping = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        for name, value in mapping.items():
            if isinstance(value, tuple):
                mapping[name] = [
                    {each.path: dict(each.kwargs)} if isinstance(each, Plugin) else each
                    for each in value
                ]
        return {name: plain(value, name) for name, value in mapping.items()}

    def _check_algorithm_kwargs(self, made: type) -> dict[str, Any]:
        """Fit the constructor's arguments to what plays; return them."""
        others = [f.name for f in dataclasses.fields(self) if f.name != "algorithm_kwargs"]
        arguments = check_arguments(
            self.algorithm_kwargs, made, reserved=_OF_ALGORITHM, also_known=others
        )
        self._set(algorithm_kwargs=arguments)
        return arguments

    def _set(self, **values: Any) -> None:
        for name, value in values.items():
            object.__setattr__(self, name, value)


@settings
class PlannedConfig(PlayConfig):
    """All settings of a run that plays without training.

    ``algo`` is one of :data:`~sb3_piano.training.PLANNERS`.

    Raises:
        ConfigError: If a setting is unknown, has the wrong type or is out of range.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        checked("algo", self.algo, Literal[PLANNERS])
        self._check_algorithm_kwargs(player_class(self.algo))

    @property
    def network(self) -> str | None:
        """The file of the network that plays, if any is named."""
        return self.algorithm_kwargs.get("model")

    def playing(self, **arguments: Any) -> Self:
        """Return the settings with other arguments of what plays."""
        kwargs = {**self.algorithm_kwargs, **arguments}
        return dataclasses.replace(self, algorithm_kwargs=kwargs)


@settings
class RunConfig(PlayConfig):
    """All settings of a training, checked.

    ``algo`` is one of :data:`~sb3_piano.training.ALGORITHMS`.

    Raises:
        ConfigError: If a setting is unknown, has the wrong type or is out of range.
    """

    n_timesteps: Annotated[_Whole, Ge(1), Le(10**15)]
    """Environment steps to train for, over all environments together; at least 1. Where hands are
    agents, each hand's step is one."""
    policy: str = "MlpPolicy"
    """A policy of the algorithm by its short name, or the import path of one."""
    pieces: Annotated[tuple[str, ...], BeforeValidator(_read_pieces)] = ()
    """What ``RoboPianist-v0`` plays, in place of a ``score``: entries of
    :func:`~sb3_piano.music.select_pieces`. They are dealt out to the environments in turn; one that
    has several draws one for each episode."""
    n_envs: Annotated[_Whole, Ge(1)] = 1
    """Environments that play at the same time; at least 1."""
    vec_env: Literal["dummy", "threads", "processes", "subproc"] = "dummy"
    """``dummy``: one plays after the other; ``threads``: in threads of this process;
    ``processes``: in as many processes as there are cores; ``subproc``: each in a process of its
    own."""
    num_threads: Annotated[_Whole, Ge(1)] | None = None
    """Threads of torch, at least 1; by default as :func:`~sb3_piano.threads.torch_computing`
    chooses: one, unless ``OMP_NUM_THREADS`` or ``MKL_NUM_THREADS`` is set."""
    matmul_precision: MatmulPrecision | None = None
    """Precision of torch's matrix products: ``highest`` (torch's own), ``high`` or ``medium``,
    which is faster on processors with AVX-512; see :func:`~sb3_piano.threads.torch_computing`."""
    vec_env_wrapper: Annotated[_Plugins, _plugins_below(VecEnvWrapper)] = ()
    """Wrappers put around the vector of environments, the first one innermost."""
    callback: Annotated[_Plugins, _plugins_below(BaseCallback)] = ()
    """SB3 callbacks of the training."""
    normalize: Annotated[
        bool | Mapping[str, Any], _arguments_of(VecNormalize, "venv", "training")
    ] = False
    """Whether to put ``VecNormalize`` around the environments; a mapping has its arguments."""
    monitor_kwargs: Annotated[Mapping[str, Any], _arguments_of(Monitor, *_OF_MONITOR)] = field(
        default_factory=dict
    )
    """Keyword arguments of ``Monitor``, such as ``info_keywords``."""
    noise_type: Literal["normal", "ornstein-uhlenbeck"] | None = None
    """Noise added to actions: ``normal``, ``ornstein-uhlenbeck`` or none."""
    noise_std: Annotated[_Number, Ge(0)] | None = None
    """Standard deviation of that noise, of actions in [-1, 1]; at least 0."""

    def __post_init__(self) -> None:
        algorithm = self.algorithm
        super().__post_init__()
        if (self.noise_type is None) != (self.noise_std is None):
            raise ConfigError(
                f"noise_type is {self.noise_type!r} and noise_std {self.noise_std!r}: expected "
                "both or neither."
            )
        if self.noise_type and "action_noise" not in inspect.signature(algorithm).parameters:
            raise ConfigError(
                f"noise_type is {self.noise_type!r}, but {algorithm.__name__} takes no action "
                "noise: expected an off-policy algorithm, or no noise_type."
            )
        self._check_pieces()
        self._check_episodes()
        arguments = self._check_algorithm_kwargs(algorithm)
        device = arguments.get("device", "auto")
        try:
            get_device(device)
        except (RuntimeError, TypeError) as error:
            raise ConfigError(
                f"device is {device!r}: expected auto, cpu, cuda or another of torch's ({error})."
            ) from error
        policy = _policy_class(self.policy, algorithm)
        if arguments.get("policy_kwargs") is not None:
            spaces = ("observation_space", "action_space", "lr_schedule")
            fitting = check_arguments(arguments["policy_kwargs"], policy, reserved=spaces)
            arguments["policy_kwargs"] = fitting

    def _check_episodes(self) -> None:
        """Refuse what SB3 would refuse when the training begins."""
        every = self.algorithm_kwargs.get("train_freq")
        pair = list(every) if isinstance(every, list | tuple) else []
        if pair[1:] == ["episode"] and self.n_agents > 1:
            raise ConfigError(
                f"train_freq is {pair!r} with {self.n_agents} agents in {self.n_envs} "
                "environment(s): expected [N, step], or one agent in one environment."
            )

    def _check_pieces(self) -> None:
        if not self.pieces:
            return
        score = self.env_kwargs.get("score")
        if self.env_id != GENERAL_ID or score is not None:
            raise ConfigError(
                f"pieces are given to {self.env_id!r} with the score {score!r}: expected "
                f"{GENERAL_ID}, which plays any piece, without a score."
            )
        if len(self.pieces) > 1 and self.env_kwargs.get("observation") == "window":
            raise ConfigError(
                f"{len(self.pieces)} pieces are given with observation 'window', which is as wide "
                "as a piece: expected 'roll', or another that is the same for all."
            )

    @property
    def algorithm(self) -> type[BaseAlgorithm]:
        """The class of the algorithm."""
        return algorithm_class(self.algo)

    @property
    def learns_entropy(self) -> bool:
        """Whether the algorithm learns its entropy coefficient."""
        known = inspect.signature(self.algorithm).parameters.get("ent_coef")
        default = None if known is None else known.default
        return str(self.algorithm_kwargs.get("ent_coef", default)).startswith("auto")

    @property
    def n_agents(self) -> int:
        """How many environment steps a call of the environments together is.

        As many as there are environments, or hands in them if each is an agent.
        """
        hands = 1
        if any(plugin.is_a(HandsAsAgents) for plugin in self.vec_env_wrapper):
            options = {**gym.spec(self.env_id).kwargs, **self.env_kwargs}
            side = options.get("hands_in_scene", "both")
            hands = max(len(PianoEnvConfig(hands_in_scene=side).sides), 1)
        return hands * self.n_envs

    @property
    def own_pieces(self) -> Sequence[Any]:
        """What is played, as far as it has names: pieces, or the one of the environment's id."""
        return self.pieces or super().own_pieces

    def alone(self) -> Self:
        """Return the settings for one environment without log files."""
        return dataclasses.replace(self, n_envs=1, vec_env="dummy", monitor_kwargs={})

    def of_env(self, index: int) -> Self:
        """Return the settings of one of the environments, with the pieces that it gets."""
        if not self.pieces:
            return self
        own = self.pieces[index :: self.n_envs] or (self.pieces[index % len(self.pieces)],)
        # Options of studies are told to the first piece that has them, and so hold for all.
        options = self.piece_options
        first = next((piece for piece in own if options <= _options_of(piece)), own[0])
        ours = {
            name: value
            for name, value in self.env_kwargs.items()
            if name not in options or name in _options_of(first)
        }
        chooser = Plugin(path=_RANDOM_PIECE, kwargs={"pieces": list(own)})
        wrappers = self.env_wrapper if len(own) == 1 else (chooser, *self.env_wrapper)
        changed = dataclasses.replace(self, pieces=(), env_wrapper=wrappers, env_kwargs=ours)
        return changed.in_env(score=first)


def _options_of(piece: Any) -> set[str]:
    """Return names of the options of a piece, but for ``hands``, which the environment has, too."""
    if not isinstance(piece, str) or is_path(piece):
        return set()
    return set(find_piece(piece).options) - {"hands"}


class CorrectsRun:
    """Marks wrappers that correct the model of a run, whose folder is their argument ``run``."""


def _policy_class(policy: str, algorithm: type[BaseAlgorithm]) -> type[BasePolicy]:
    aliases = algorithm.policy_aliases
    if policy in aliases:
        return aliases[policy]
    if "." not in policy:
        raise ConfigError(
            f"Unknown policy {policy!r} of {algorithm.__name__}.{near_names(policy, aliases)} "
            f"Expected {', '.join(aliases)} or the import path of a policy."
        )
    found: type[BasePolicy] = class_of(policy, (BasePolicy,), "policy")
    return found
