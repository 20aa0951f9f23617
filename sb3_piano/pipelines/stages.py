"""Settings of a curriculum: stages trained one after the other, and their YAML file."""

from __future__ import annotations

import dataclasses
import os
import re
from collections.abc import Mapping
from contextvars import ContextVar
from dataclasses import field
from pathlib import Path
from typing import Annotated, Any, Self

from annotated_types import MinLen
from pydantic import AfterValidator, BeforeValidator
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

from sb3_piano.callbacks import F1Callback, MetricEvalCallback, OnsetF1Callback
from sb3_piano.callbacks.condition import Condition
from sb3_piano.envs import GENERAL_ID
from sb3_piano.exceptions import ConfigError, naming
from sb3_piano.hyperparams import NAMED
from sb3_piano.metrics import EPISODE_METRICS
from sb3_piano.music.catalogue import is_path
from sb3_piano.plain_yaml import read_yaml_mapping
from sb3_piano.settings import Index, Listed, Share, TextOrPath, checked, refuse_unknown, settings
from sb3_piano.training.configuration.config import RunConfig
from sb3_piano.training.configuration.env_spec import FILE_OPTIONS
from sb3_piano.training.configuration.names import algorithm_class
from sb3_piano.training.configuration.plugins import Plugin, with_arguments
from sb3_piano.training.configuration.values import coerce_mapping, parameters_of, plain
from sb3_piano.training.configuration.yaml_files import load_config, merged, parted
from sb3_piano.training.runs.start import without_learnt_entropy

CURRICULUM_FILE = "curriculum.yml"

CONDITIONS = tuple(
    name
    for name in EPISODE_METRICS
    if name.endswith(("f1", "precision", "recall", "agreement", "return")) and name != "noop_f1"
)
"""Metrics that may end a stage: higher is better, and the maximum is 1."""

_EXAMPLE = "{piece: hanon-01}"
_PLAYED = ("piece", "pieces", "env")
_OTHERS = ("eval_freq", "patience")
# Settings that a stage's run gets from elsewhere, or sets itself.
_NOT_OF_STAGES = {"algo", "env_id", "env_module", "algorithm_kwargs", "seed", "settings"}
_NOT_OF_STAGES |= {"action_noise", "tensorboard_log"}


def _condition(value: Any) -> Any:
    """Parse the condition ``until`` of YAML: ``{onset_f1: 0.8, patience: 2}``."""
    if value is None or isinstance(value, Condition):
        return value
    others, least = parted(coerce_mapping(value, "until"), _OTHERS)
    refuse_unknown(least, (*CONDITIONS, *_OTHERS), "key", "until")
    least = {name: checked(f"until.{name}", value, Share) for name, value in least.items()}
    return Condition(thresholds=least, **others)


_folder: ContextVar[str] = ContextVar("_folder", default="")  # to which relative paths refer


def _joined(text: str) -> str:
    return os.path.abspath(os.path.join(_folder.get(), os.path.expanduser(text)))


def _absolute(text: str) -> str:
    """Return the absolute path of a file; leave other text as it is."""
    path = _joined(text)
    return path if text not in NAMED and (is_path(text) or os.path.isfile(path)) else text


def _settings(value: Any) -> Any:
    found = plain(value, "settings")
    if "env_kwargs" in found:
        found["env_kwargs"] = options = coerce_mapping(found["env_kwargs"], "env_kwargs")
        options |= {n: _absolute(options[n]) for n in FILE_OPTIONS if type(options.get(n)) is str}
    return found


_OneOrSeveral = BeforeValidator(lambda value: (value,) if isinstance(value, str) else value or ())
_Located = Annotated[TextOrPath, AfterValidator(_absolute)]


