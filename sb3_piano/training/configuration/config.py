"""Settings of a training."""

from __future__ import annotations

import dataclasses
import functools
import inspect
from collections.abc import Callable, Mapping
from dataclasses import field
from typing import Annotated, Any, Literal, Self

from annotated_types import Ge, Le
from pydantic import BeforeValidator, ValidationInfo
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.utils import get_device
from stable_baselines3.common.vec_env import VecEnvWrapper, VecNormalize

from sb3_piano.envs import PianoEnvConfig
from sb3_piano.exceptions import ConfigError, near_names
from sb3_piano.settings import (
    Count,
    Index,
    NotNegative,
    Positive,
    Share,
    Whole,
    checked,
    settings,
)
from sb3_piano.threads import MatmulPrecision
from sb3_piano.training.configuration.env_spec import (
    Arguments,
    EnvSpec,
    Pieces,
    Wrappers,
    plugins_below,
    read_arguments,
)
from sb3_piano.training.configuration.names import algorithm_class
from sb3_piano.training.configuration.plugins import Plugin
from sb3_piano.training.configuration.values import (
    check_arguments,
    class_of,
    linear_start,
    plain,
)
from sb3_piano.vec_env import HandsAsAgents


def _arguments_of(function: Callable[..., Any], *reserved: str) -> BeforeValidator:
    def read(value: Any, info: ValidationInfo) -> Any:
        if isinstance(value, bool):
            return value
        return check_arguments(read_arguments(value, info), function, reserved=reserved)

    return BeforeValidator(read)


_Plugins = tuple[Plugin, ...]

# Replay buffers with the samples of SB3's own.
_SAME_SAMPLES = (
    "stable_baselines3.common.buffers.ReplayBuffer",
    "sb3_piano.buffers.compact.CompactReplayBuffer",
    "sb3_piano.buffers.CompactReplayBuffer",
)

# Arguments that a run sets itself.
_OF_MONITOR = ("env", "filename", "override_existing", "reset_keywords")
_OF_ALGORITHM = ("policy", "env", "seed", "tensorboard_log", "action_noise")

# Arguments of SB3's algorithms that these take without a look, and then learn nothing.
_RANGES: Mapping[str, Any] = {
    **dict.fromkeys(("gamma", "tau", "gae_lambda"), Share),
    **dict.fromkeys(("learning_rate", "clip_range", "max_grad_norm"), Positive),
    **dict.fromkeys(("batch_size", "buffer_size", "n_steps", "n_epochs", "policy_delay"), Count),
    "train_freq": Count,
    **dict.fromkeys(("learning_starts", "target_policy_noise", "target_noise_clip"), NotNegative),
}


