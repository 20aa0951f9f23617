"""What an entry stands for where it says nothing."""

from __future__ import annotations

import copy
import dataclasses
import inspect
from collections.abc import Mapping
from typing import Any

import gymnasium as gym

from sb3_piano.envs import DEFAULT_REWARD_WEIGHTS, PianoEnvConfig
from sb3_piano.envs.registration import ENTRY_POINT
from sb3_piano.training import RunConfig
from sb3_piano.training.configuration.names import algorithm_class, registered_id
from sb3_piano.training.configuration.values import coerce_mapping, parameters_of


def with_defaults(algo: str, env_id: str, entry: Mapping[str, Any]) -> dict[str, Any]:
    """Return a copy of an entry in which the defaults are written out that trials may search.

    They are those of the algorithm's constructor and, if it is a piano, of the environment. It is
    not for training: some of them are nothing that YAML could hold.

    Args:
        algo: Name of the algorithm.
        env_id: Id of the environment, or ``module:Id``.
        entry: The settings, as in an RL Zoo YAML file.

    Raises:
        ConfigError: If there is no such algorithm or environment.
    """
    parameters = parameters_of(algorithm_class(algo))
    defaults = {
        name: parameter.default
        for name, parameter in parameters.items()
        if parameter.default is not inspect.Parameter.empty
    }
    full = {"policy": RunConfig.policy, **defaults, **copy.deepcopy(dict(entry))}
    if gym.spec(registered_id(env_id)[1]).entry_point == ENTRY_POINT:
        full["env_kwargs"] = _with_env_defaults(full.get("env_kwargs"))
    return full


def _with_env_defaults(given: Any) -> dict[str, Any]:
    options = {
        option.name: option.default
        for option in dataclasses.fields(PianoEnvConfig)
        if option.default is not dataclasses.MISSING
    }
    env_kwargs = {**options, **coerce_mapping(given or {}, "env_kwargs")}
    weights = coerce_mapping(env_kwargs.get("reward_weights") or {}, "reward_weights")
    return {**env_kwargs, "reward_weights": {**DEFAULT_REWARD_WEIGHTS, **weights}}
