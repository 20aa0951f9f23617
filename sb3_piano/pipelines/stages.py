"""Settings of a curriculum: stages that are trained one after the other, and their YAML file."""

from __future__ import annotations

import dataclasses
import inspect
import os
import re
from collections.abc import Mapping
from dataclasses import field
from pathlib import Path
from typing import Annotated, Any, Self

from annotated_types import MinLen
from pydantic import BeforeValidator
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

from sb3_piano.callbacks import Condition, F1Callback, MetricEvalCallback, OnsetF1Callback
from sb3_piano.envs import GENERAL_ID
from sb3_piano.exceptions import ConfigError
from sb3_piano.hyperparams import NAMED
from sb3_piano.metrics import EPISODE_METRICS
from sb3_piano.music import is_path
from sb3_piano.settings import (
    Index,
    Listed,
    Share,
    TextOrPath,
    checked,
    refuse_unknown,
    settings,
)
from sb3_piano.training.configuration.config import RunConfig
from sb3_piano.training.configuration.env_spec import FILE_OPTIONS
from sb3_piano.training.configuration.names import algorithm_class
from sb3_piano.training.configuration.plugins import Plugin, with_arguments
from sb3_piano.training.configuration.values import (
    coerce_mapping,
    parameters_of,
    plain,
)
from sb3_piano.training.configuration.yaml_files import load_config, merged, read_yaml_mapping
from sb3_piano.training.runs.start import without_learnt_entropy

CURRICULUM_FILE = "curriculum.yml"
"""Name of the settings in a curriculum's folder."""

CONDITIONS = tuple(
    name
    for name in EPISODE_METRICS
    if name.endswith(("f1", "precision", "recall", "agreement", "return")) and name != "noop_f1"
)
"""Metrics that may end a stage: those of which more is better, up to 1."""

_EXAMPLE = "{piece: hanon-01}"
_PLAYED = ("piece", "pieces", "env")
_OTHERS = ("eval_freq", "patience")
# What a stage's run has from elsewhere, or sets itself.
_NOT_OF_STAGES = {"algo", "env_id", "env_module", "algorithm_kwargs", "seed"}
_NOT_OF_STAGES |= {"action_noise", "tensorboard_log"}

_OneOrSeveral = BeforeValidator(lambda value: (value,) if isinstance(value, str) else value or ())
_Plain = BeforeValidator(lambda value: plain(value, "settings"))


@settings
class Stage:
    """A stage: what is played, with which settings, and when it ends.

    Raises:
        ConfigError: If not exactly one of ``piece``, ``pieces`` and ``env`` is given.
    """

    piece: TextOrPath | None = None
    """A piece's name or file, which ``RoboPianist-v0`` plays."""
    pieces: Annotated[tuple[str, ...], Listed, _OneOrSeveral] = ()
    """Several in its place: entries of :func:`~sb3_piano.music.select_pieces`."""
    env: str | None = None
    """The id of an environment in their place; ``module:Id`` imports the module."""
    name: str | None = None
    """Name of the stage in the name of its folder; by default that of what is played."""
    config: TextOrPath | None = None
    """Hyperparameters, as ``path`` of :func:`~sb3_piano.training.load_config`."""
    until: Condition | None = None
    """Condition that ends the stage before its ``n_timesteps``."""
    with_buffer: bool = False
    """Whether to begin with the replay buffer of what it starts from."""
    with_entropy: bool = True
    """Whether to begin with its entropy coefficient; without, one that is learnt begins anew."""
    settings: Annotated[Mapping[str, Any], _Plain] = field(default_factory=dict)
    """Settings of its run in place of those of the hyperparameters, by their names in YAML;
    ``env_kwargs`` are added to them."""

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
        """Name of the stage, in characters that suit a folder."""
        several = self.pieces[0] if len(self.pieces) == 1 else f"{len(self.pieces)}-pieces"
        played = Path(self.piece).stem if self.piece and is_path(self.piece) else self.piece
        return re.sub(r"[^\w.-]+", "-", self.name or played or self.env or several)

    def to_mapping(self) -> dict[str, Any]:
        """Return the stage as YAML has it."""
        fields = [f for f in dataclasses.fields(self) if f.name not in ("until", "settings")]
        own = {f.name: getattr(self, f.name) for f in fields}
        mapping = {f.name: own[f.name] for f in fields if own[f.name] != f.default}
        if self.pieces:
            mapping["pieces"] = list(self.pieces)
        until = {} if self.until is None else {"until": _until(self.until)}
        return {**mapping, **self.settings, **until}

    def run_config(self, algo: str) -> RunConfig:
        """Return the settings of its run, without seed and start.

        Raises:
            ConfigError: If one is not valid.
        """
        own = {} if self.piece is None else {"env_kwargs": {"score": self.piece}}
        overrides = merged(self.settings, own)
        if self.pieces:
            overrides["pieces"] = self.pieces
        config = load_config(algo, self.env or GENERAL_ID, self.config, **overrides)
        if not (self.with_entropy or config.learns_entropy):
            raise without_learnt_entropy(config.algorithm)
        return config if self.until is None else _with_evaluation(config, self.until)


