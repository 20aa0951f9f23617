"""What a training run is made of."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import gymnasium as gym
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.utils import get_device
from stable_baselines3.common.vec_env import VecEnvWrapper, VecNormalize

from sb3_piano.exceptions import ConfigError, near_names
from sb3_piano.planning import PianoPolicy
from sb3_piano.training.algorithms import PLANNERS, algorithm_class, planner_class
from sb3_piano.training.coerce import check_arguments, coerce, coerce_mapping
from sb3_piano.training.env_ids import registered_id
from sb3_piano.training.import_names import import_class
from sb3_piano.training.plain import plain, plain_mapping
from sb3_piano.training.plugins import Plugin, parse_plugins, plugins_to_plain

NOISE_TYPES = ("normal", "ornstein-uhlenbeck")
VEC_ENVS = ("dummy", "threads", "subproc")
# What the classes of these fields must be below.
_PLUGIN_FIELDS = {
    "env_wrapper": gym.Wrapper, "vec_env_wrapper": VecEnvWrapper, "callback": BaseCallback
}  # fmt: skip

_Class = type[BaseAlgorithm] | type[PianoPolicy]

# Parameters of an algorithm's constructor that a run sets itself.
_RESERVED = ("policy", "env", "seed", "tensorboard_log", "action_noise")


@dataclass(frozen=True, kw_only=True)
class RunConfig:
    """All settings of a run, checked, in types that YAML can hold.

    Raises:
        ConfigError: If a setting is unknown, has the wrong type or is out of range.
    """

    algo: str
    """Name of the algorithm, one of :data:`~sb3_piano.training.ALGORITHMS` or, to play without
    training, of :data:`~sb3_piano.training.PLANNERS`."""
    env_id: str
    """Id of the environment; ``module:Id`` imports the module that registers it."""
    n_timesteps: int
    """Environment steps to train for, over all environments together; at least 1."""
    policy: str = "MlpPolicy"
    """A policy of the algorithm by its short name, or the import path of one."""
    seed: int | None = None
    """Seed of everything random, at least 0; ``None`` lets the run draw one and note it down."""
    n_envs: int = 1
    """Environments that play at the same time; at least 1."""
    vec_env: str = "dummy"
    """``dummy``: one plays after the other; ``threads``: in threads of this process; ``subproc``:
    each in a process of its own."""
    num_threads: int | None = None
    """Threads of torch, at least 1; by default as :func:`~sb3_piano.threads.torch_threads`
    chooses: one, unless ``OMP_NUM_THREADS`` or ``MKL_NUM_THREADS`` is set."""
    env_module: str | None = None
    """Module to import before the environment is made."""
    env_kwargs: Mapping[str, Any] = field(default_factory=dict)
    """Keyword arguments of the environment."""
    env_wrapper: tuple[Plugin, ...] = ()
    """Wrappers put around each environment, the first one innermost."""
    vec_env_wrapper: tuple[Plugin, ...] = ()
    """Wrappers put around the vector of environments, the first one innermost."""
    callback: tuple[Plugin, ...] = ()
    """SB3 callbacks of the training."""
    normalize: bool | Mapping[str, Any] = False
    """Whether to put ``VecNormalize`` around the environments; a mapping has its arguments."""
    monitor_kwargs: Mapping[str, Any] = field(default_factory=dict)
    """Keyword arguments of ``Monitor``, such as ``info_keywords``."""
    noise_type: str | None = None
    """Noise added to actions: ``normal``, ``ornstein-uhlenbeck`` or none."""
    noise_std: float | None = None
    """Standard deviation of that noise, of actions in [-1, 1]; at least 0."""
    algorithm_kwargs: Mapping[str, Any] = field(default_factory=dict)
    """Arguments of the algorithm's constructor."""

    def __post_init__(self) -> None:
        for name in ("algo", "env_id", "policy"):
            coerce(getattr(self, name), str, name)
        coerce(self.env_module, str | None, "env_module")
        planner = self.algo in PLANNERS
        algorithm = planner_class(self.algo) if planner else algorithm_class(self.algo)
        module, env_id = registered_id(self.env_id, self.env_module)
        self._set(env_module=module, env_id=env_id)
        for name, minimum in (("n_timesteps", 1), ("n_envs", 1), ("seed", 0), ("num_threads", 1)):
            self._set(**{name: _at_least(minimum, getattr(self, name), name)})
        self._check_choice("vec_env", VEC_ENVS)
        self._check_noise(algorithm)
        for name, base in _PLUGIN_FIELDS.items():
            self._set(**{name: parse_plugins(getattr(self, name), name, base)})
        self._set(
            env_kwargs=_plain_arguments(self.env_kwargs, "env_kwargs"),
            normalize=_checked_normalize(self.normalize),
            monitor_kwargs=_checked_monitor(self.monitor_kwargs),
            algorithm_kwargs=_checked_algorithm(self.algorithm_kwargs, algorithm, self.policy),
        )

    @property
    def algorithm(self) -> type[BaseAlgorithm]:
        """The class of the algorithm.

        Raises:
            ConfigError: If it is none that is trained.
        """
        return algorithm_class(self.algo)

    def to_mapping(self) -> dict[str, Any]:
        """Return the config in YAML's types; :meth:`from_mapping` gives it back."""
        mapping = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        for name in _PLUGIN_FIELDS:
            mapping[name] = plugins_to_plain(mapping[name])
        return {name: plain(value, name) for name, value in mapping.items()}

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any]) -> RunConfig:
        """Return the config that :meth:`to_mapping` wrote.

        Raises:
            ConfigError: If a key is unknown or missing, or a value is not valid.
        """
        return cls(**_checked_fields(mapping))

    def _set(self, **values: Any) -> None:
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def _check_choice(self, name: str, valid: tuple[str, ...]) -> None:
        value = getattr(self, name)
        if value not in valid:
            raise ConfigError(
                f"{name} is {value!r}: expected one of {', '.join(map(repr, valid))}."
                f"{near_names(str(value), valid)}"
            )

    def _check_noise(self, algorithm: _Class) -> None:
        self._set(noise_std=_at_least(0.0, self.noise_std, "noise_std"))
        if (self.noise_type is None) != (self.noise_std is None):
            raise ConfigError(
                f"noise_type is {self.noise_type!r} and noise_std {self.noise_std!r}: expected "
                "both or neither."
            )
        if self.noise_type is None:
            return
        self._check_choice("noise_type", NOISE_TYPES)
        if "action_noise" not in inspect.signature(algorithm).parameters:
            raise ConfigError(
                f"noise_type is {self.noise_type!r}, but {algorithm.__name__} takes no action "
                "noise: expected an off-policy algorithm, or no noise_type."
            )


