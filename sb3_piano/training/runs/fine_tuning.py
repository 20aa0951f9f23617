"""Settings for fine-tuning: training corrections to a base player."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sb3_piano.envs.actions import REACH
from sb3_piano.exceptions import ConfigError
from sb3_piano.hyperparams import FINE_TUNING
from sb3_piano.imports import import_name
from sb3_piano.players import HandModel, PlayerResidual
from sb3_piano.players.hand_model import FILE_NAME, SHIPPED, SIGHT_READER
from sb3_piano.players.residual import CORRECTED
from sb3_piano.settings import Positive, checked, refuse_unknown
from sb3_piano.training.configuration.config import RunConfig
from sb3_piano.training.configuration.env_spec import EnvSpec
from sb3_piano.training.configuration.names import registered_id
from sb3_piano.training.configuration.plugins import Plugin
from sb3_piano.training.configuration.yaml_files import load_config, overlaid
from sb3_piano.training.runs.folder import RunFolder
from sb3_piano.wrappers.residual import Residual

_RESIDUAL = "sb3_piano.training.RunResidual"


def load_fine_tuning(
    algo: str,
    env_id: str | None = None,
    path: str | os.PathLike[str] | None = None,
    *,
    player: str | os.PathLike[str] = SIGHT_READER,
    **overrides: Any,
) -> RunConfig:
    """Load the hyperparameters for training corrections to a base player.

    Args:
        algo: Name of the algorithm.
        env_id: Id of the environment, or ``module:Id``; by default the environment of a corrected
            run.
        path: A YAML file as in :func:`load_config` with changes to the preset.
        player: One of :data:`~sb3_piano.players.CORRECTED`, by default this package's sight-reader;
            the file of another network, or a folder with a ``hand.safetensors``; or the folder of a
            run. A run's environment and wrappers are kept, except for the preset's physics, and
            for its piece if another environment is named.
        **overrides: Keys that replace the entry's. ``env_kwargs`` are added to the entry's.

    Raises:
        ConfigError: As in :func:`load_config`; or if there is no preset for the algorithm, no such
            network, the entry has wrappers without :class:`~sb3_piano.players.PlayerResidual`, or
            no environment is given.
        RunError: If the folder is no run.
    """
    refuse_unknown([algo], FINE_TUNING, "algorithm for fine-tuning")
    folder = Path(player)
    of_run = os.path.isdir(folder) and not os.path.isfile(folder / FILE_NAME)
    base = RunFolder.open(folder).read_config() if of_run else None
    if env_id is None and base is None:
        raise ConfigError(
            f"Nothing to play with '{player}': expected the id of an environment (--env) or a "
            "piece (--midi); only a corrected run has its own."
        )
    played = base.env.full_id if base is not None and env_id is None else str(env_id)
    settings = overrides if path is None else overlaid(path, played, overrides)
    config = load_config(algo, played, FINE_TUNING[algo], **settings)
    if base is not None:
        given = overrides.get("env_kwargs", {})
        another = registered_id(played)[1] != base.env_id
        others = another or "score" in given or bool(config.pieces)
        return _of_run(config, base.env, folder, given, others)
    if player != SIGHT_READER and player in CORRECTED:
        return config.with_env(config.env.correcting(player=player))
    network = os.fspath(SHIPPED if player == SIGHT_READER else player)
    HandModel.load(network)  # raise its errors before processes are started
    return config.with_env(config.env.correcting(model=network))


def _of_run(
    config: RunConfig, base: EnvSpec, folder: Path, given: dict[str, Any], others: bool
) -> RunConfig:
    """Return the settings with a run's environment and its model as the base player.

    ``given`` options override the run's; ``others`` is whether other pieces are played.
    """
    kinds = [import_name(plugin.path) for plugin in config.env_wrapper]
    at = next((n for n, kind in enumerate(kinds) if issubclass(kind, Residual)), len(kinds))
    scale = {} if at == len(kinds) else _scale(kinds[at], config.env_wrapper[at].kwargs)
    residual = Plugin(path=_RESIDUAL, kwargs={"run": str(folder), **scale})
    outside = config.env_wrapper[at + 1 :]
    own = base.for_others() if others else base
    physics = {name: value for name, value in config.env_kwargs.items() if name == "physics"}
    options = {**own.options, **physics, **given}
    corrected = dataclasses.replace(
        config,
        env_kwargs=options,
        pieces=config.pieces if others else base.pieces,
        env_wrapper=(*own.wrappers, residual, *outside),
    )
    if options.get("observation") == "hands" and not options.get("observation_blocks"):
        return corrected
    # Other observations have no halves by hand: one network corrects both hands.
    arguments = config.algorithm_kwargs
    policy = {**arguments.get("policy_kwargs", {}), "n_hands": 1}
    alone = {**arguments, "policy_kwargs": policy}
    return dataclasses.replace(corrected, vec_env_wrapper=(), algorithm_kwargs=alone)


def _scale(corrects: type, arguments: Mapping[str, Any]) -> dict[str, float]:
    """Return the range of a wrapper's corrections as an argument of RunResidual."""
    if "scale" not in arguments:
        return {}
    scale = checked("scale", arguments["scale"], Positive)
    return {"scale": scale * REACH if corrects is PlayerResidual else scale}
