"""What a study searches, and what its trials are worth: all that makes two studies the same."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sb3_piano.callbacks import F1Callback, MetricEvalCallback, OnsetF1Callback
from sb3_piano.exceptions import ConfigError, near_names
from sb3_piano.training import RunConfig, entry_config
from sb3_piano.training.runs.folder import FILE_OPTIONS
from sb3_piano.tuning.search_space.defaults import with_defaults
from sb3_piano.tuning.search_space.space import Space

METRICS: Mapping[str, type[MetricEvalCallback]] = {
    callback.metric: callback for callback in (F1Callback, OnsetF1Callback)
}
"""What trials may be judged by, and the callback that evaluates it during training."""

OBJECTIVES = ("final", "best")
"""The model that counts: the one at the end of a training, or the best one it had."""


@dataclass(frozen=True, kw_only=True)
class StudyConfig:
    """What a study searches and how its trials are judged.

    Raises:
        ConfigError: If a setting is unknown or out of range.
    """

    algo: str
    """Name of the algorithm."""
    env_id: str
    """Id of the environment; ``module:Id`` imports the module that registers it."""
    entry: Mapping[str, Any]
    """The settings from which trials depart, as an entry of an RL Zoo YAML file; ``n_timesteps``
    are the environment steps of one training."""
    space: Space
    """What is searched."""
    metric: str = "f1"
    """One of :data:`METRICS`."""
    objective: str = "final"
    """One of :data:`OBJECTIVES`."""
    seeds: tuple[int, ...] = (0,)
    """A trial trains once from each of these seeds; its value is the mean."""
    eval_seed: int = 1000
    """Seed of the evaluations; none of ``seeds``."""
    eval_episodes: int = 1
    """Episodes of an evaluation, at least 1. One is enough for a piece that always starts alike."""
    n_evaluations: int = 5
    """Evaluations of a training, at equal distances, at least 1; a trial may be pruned at each."""
    minutes: float | None = None
    """The longest that the trainings of a trial may take together; each has an equal share."""

    def __post_init__(self) -> None:
        check_choice("metric", self.metric, METRICS)
        check_choice("objective", self.objective, OBJECTIVES)
        for name in ("eval_episodes", "n_evaluations"):
            if getattr(self, name) < 1:
                raise ConfigError(f"{name} is {getattr(self, name)}: expected 1 or more.")
        if self.minutes is not None and not self.minutes > 0:
            raise ConfigError(f"minutes is {self.minutes}: expected more than 0.")
        self._check_seeds()
        steps = self.config.n_timesteps
        if steps < self.n_evaluations:
            raise ConfigError(
                f"n_evaluations is {self.n_evaluations}, in {steps} steps: expected at most one "
                "evaluation for each step."
            )

    @property
    def config(self) -> RunConfig:
        """The run from which trials depart."""
        return entry_config(self.algo, self.env_id, self.entry)

    def preset_params(self) -> dict[str, Any]:
        """Return the params of a trial with the settings of the entry, defaults included.

        What the space does not hold is left out.
        """
        return self.space.params_of(with_defaults(self.algo, self.env_id, self.entry))

    def to_mapping(self) -> dict[str, Any]:
        """Return the study in JSON's and YAML's types; :meth:`from_mapping` gives it back."""
        return {
            "algo": self.algo,
            "env_id": self.env_id,
            "metric": self.metric,
            "objective": self.objective,
            "seeds": list(self.seeds),
            "eval_seed": self.eval_seed,
            "eval_episodes": self.eval_episodes,
            "n_evaluations": self.n_evaluations,
            "minutes": self.minutes,
            "space": self.space.to_mapping(),
            "entry": dict(self.entry),
        }

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any]) -> StudyConfig:
        """Return the study that :meth:`to_mapping` wrote.

        Raises:
            ConfigError: If a setting is not valid.
        """
        fields = dict(mapping)
        space = Space.from_mapping(fields.pop("space"))
        return cls(**{**fields, "space": space, "seeds": tuple(fields["seeds"])})

    def identity(self) -> dict[str, Any]:
        """Return what has to be equal where several machines work on one study.

        It is :meth:`to_mapping`, with the content of a file (a score, finger labels) in place of
        its path, which may be another on each machine.
        """
        mapping = self.to_mapping()
        kwargs = dict(self.config.env_kwargs)
        for option in FILE_OPTIONS:
            file = kwargs.get(option)
            if isinstance(file, str) and Path(file).is_file():
                kwargs[option] = f"sha256 {hashlib.sha256(Path(file).read_bytes()).hexdigest()}"
                mapping["entry"]["env_kwargs"] = kwargs
        return mapping

    def _check_seeds(self) -> None:
        if not self.seeds or min(self.seeds) < 0 or len(set(self.seeds)) < len(self.seeds):
            raise ConfigError(
                f"seeds are {list(self.seeds)}: expected one or more, from 0 on, each only once."
            )
        if self.eval_seed < 0 or self.eval_seed in self.seeds:
            raise ConfigError(
                f"eval_seed is {self.eval_seed}: expected a seed from 0 on that no training has "
                f"({', '.join(map(str, self.seeds))})."
            )


def check_choice(name: str, value: str, valid: Collection[str]) -> None:
    """Refuse a value that is none of those that are valid.

    Raises:
        ConfigError: If it is not.
    """
    if value not in valid:
        raise ConfigError(
            f"{name} is {value!r}: expected one of {', '.join(map(repr, valid))}."
            f"{near_names(str(value), valid)}"
        )