def _checked_fields(mapping: Mapping[str, Any]) -> dict[str, Any]:
    """Return a mapping as it is, if its keys are fields of :class:`RunConfig`.

    Raises:
        ConfigError: If a key is unknown, or one without a default is missing.
    """
    fields = {f.name: f for f in dataclasses.fields(RunConfig)}
    for name in mapping:
        if name not in fields:
            raise ConfigError(
                f"Unknown key {name!r}.{near_names(str(name), fields)} Expected one of "
                f"{', '.join(fields)}."
            )
    for name in ("algo", "env_id", "n_timesteps"):
        if name not in mapping:
            raise ConfigError(f"Key {name!r} is missing: it has no default.")
    return dict(mapping)


def _at_least(minimum: float, value: Any, name: str) -> Any:
    if value is None and name in ("seed", "noise_std", "num_threads"):
        return None
    number = coerce(value, type(minimum), name)
    if number < minimum:
        raise ConfigError(f"{name} is {number}: expected {minimum} or more.")
    return number


def _plain_arguments(value: Any, name: str) -> dict[str, Any]:
    return plain_mapping(coerce_mapping(value, name), name)


def _checked_normalize(value: Any) -> bool | dict[str, Any]:
    if isinstance(value, bool):
        return value
    arguments = _plain_arguments(value, "normalize")
    return check_arguments(arguments, VecNormalize, reserved=("venv", "training"))


def _checked_monitor(value: Any) -> dict[str, Any]:
    arguments = _plain_arguments(value, "monitor_kwargs")
    return check_arguments(
        arguments, Monitor, reserved=("env", "filename", "override_existing", "reset_keywords")
    )


def _checked_algorithm(value: Mapping[str, Any], algorithm: _Class, policy: str) -> dict[str, Any]:
    own = [f.name for f in dataclasses.fields(RunConfig) if f.name != "algorithm_kwargs"]
    arguments = check_arguments(
        _plain_arguments(value, "algorithm_kwargs"), algorithm, reserved=_RESERVED, also_known=own
    )
    if issubclass(algorithm, PianoPolicy):
        return arguments
    _check_device(arguments.get("device", "auto"))
    policy_kwargs = arguments.get("policy_kwargs")
    policy_class = _policy_class(policy, algorithm)
    if policy_kwargs is not None:
        arguments["policy_kwargs"] = check_arguments(
            policy_kwargs,
            policy_class,
            reserved=("observation_space", "action_space", "lr_schedule"),
        )
    return arguments


def _check_device(device: Any) -> None:
    try:
        get_device(device)
    except (RuntimeError, TypeError) as error:
        raise ConfigError(
            f"device is {device!r}: expected auto, cpu, cuda or another of torch's ({error})."
        ) from error


def _policy_class(policy: str, algorithm: type[BaseAlgorithm]) -> type[BasePolicy]:
    aliases = algorithm.policy_aliases
    if policy in aliases:
        return aliases[policy]
    if "." not in policy:
        raise ConfigError(
            f"Unknown policy {policy!r} of {algorithm.__name__}.{near_names(policy, aliases)} "
            f"Expected {', '.join(aliases)} or the import path of a policy."
        )
    try:
        return import_class(policy, BasePolicy)
    except ConfigError as error:
        raise ConfigError(f"policy: {error}") from error