@settings
class Curriculum:
    """A curriculum: stages, each of which starts from what the one before has learnt.

    Raises:
        ConfigError: If a setting is unknown, has the wrong type or is out of range.
    """

    algo: str
    """Name of the algorithm, one of :data:`~sb3_piano.training.ALGORITHMS`."""
    stages: Annotated[tuple[Stage, ...], MinLen(1)]
    """The stages in their order."""
    name: str = "curriculum"
    """Name of its folder."""
    init_from: TextOrPath | None = None
    """Folder of a run from which the first stage starts; by default from nothing."""
    seed: Index | None = None
    """Seed of each stage; ``None`` lets one be drawn and noted down."""

    def __post_init__(self) -> None:
        known = _known_settings(self.algo)
        for number, stage in enumerate(self.stages, start=1):
            refuse_unknown(stage.settings, known, "setting", f"stage {number}")
        if self.stages[0].with_buffer and self.init_from is None:
            raise ConfigError(
                "with_buffer is true of stage 1, which starts from nothing: expected init_from, "
                "too, or no with_buffer."
            )
        algorithm = algorithm_class(self.algo)
        asking = [n for n, stage in enumerate(self.stages, start=1) if stage.with_buffer]
        if asking and not issubclass(algorithm, OffPolicyAlgorithm):
            raise ConfigError(
                f"with_buffer is true of stage {asking[0]}, but {algorithm.__name__} has no replay "
                "buffer: expected an off-policy algorithm, or no with_buffer."
            )

    @property
    def run_names(self) -> tuple[str, ...]:
        """Names of the stages' folders, such as ``1_hanon-01``."""
        return tuple(f"{n}_{stage.label}" for n, stage in enumerate(self.stages, start=1))

    @classmethod
    def from_mapping(cls, mapping: Mapping[Any, Any], folder: Path | None = None) -> Self:
        """Return the curriculum that YAML has: settings that hold for all stages, and the stages.

        Args:
            mapping: Fields of this class; the keys of :class:`Stage` that hold for all stages, its
                ``settings`` one by one; and ``stages``, a list of mappings of such keys.
            folder: Where the paths of files begin; by default as the process has it.

        Raises:
            ConfigError: If a setting is unknown, has the wrong type or is out of range.
        """
        names = {f.name for f in dataclasses.fields(cls)}
        own = {name: value for name, value in mapping.items() if name in names}
        common = {name: value for name, value in mapping.items() if name not in names}
        stages = own.get("stages")
        if not isinstance(stages, list) or not stages:
            raise ConfigError(f"stages is {stages!r}: expected a list of stages, as [{_EXAMPLE}].")
        if "algo" not in own:
            raise ConfigError("algo is missing: expected the name of an algorithm, such as sac.")
        if own.get("init_from") is not None and folder is not None:
            own["init_from"] = _located(own["init_from"], folder)
        known = [*sorted(_fields_of_stages()), *_known_settings(own["algo"])]
        refuse_unknown(common, [*sorted(names), *known], "key", "a curriculum")
        made = []
        for number, entry in enumerate(stages, start=1):
            try:
                if not isinstance(entry, Mapping):
                    raise ConfigError(f"It is {entry!r}: expected a mapping, as {_EXAMPLE}.")
                refuse_unknown(entry, known, "key", "a stage")
                made.append(_stage(_merged(common, entry), folder))
            except ConfigError as error:
                raise ConfigError(f"Stage {number}: {error}") from error
        return cls(**{**own, "stages": tuple(made)})

    def to_mapping(self) -> dict[str, Any]:
        """Return the curriculum in YAML's types, each stage with all its settings."""
        own = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        del own["stages"]
        stages = [stage.to_mapping() for stage in self.stages]
        return {**{n: v for n, v in own.items() if v is not None}, "stages": stages}


def load_curriculum(path: str | os.PathLike[str]) -> Curriculum:
    """Return the curriculum that a YAML file holds, or that is trained in a folder.

    Paths of files that are not absolute begin at the folder of the YAML file.

    Raises:
        ConfigError: If the file cannot be read, or a setting is unknown, has the wrong type or is
            out of range.
    """
    place = Path(path)
    file = place / CURRICULUM_FILE if os.path.isdir(place) else place
    try:
        mapping = {"name": file.stem, **read_yaml_mapping(file)}
        return Curriculum.from_mapping(mapping, file.parent.absolute())
    except ConfigError as error:
        text = str(error)
        raise ConfigError(text if text.startswith(f"'{file}'") else f"'{file}': {text}") from error


