"""A model's weights, and the statistics of ``VecNormalize``, as plain arrays.

In a safetensors file they are the form in which a run is shared: reading one runs no code, unlike
unpickling what Stable-Baselines3 saves.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path

import safetensors
import safetensors.torch
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.vec_env import VecNormalize

from sb3_piano.exceptions import RunError, one_line
from sb3_piano.training.config import RunConfig

WEIGHTS_FILE = "policy.safetensors"
"""Name of the file in the folder of a shared run."""

Tensors = Mapping[str, torch.Tensor]

_POLICY = "policy."
_NORMALIZATION = "normalization."
_FIELDS = ("mean", "var", "count")


def pack_weights(model: BaseAlgorithm, config: RunConfig) -> bytes:
    """Return a model's weights and statistics as the content of a safetensors file.

    Args:
        model: The model; its environment has the statistics, if there are any.
        config: The run's settings.
    """
    # Copies, since safetensors refuses tensors that share memory, as shared extractors do.
    tensors = {_POLICY + n: t.detach().cpu().clone() for n, t in model.policy.state_dict().items()}
    normalizer = model.get_vec_normalize_env()
    if normalizer is not None:
        tensors.update(normalization_tensors(normalizer))
    facts = {**_labels(config), "num_timesteps": str(model.num_timesteps)}
    return safetensors.torch.save(tensors, {**facts, "sha256": _digest(tensors, facts)})


def read_weights(path: Path, config: RunConfig) -> tuple[Tensors, int]:
    """Return the tensors of a file that :func:`pack_weights` made for a run.

    Returns:
        The tensors, and the environment steps that the model was trained for.

    Raises:
        RunError: If the file is missing, damaged or of another run.
    """
    try:
        with safetensors.safe_open(path, framework="pt") as file:
            facts = dict(file.metadata() or {})
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except Exception as error:  # a damaged file fails in any way
        raise _unreadable(path, one_line(error)) from error
    if facts.pop("sha256", None) != _digest(tensors, facts):
        raise _unreadable(path, "its checksum is wrong")
    for name, value in _labels(config).items():
        if facts.get(name) != value:
            raise _unreadable(path, f"its {name} is {facts.get(name)!r}, not {value!r}")
    return tensors, int(facts["num_timesteps"])


def put_policy(tensors: Tensors, model: BaseAlgorithm) -> None:
    """Set a model's weights.

    Raises:
        ValueError: If a tensor is missing or unknown, or has another shape.
    """
    state = {n.removeprefix(_POLICY): t for n, t in tensors.items() if n.startswith(_POLICY)}
    try:
        model.policy.load_state_dict(state, strict=True)
    except RuntimeError as error:
        raise ValueError(one_line(error)) from error


def normalization_tensors(normalizer: VecNormalize) -> dict[str, torch.Tensor]:
    """Return the statistics of ``VecNormalize`` by name."""
    return {
        f"{_NORMALIZATION}{name}.{field}": torch.tensor(getattr(statistics, field)).double()
        for name, statistics in _statistics(normalizer).items()
        for field in _FIELDS
    }


def put_normalization(tensors: Tensors, normalizer: VecNormalize) -> None:
    """Set the statistics of ``VecNormalize``.

    Raises:
        ValueError: If one is missing or unknown, has another shape, or cannot be one.
    """
    found = {name: t for name, t in tensors.items() if name.startswith(_NORMALIZATION)}
    wanted = normalization_tensors(normalizer)
    if found.keys() != wanted.keys():
        raise ValueError(f"it has {', '.join(found) or 'no statistics'}, not {', '.join(wanted)}")
    for name, tensor in found.items():
        if tensor.shape != wanted[name].shape:
            raise ValueError(
                f"{name} has the shape {(*tensor.shape,)}, not {(*wanted[name].shape,)}"
            )
        least = -torch.inf if name.endswith(".mean") else 0.0
        if not (tensor.isfinite() & (tensor >= least)).all():
            raise ValueError(f"{name} has numbers that no statistics have")
    for name, statistics in _statistics(normalizer).items():
        for field in _FIELDS:
            array = found[f"{_NORMALIZATION}{name}.{field}"].numpy().copy()
            setattr(statistics, field, float(array) if field == "count" else array)


def _statistics(normalizer: VecNormalize) -> dict[str, RunningMeanStd]:
    found = {"returns": normalizer.ret_rms}
    if not normalizer.norm_obs:
        return found
    observed = normalizer.obs_rms
    if isinstance(observed, dict):
        return {**found, **{f"observations.{key}": each for key, each in observed.items()}}
    return {**found, "observations": observed}


def _labels(config: RunConfig) -> dict[str, str]:
    return {"algo": config.algo, "env_id": config.env_id}


def _digest(tensors: Tensors, facts: Mapping[str, str]) -> str:
    """Return a checksum of all that a file holds; safetensors has none of its own."""
    digest = hashlib.sha256(json.dumps(facts, sort_keys=True).encode())
    for name in sorted(tensors):
        tensor = tensors[name].contiguous()
        digest.update(f"{name} {tensor.dtype} {(*tensor.shape,)}".encode())
        digest.update(tensor.reshape(-1).view(torch.uint8).numpy().tobytes())
    return digest.hexdigest()


def _unreadable(path: Path, reason: str) -> RunError:
    return RunError(
        f"Weights '{path}' cannot be loaded ({reason}): expected the file that 'sb3-piano share' "
        "wrote for this run."
    )
