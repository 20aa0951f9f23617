"""Search spaces, tried out before anything is trained."""

from __future__ import annotations

import contextlib
import dataclasses
import warnings
from collections.abc import Callable, Mapping
from typing import Any

from sb3_piano.exceptions import ConfigError, SB3PianoError
from sb3_piano.training import RunConfig, entry_config
from sb3_piano.training.configuration.values import coerce, linear_start, parameters_of
from sb3_piano.training.runs.builders import build_model, build_vec_env
from sb3_piano.tuning.search_space.entry_paths import (
    MISSING,
    outermost_first,
    setting_at,
    with_setting,
)
from sb3_piano.tuning.search_space.parsing import Parameter

_Need = tuple[Callable[[float], bool], str]
_SHARE: _Need = (lambda x: 0 <= x <= 1, "0 to 1")
_POSITIVE: _Need = (lambda x: x > 0, "more than 0")
_COUNT: _Need = (lambda x: x >= 1, "1 or more")
_NOT_NEGATIVE: _Need = (lambda x: x >= 0, "0 or more")

# Arguments of SB3's algorithms that these take without a look, and then learn nothing.
_NEEDS: Mapping[str, _Need] = {
    "gamma": _SHARE,
    "tau": _SHARE,
    "gae_lambda": _SHARE,
    "learning_rate": _POSITIVE,
    "clip_range": _POSITIVE,
    "max_grad_norm": _POSITIVE,
    "batch_size": _COUNT,
    "buffer_size": _COUNT,
    "n_steps": _COUNT,
    "n_epochs": _COUNT,
    "policy_delay": _COUNT,
    "train_freq": _COUNT,
    "gradient_steps": (lambda x: x >= 1 or x == -1, "1 or more, or -1 for as many as steps"),
    "learning_starts": _NOT_NEGATIVE,
    "target_policy_noise": _NOT_NEGATIVE,
    "target_noise_clip": _NOT_NEGATIVE,
}

# What the environment is made of; everything else is the algorithm's.
_OF_THE_ENVIRONMENT = (
    "env_kwargs", "env_wrapper", "vec_env_wrapper", "normalize", "monitor_kwargs"
)  # fmt: skip

# For models that are built only to see whether they can be.
_CHEAP = {"device": "cpu", "verbose": 0, "buffer_size": 100}


def check_space(
    space: Mapping[str, Parameter], algo: str, env_id: str, entry: Mapping[str, Any]
) -> None:
    """Try every parameter at its extremes where it enters: config, environment, model.

    All others are as in the entry. Should that fail, those that the entry lacks are at an extreme
    too, as some settings go only together.

    Raises:
        ConfigError: If a setting is unknown, or one of its values impossible.
    """
    with _Workshop(algo, env_id, entry) as workshop:
        lacking = {
            name: parameter.extremes()[0]
            for name, parameter in space.items()
            if setting_at(entry, name) is MISSING
        }
        for name, parameter in space.items():
            _check_parameter(workshop, name, parameter.extremes(), lacking)


def _check_parameter(
    workshop: _Workshop, name: str, values: list[Any], lacking: Mapping[str, Any]
) -> None:
    failures = []
    for value in values:
        reason = workshop.objection(name, {name: value})
        if reason is not None and workshop.objection(name, {**lacking, name: value}) is not None:
            failures.append((value, reason))
    if failures:
        value, reason = failures[0]
        # What is said of all values is not about this one.
        of_all = len(failures) == len(values) and len({said for _, said in failures}) == 1
        where = repr(name) if of_all else f"{name!r} = {value!r}"
        raise ConfigError(f"Search space: {where}: {reason}")


class _Workshop:
    """Builds environments and models, one after the other."""

    def __init__(self, algo: str, env_id: str, entry: Mapping[str, Any]):
        self._algo, self._env_id, self._entry = algo, env_id, entry
        self._venv = build_vec_env(self._config({}))

    def __enter__(self) -> _Workshop:
        return self

    def __exit__(self, *exception: object) -> None:
        self._venv.close()

    def objection(self, name: str, settings: Mapping[str, Any]) -> str | None:
        """Return why a run with these settings, of which ``name`` matters, is impossible."""
        try:
            self._build(self._config(settings), new_env=name.split(".")[0] in _OF_THE_ENVIRONMENT)
        except Exception as error:  # environments and algorithms may refuse values in any way
            known = isinstance(error, SB3PianoError)
            return str(error) if known else f"{type(error).__name__}: {error}"
        return _unmet_need(name, settings[name])

    def _config(self, settings: Mapping[str, Any]) -> RunConfig:
        entry = self._entry
        for name in outermost_first(settings):
            entry = with_setting(entry, name, settings[name])
        config = entry_config(self._algo, self._env_id, entry)
        cheap = {k: v for k, v in _CHEAP.items() if k in parameters_of(config.algorithm)}
        arguments = {**config.algorithm_kwargs, **cheap}
        return dataclasses.replace(config, n_envs=1, vec_env="dummy", algorithm_kwargs=arguments)

    def _build(self, config: RunConfig, *, new_env: bool) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # they come when the trial is trained
            if not new_env:
                build_model(config, self._venv)
                return
            with contextlib.closing(build_vec_env(config)) as venv:
                build_model(config, venv)
                venv.reset()


def _unmet_need(name: str, value: Any) -> str | None:
    if name not in _NEEDS:
        return None
    start = linear_start(value)
    try:
        number = coerce(value, float, name) if start is None else start
    except ConfigError:
        return None  # not a number, as [1, episode] for train_freq
    meets, words = _NEEDS[name]
    return None if meets(number) else f"{name} is {value!r}: expected {words}."