def _condition(value: Any) -> Condition:
    """Return the condition that ``until`` has in YAML: ``{onset_f1: 0.8, patience: 2}``."""
    entries = coerce_mapping(value, "until")
    refuse_unknown(entries, (*CONDITIONS, *_OTHERS), "key", "until")
    others = {name: entries.pop(name) for name in _OTHERS if name in entries}
    least = {name: checked(f"until.{name}", value, Share) for name, value in entries.items()}
    return Condition(thresholds=least, **others)


def _with_evaluation(config: RunConfig, until: Condition) -> RunConfig:
    """Return the settings of a run with the evaluations that a condition goes by.

    Raises:
        ConfigError: If so few are made that it can never be met.
    """
    plugins = config.callback
    if not any(plugin.is_a(MetricEvalCallback) for plugin in plugins):
        kind = OnsetF1Callback if OnsetF1Callback.metric in until.thresholds else F1Callback
        plugins = (*plugins, Plugin(path=f"sb3_piano.callbacks.{kind.__name__}"))
    if until.eval_freq is not None:
        plugins = with_arguments(plugins, MetricEvalCallback, eval_freq=until.eval_freq)
    judges = [plugin for plugin in plugins if plugin.is_a(MetricEvalCallback)]
    most = sum(_evaluations(plugin, config) for plugin in judges)
    if most < until.patience:
        raise ConfigError(
            f"until {_until(until)} can never be met: in n_timesteps {config.n_timesteps} of "
            f"{config.n_agents} environment(s), or hands as agents, come {most} evaluations. "
            "Expected more steps, or a smaller eval_freq."
        )
    return dataclasses.replace(config, callback=plugins)


def _evaluations(plugin: Plugin, config: RunConfig) -> int:
    """Return how often a callback evaluates at most: every so many calls, and at the start."""
    default = inspect.signature(MetricEvalCallback).parameters["eval_freq"].default
    freq = checked("eval_freq", plugin.kwargs.get("eval_freq", default), Index)
    several = config.n_timesteps // config.n_agents // freq if freq else 0
    return int(several) + bool(plugin.kwargs.get("evaluate_start"))


def _until(condition: Condition) -> dict[str, Any]:
    """Return a condition as YAML has it."""
    others = {name: getattr(condition, name) for name in _OTHERS}
    return {**condition.thresholds, **{n: v for n, v in others.items() if v is not None}}


def _fields_of_stages() -> set[str]:
    return {f.name for f in dataclasses.fields(Stage)} - {"settings"}


def _known_settings(algo: str) -> list[str]:
    """Return the names that settings of a stage may have."""
    arguments = [name for name in parameters_of(algorithm_class(algo)) if name[0] != "_"]
    names = [f.name for f in dataclasses.fields(RunConfig)] + arguments
    unfit = _NOT_OF_STAGES | _fields_of_stages()
    return [name for name in dict.fromkeys(names) if name not in unfit]


def _merged(common: Mapping[str, Any], stage: Mapping[str, Any]) -> dict[str, Any]:
    """Return a stage's keys with those that hold for all stages."""
    if any(name in stage for name in _PLAYED):
        common = {name: value for name, value in common.items() if name not in _PLAYED}
    return merged(common, stage)


def _stage(keys: dict[str, Any], folder: Path | None) -> Stage:
    """Return the stage of some keys, with absolute paths if a folder is given."""
    own = {name: keys.pop(name) for name in _fields_of_stages() if name in keys}
    if own.get("until") is not None:
        own["until"] = _condition(own["until"])
    stage = Stage(**own, settings=keys)
    if folder is None:
        return stage
    changed: dict[str, Any] = {}
    if stage.piece is not None and is_path(stage.piece):
        changed["piece"] = _located(stage.piece, folder)
    if stage.config is not None and stage.config not in NAMED:
        changed["config"] = _located(stage.config, folder)
    if stage.pieces:
        entries = stage.pieces
        changed["pieces"] = tuple(_located(t, folder) if is_path(t) else t for t in entries)
    if "env_kwargs" in stage.settings:
        options = coerce_mapping(stage.settings["env_kwargs"], "env_kwargs")
        for name in FILE_OPTIONS:
            text = options.get(name)
            if isinstance(text, str) and os.path.isfile(folder / text):
                options[name] = _located(text, folder)
        changed["settings"] = {**stage.settings, "env_kwargs": options}
    return dataclasses.replace(stage, **changed)


def _located(text: Any, folder: Path) -> str:
    """Return a path that begins at a folder as an absolute one."""
    return os.path.abspath(folder / os.path.expanduser(text))