@settings
class Stage:
    """A stage: a piece, pieces or an environment, settings, and a condition for its end."""

    piece: _Located | None = None
    """Name or file of a piece, played in ``RoboPianist-v0``."""
    pieces: Annotated[tuple[_Located, ...], Listed, _OneOrSeveral] = ()
    """Several pieces instead: entries of :func:`~sb3_piano.music.select_pieces`."""
    env: str | None = None
    """Id of an environment instead; ``module:Id`` imports the module."""
    name: str | None = None
    """Name of the stage in its folder's name; by default that of the piece or environment."""
    config: _Located | None = None
    """Hyperparameters: ``path`` of :func:`~sb3_piano.training.load_config`."""
    until: Annotated[Condition | None, BeforeValidator(_condition)] = None
    """Condition that ends the stage before its ``n_timesteps``."""
    with_buffer: bool = False
    """Whether to start with the replay buffer of the run from which it starts."""
    with_entropy: bool = True
    """Whether to start with that run's entropy coefficient; if not, a learnt one is reset."""
    settings: Annotated[Mapping[str, Any], BeforeValidator(_settings)] = field(default_factory=dict)
    """Settings of its run that replace the hyperparameters, by their names in YAML; ``env_kwargs``
    are added."""

    def __post_init__(self) -> None:
        given = [name for name in _PLAYED if getattr(self, name)]
        if len(given) != 1:
            raise ConfigError(
                f"It has {' and '.join(given) or 'nothing to play'}: expected one of piece, pieces "
                "and env."
            )
        if self.until is not None:
            refuse_unknown(self.until.thresholds, CONDITIONS, "metric", "until")

    @property
    def label(self) -> str:
        """Name in characters allowed in a folder's name."""
        several = self.pieces[0] if len(self.pieces) == 1 else f"{len(self.pieces)}-pieces"
        played = Path(self.piece).stem if self.piece and is_path(self.piece) else self.piece
        return re.sub(r"[^\w.-]+", "-", self.name or played or self.env or several)

    def to_mapping(self) -> dict[str, Any]:
        """Return the stage in YAML's form."""
        own = {n: v for n in _OF_STAGES if (v := getattr(self, n)) != getattr(Stage, n)}
        if self.until is not None:
            own["until"] = _until(self.until)
        return plain({**own, **self.settings}, "stage")

    def run_config(self, algo: str) -> RunConfig:
        """Return the settings of its run, without seed and start."""
        own = {} if self.piece is None else {"env_kwargs": {"score": self.piece}}
        overrides = merged(self.settings, own)
        if self.pieces:
            overrides["pieces"] = self.pieces
        config = load_config(algo, self.env or GENERAL_ID, self.config, **overrides)
        if not (self.with_entropy or config.learns_entropy):
            raise without_learnt_entropy(config.algorithm)
        return config if self.until is None else _with_evaluation(config, self.until)


_OF_STAGES = tuple(f.name for f in dataclasses.fields(Stage) if f.name != "settings")


@settings
class Curriculum:
    """A curriculum: each stage starts from the previous one's model."""

    algo: str
    """Name of the algorithm, one of :data:`~sb3_piano.training.configuration.names.ALGORITHMS`."""
    stages: Annotated[tuple[Stage, ...], MinLen(1)]
    """Stages in order."""
    name: str = "curriculum"
    """Name of its folder."""
    init_from: Annotated[TextOrPath, AfterValidator(_joined)] | None = None
    """Folder of the run from which the first stage starts; by default from scratch."""
    seed: Index | None = None
    """Seed of each stage; if ``None``, one is drawn and saved."""

    def __post_init__(self) -> None:
        known, algorithm = _known_settings(self.algo), algorithm_class(self.algo)
        for number, stage in enumerate(self.stages, start=1):
            of = f"stage {number}"
            refuse_unknown(stage.settings, known, "setting", of, also_near=_OF_STAGES)
            if stage.with_buffer and not issubclass(algorithm, OffPolicyAlgorithm):
                raise ConfigError(
                    f"with_buffer is true of stage {number}, but {algorithm.__name__} has no "
                    "replay buffer: expected an off-policy algorithm, or no with_buffer."
                )
        if self.stages[0].with_buffer and self.init_from is None:
            raise ConfigError(
                "with_buffer is true of stage 1, which starts from nothing: expected init_from, "
                "too, or no with_buffer."
            )

    @property
    def run_names(self) -> tuple[str, ...]:
        """Names of the stages' folders, such as ``1_hanon-01``."""
        return tuple(f"{n}_{stage.label}" for n, stage in enumerate(self.stages, start=1))

    @classmethod
    def from_mapping(cls, mapping: Mapping[Any, Any]) -> Self:
        """Create a curriculum from YAML.

        YAML has the fields of this class; keys of :class:`Stage` that hold for all stages, with its
        ``settings`` as single keys; and ``stages``, a list of mappings of such keys.
        """
        names = [f.name for f in dataclasses.fields(cls)]
        own, common = parted(mapping, names)
        stages = own.get("stages")
        if not isinstance(stages, list) or not stages:
            raise ConfigError(f"stages is {stages!r}: expected a list of stages, as [{_EXAMPLE}].")
        if "algo" not in own:
            raise ConfigError("algo is missing: expected the name of an algorithm, such as sac.")
        known = [*_OF_STAGES, *_known_settings(own["algo"])]
        refuse_unknown(common, [*names, *known], "key", "a curriculum")
        made = []
        for number, entry in enumerate(stages, start=1):
            with naming(f"Stage {number}"):
                if not isinstance(entry, Mapping):
                    raise ConfigError(f"It is {entry!r}: expected a mapping, as {_EXAMPLE}.")
                unfit = _PLAYED if any(name in entry for name in _PLAYED) else ()
                of_stage, rest = parted(merged(parted(common, unfit)[1], entry), _OF_STAGES)
                made.append(Stage(**of_stage, settings=rest))
        return cls(**{**own, "stages": tuple(made)})

    def to_mapping(self) -> dict[str, Any]:
        """Return the curriculum in YAML types, each stage with all its settings."""
        own = {**vars(self), "stages": [stage.to_mapping() for stage in self.stages]}
        return {name: value for name, value in own.items() if value is not None}