@settings
class RunConfig:
    """All settings of a training, validated, flat as in YAML; :attr:`env` groups the environment's.

    Raises:
        ConfigError: If a setting is unknown, has the wrong type or is out of range.
    """

    algo: str
    """Name of the algorithm, one of :data:`~sb3_piano.training.configuration.names.ALGORITHMS`."""
    env_id: str
    """Id of the environment; ``module:Id`` imports the module that registers it."""
    env_module: str | None = None
    """Module to import before the environment is made."""
    seed: Index | None = None
    """Seed of everything random, at least 0; ``None``: a training draws and saves one."""
    env_kwargs: Arguments = field(default_factory=dict)
    """Keyword arguments of the environment."""
    env_wrapper: Wrappers = ()
    """Wrappers of each environment, the first one innermost."""
    algorithm_kwargs: Arguments = field(default_factory=dict)
    """Arguments of the constructor of the algorithm."""
    n_timesteps: Annotated[Whole, Ge(1), Le(10**15)]
    """Total environment steps over all environments, at least 1. Where hands are agents, each
    hand's step counts."""
    policy: str = "MlpPolicy"
    """A policy's short name, or its import path."""
    pieces: Pieces = ()
    """Pieces of ``RoboPianist-v0``, in place of a ``score``: entries of
    :func:`~sb3_piano.music.select_pieces`. They are distributed to the environments in turn; an
    environment with several draws one per episode."""
    n_envs: Count = 1
    """Number of parallel environments, at least 1."""
    vec_env: Literal["dummy", "threads", "processes", "subproc", "batch", "warp"] = "dummy"
    """``dummy``: environments run in sequence; ``threads``: in threads of this process;
    ``processes``: in one process per core; ``subproc``: in one process per environment; ``batch``:
    as one :class:`~sb3_piano.batch.BatchedPiano` on MuJoCo's threads; ``warp``: as one on a GPU, by
    MuJoCo Warp. Evaluations play in a single environment in any case."""
    num_threads: Count | None = None
    """Threads of torch, at least 1; by default as :func:`~sb3_piano.threads.torch_computing`
    chooses: one, unless ``OMP_NUM_THREADS`` or ``MKL_NUM_THREADS`` is set."""
    matmul_precision: MatmulPrecision | None = None
    """Precision of torch's matrix products: ``highest`` (torch's default), ``high`` or ``medium``,
    faster on processors with AVX-512; see :func:`~sb3_piano.threads.torch_computing`."""
    vec_env_wrapper: Annotated[_Plugins, plugins_below(VecEnvWrapper)] = ()
    """Wrappers of the vector of environments, the first one innermost."""
    callback: Annotated[_Plugins, plugins_below(BaseCallback)] = ()
    """SB3 callbacks of the training."""
    normalize: Annotated[
        bool | Mapping[str, Any], _arguments_of(VecNormalize, "venv", "training")
    ] = False
    """Whether to use ``VecNormalize``; a mapping gives its arguments."""
    monitor_kwargs: Annotated[Mapping[str, Any], _arguments_of(Monitor, *_OF_MONITOR)] = field(
        default_factory=dict
    )
    """Keyword arguments of ``Monitor``, such as ``info_keywords``."""
    noise_type: Literal["normal", "ornstein-uhlenbeck"] | None = None
    """Action noise: ``normal``, ``ornstein-uhlenbeck`` or none."""
    noise_std: NotNegative | None = None
    """Standard deviation of the action noise, for actions in [-1, 1]; at least 0."""

    def __post_init__(self) -> None:
        algorithm = self.algorithm
        self.__dict__.update(env_module=self.env.module, env_id=self.env.id)
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
        self._check_episodes()
        others = [f.name for f in dataclasses.fields(self) if f.name != "algorithm_kwargs"]
        arguments = check_arguments(
            self.algorithm_kwargs, algorithm, reserved=_OF_ALGORITHM, also_known=others
        )
        self.__dict__["algorithm_kwargs"] = arguments
        for name, value in arguments.items():
            start = linear_start(value)
            number = value if start is None else start
            if name in _RANGES and isinstance(number, int | float):
                checked(name, number, _RANGES[name])
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
        """Raise an error for a ``train_freq`` that SB3 would reject at the start of training."""
        every = self.algorithm_kwargs.get("train_freq")
        pair = list(every) if isinstance(every, list | tuple) else []
        if pair[1:] == ["episode"] and self.n_agents > 1:
            raise ConfigError(
                f"train_freq is {pair!r} with {self.n_agents} agents in {self.n_envs} "
                "environment(s): expected [N, step], or one agent in one environment."
            )

    @functools.cached_property
    def env(self) -> EnvSpec:
        """The environment."""
        return EnvSpec(
            id=self.env_id,
            module=self.env_module,
            options=self.env_kwargs,
            wrappers=self.env_wrapper,
            pieces=self.pieces,
        )

    def with_env(self, env: EnvSpec) -> Self:
        """Return the settings with another environment."""
        named: dict[str, Any] = {"env_id": env.id, "env_module": env.module, "pieces": env.pieces}
        return dataclasses.replace(self, **named, env_kwargs=env.options, env_wrapper=env.wrappers)

    def in_env(self, **options: Any) -> Self:
        """Return the settings with other options of the environment."""
        return self.with_env(self.env.with_options(**options))

    @property
    def labels(self) -> dict[str, str]:
        """Identity of the run, saved in its files."""
        return {"algo": self.algo, "env_id": self.env_id}

    def to_mapping(self) -> dict[str, Any]:
        """Return the config in YAML's types, as arguments of the class."""
        mapping = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        for name in ("env_wrapper", "vec_env_wrapper", "callback"):
            mapping[name] = [{each.path: dict(each.kwargs)} for each in mapping[name]]
        return {name: plain(value, name) for name, value in mapping.items()}

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
    def is_batched(self) -> bool:
        """Whether the environments are worlds of one batch."""
        return self.vec_env in ("batch", "warp")

    def batched(self, worlds: int, device: str | None = None) -> Self:
        """Return the settings for a batch of worlds.

        They are on MuJoCo's threads, or by MuJoCo Warp with a ``device`` such as "cuda", which has
        the networks, too. A replay buffer moves to the device of the networks, unless the settings
        name one of another kind than SB3's own or ours in its place.
        """
        arguments = dict(self.algorithm_kwargs)
        if device is not None:
            arguments["device"] = device
        buffer = "replay_buffer_class"
        takes_one = buffer in inspect.signature(self.algorithm).parameters
        if takes_one and arguments.get(buffer) in (None, *_SAME_SAMPLES):
            arguments[buffer] = "sb3_piano.batch.DeviceReplayBuffer"
        kind: Any = "warp" if str(device).startswith("cuda") else "batch"
        return dataclasses.replace(self, n_envs=worlds, vec_env=kind, algorithm_kwargs=arguments)

    @property
    def n_agents(self) -> int:
        """Number of environment steps per call of the vector of environments.

        It equals the number of environments, or of their hands if each is an agent.
        """
        hands = 1
        if any(plugin.is_a(HandsAsAgents) for plugin in self.vec_env_wrapper):
            side = self.env.all_options.get("hands_in_scene", "both")
            hands = max(len(PianoEnvConfig(hands_in_scene=side).sides), 1)
        return hands * self.n_envs

    def alone(self) -> Self:
        """Return the settings for one environment without log files."""
        return dataclasses.replace(self, n_envs=1, vec_env="dummy", monitor_kwargs={})


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