def load_curriculum(path: str | os.PathLike[str]) -> Curriculum:
    """Load a curriculum from a YAML file or from its training folder.

    Relative paths refer to the folder of the YAML file.

    Raises:
        ConfigError: If the file cannot be read, or a setting is not valid.
    """
    file = Path(path, CURRICULUM_FILE) if os.path.isdir(path) else Path(path)
    mapping = {"name": file.stem, **read_yaml_mapping(file)}
    token = _folder.set(str(file.parent))
    try:
        with naming(f"'{file}'"):
            curriculum = Curriculum.from_mapping(mapping)
    finally:
        _folder.reset(token)
    return curriculum


def _with_evaluation(config: RunConfig, until: Condition) -> RunConfig:
    """Add the evaluations that a condition needs to the settings of a run."""
    plugins = config.callback
    if not any(plugin.is_a(MetricEvalCallback) for plugin in plugins):
        kind = OnsetF1Callback if OnsetF1Callback.metric in until.thresholds else F1Callback
        plugins = (*plugins, Plugin(path=f"sb3_piano.callbacks.{kind.__name__}"))
    if until.eval_freq is not None:
        plugins = with_arguments(plugins, MetricEvalCallback, eval_freq=until.eval_freq)
    default, most = parameters_of(MetricEvalCallback)["eval_freq"].default, 0
    for kwargs in (plugin.kwargs for plugin in plugins if plugin.is_a(MetricEvalCallback)):
        freq = checked("eval_freq", kwargs.get("eval_freq", default), Index)
        most += config.n_timesteps // config.n_agents // freq if freq else 0
        most += bool(kwargs.get("evaluate_start"))
    if most < until.patience:
        raise ConfigError(
            f"until {_until(until)} can never be met: in n_timesteps {config.n_timesteps} "
            f"of {config.n_agents} environment(s), or hands as agents, come {most} evaluations. "
            "Expected more steps, or a smaller eval_freq."
        )
    return dataclasses.replace(config, callback=plugins)


def _until(condition: Condition) -> dict[str, Any]:
    """Return a condition in YAML's form."""
    others = {name: v for name in _OTHERS if (v := getattr(condition, name)) is not None}
    return {**condition.thresholds, **others}


def _known_settings(algo: str) -> list[str]:
    """List the allowed names in the settings of a stage."""
    arguments = [name for name in parameters_of(algorithm_class(algo)) if name[0] != "_"]
    names = dict.fromkeys([*(f.name for f in dataclasses.fields(RunConfig)), *arguments])
    return [name for name in names if name not in (*_NOT_OF_STAGES, *_OF_STAGES)]
