"""Load and save models: SB3's own files, or weights as plain arrays.

An exported run has its weights in a safetensors file. Reading it runs no code, unlike unpickling
files of Stable-Baselines3.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import pickle
import shlex
import warnings
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import safetensors
import safetensors.torch
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.vec_env import VecEnv, VecNormalize
from torch.utils._python_dispatch import TorchDispatchMode

from sb3_piano.array_files import in_order, read_shapes
from sb3_piano.callbacks.checkpoint import SAVED_AFTER, Checkpoint
from sb3_piano.exceptions import RunError, one_line
from sb3_piano.files import check_file
from sb3_piano.players.rollout import Player
from sb3_piano.settings import Index, checked
from sb3_piano.training.configuration.config import RunConfig
from sb3_piano.training.runs.builders import build_model
from sb3_piano.training.runs.folder import RunFolder

Tensors = Mapping[str, torch.Tensor]

_POLICY = "policy."
_NORMALIZATION = "normalization."
_FIELDS = ("mean", "var", "count")


def model_files(
    run: RunFolder, config: RunConfig, best: str | None = None
) -> tuple[Path, Path | None]:
    """Return the file of a model, and the file of ``VecNormalize`` if the run normalises.

    Both are of one checkpoint: if a killed process left only one of them replaced, the files in
    ``checkpoint/`` are returned. They are a zip file and a pickle, or an exported run's weights.

    ``best`` is the metric of the best model; by default it is the newest model.
    """
    normalizes = config.normalize is not False
    if run.weights_file.is_file():  # then no other file of the folder is unpickled
        if best is not None:
            raise RunError(
                f"Run '{run.path}' was exported with one model, and has no best one by {best!r}: "
                "expected no metric."
            )
        return run.weights_file, run.weights_file if normalizes else None
    model, folder = run.model_file, run.path
    if best is not None:
        folder = run.best_dir(best)
        model = folder / "best_model.zip"
    statistics = folder / run.statistics_file.name
    if model.is_file() and not normalizes:
        return model, None
    is_pair = model.is_file() and statistics.is_file()
    if is_pair and _are_of_one_checkpoint(model, statistics):
        return model, statistics
    saved = None if best is not None else Checkpoint.read(run.checkpoint_dir)
    if is_pair and saved is None:
        raise RunError(
            f"'{model}' and '{statistics.name}' beside it were saved after different numbers of "
            "steps, as after a killed process: expected files of one checkpoint. Resuming the "
            "training writes both again."
        )
    if best is not None:
        known = run.best_metrics()
        have = f"it has one by {' and by '.join(known)}" if known else "it has none by any metric"
        raise RunError(
            f"Run '{run.path}' has no best model by {best!r}, {have}: expected a training with "
            "sb3_piano.callbacks.F1Callback or OnsetF1Callback in its config, past its first "
            "evaluation."
        )
    if saved is None:
        raise RunError(
            f"Run '{run.path}' has no model: expected {run.model_file.name}"
            f"{f' and {run.statistics_file.name}' if normalizes else ''}, written with the first "
            "checkpoint. To resume it: sb3-piano train --resume "
            f"{shlex.quote(str(run.path))}"
        )
    pickled = saved.vec_normalize
    place = run.checkpoint_dir
    return place / saved.model, None if pickled is None else place / pickled


_PACKED_TIMES = 16
"""Largest ratio of a model's unpacked size to its file: SB3 does not compress."""


def _check_archive(path: Path) -> None:
    """Raise ValueError for an archive that unpacks to far more than its size."""
    check_file(path)
    size, small = path.stat().st_size, (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
    with zipfile.ZipFile(path) as archive:
        members = archive.infolist()
    whole = sum(member.file_size for member in members)
    if whole > 2**20 + _PACKED_TIMES * size or {m.compress_type for m in members} - set(small):
        raise ValueError(f"it unpacks to {whole} bytes, and has {size}")


class _Bounded(TorchDispatchMode):
    """Torch mode that limits how many numbers a model may allocate, whatever its settings."""

    _MAKES = tuple(getattr(torch.ops.aten, n) for n in ("empty", "new_empty", "zeros", "ones"))

    def __init__(self, numbers: int) -> None:
        super().__init__()
        self._left = numbers

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        del types
        if func.overloadpacket in self._MAKES:
            shape = args[1 if func.overloadpacket is torch.ops.aten.new_empty else 0]
            self._left -= math.prod(shape) + 64  # the cost of an object itself
            if self._left < 0:
                raise ValueError(
                    "it would have more numbers than its file of weights: expected the settings "
                    "that belong to them"
                )
        return func(*args, **(kwargs or {}))


def _are_of_one_checkpoint(model: Path, statistics: Path) -> bool:
    """Return whether a model and statistics were saved together, as far as known."""
    try:
        _check_archive(model)
        with zipfile.ZipFile(model) as archive, statistics.open("rb") as file:
            saved_after = vars(pickle.load(file)).get(SAVED_AFTER)
            return saved_after in (None, json.loads(archive.read("data"))["num_timesteps"])
    except Exception:  # damaged files fail in any way; loading them raises the error
        return True


def load_model(config: RunConfig, path: Path, venv: VecEnv, **changes: Any) -> BaseAlgorithm:
    """Load a saved model on the given environments; ``changes`` set attributes of it.

    Its zip file is unpickled, as all of SB3's are: load only files you trust.
    """
    device = config.algorithm_kwargs.get("device", "auto")
    try:
        _check_archive(path)
        return config.algorithm.load(path, env=venv, device=device, **changes)
    except Exception as error:  # unpickling fails in any way
        raise RunError(
            f"Model '{path}' cannot be loaded ({one_line(error)}): expected a model that "
            f"{config.algorithm.__name__} saved for {config.env_id!r}."
        ) from error


def load_to_play(config: RunConfig, path: Path, venv: VecEnv) -> BaseAlgorithm:
    """Load a run's model from :func:`model_files`, without state that only training needs."""
    # A replay buffer would be as large as in training.
    off_policy = issubclass(config.algorithm, OffPolicyAlgorithm)
    if path.suffix != ".safetensors":
        return load_model(config, path, venv, **({"buffer_size": 1} if off_policy else {}))
    tensors, num_timesteps = read_weights(path, config)
    small = {"buffer_size": 2 * venv.num_envs} if off_policy else {"n_steps": 2}  # two rows
    arguments = {**config.algorithm_kwargs, **small}
    with warnings.catch_warnings():  # SB3 warns that so few steps are no batch
        warnings.simplefilter("ignore", UserWarning)
        # Initialisation allocates each tensor a second time.
        with _Bounded(2**20 + 4 * sum(tensor.numel() for tensor in tensors.values())):
            model = build_model(dataclasses.replace(config, algorithm_kwargs=arguments), venv)
    state = {n.removeprefix(_POLICY): t for n, t in tensors.items() if n.startswith(_POLICY)}
    try:
        model.policy.load_state_dict(state, strict=True)
    except RuntimeError as error:
        raise RunError(
            f"Weights '{path}' do not fit ({one_line(error)}): expected those of the model that "
            "the run's config describes."
        ) from error
    model.num_timesteps = num_timesteps
    return model


def predict_single(
    model: Player, venv: VecEnv, observation: Any, *arguments: Any
) -> tuple[Any, Any]:
    """Call ``predict`` for one environment, without a batch dimension.

    ``venv`` is the vector of that environment; where hands are agents, each observes its half.
    ``arguments`` are the other arguments of ``predict``.
    """
    agents = venv.num_envs
    seen = observation.reshape(agents, -1) if agents > 1 else observation
    if isinstance(venv, VecNormalize):
        seen = venv.normalize_obs(seen)
    action, state = model.predict(seen, *arguments)
    return (action.reshape(-1) if agents > 1 else action), state


def load_statistics(config: RunConfig, path: Path | None, venv: VecEnv) -> None:
    """Load the statistics of ``VecNormalize`` from :func:`model_files`, if there are any."""
    if path is None or not isinstance(venv, VecNormalize):
        return
    if path.suffix == ".safetensors":
        tensors = read_weights(path, config)[0]
    try:
        if path.suffix != ".safetensors":
            check_file(path)
            with path.open("rb") as file:
                tensors = dict(_normalization_tensors(pickle.load(file)))
        _put_normalization(tensors, venv)
    except Exception as error:  # unpickling fails in any way
        raise RunError(
            f"Statistics '{path}' cannot be loaded ({one_line(error)}): expected those of "
            f"VecNormalize for {config.env_id!r}."
        ) from error


def pack_weights(model: BaseAlgorithm, config: RunConfig) -> bytes:
    """Serialise a model's weights and its environment's statistics to safetensors."""
    # Copies, since safetensors refuses tensors that share memory, as shared extractors do.
    tensors = {_POLICY + n: t.detach().cpu().clone() for n, t in model.policy.state_dict().items()}
    normalizer = model.get_vec_normalize_env()
    if normalizer is not None:
        tensors.update(_normalization_tensors(normalizer))
    facts = {**config.labels, "num_timesteps": str(model.num_timesteps)}
    content = safetensors.torch.save(tensors, {**facts, "sha256": _digest(tensors, facts)})
    return in_order(content)


def read_weights(path: Path, config: RunConfig) -> tuple[Tensors, int]:
    """Read the tensors of a file of :func:`pack_weights`, and the steps of training."""
    try:
        read_shapes(path)  # refuses what is no file, and endless headers
        with safetensors.safe_open(path, framework="pt") as file:
            facts = dict(file.metadata() or {})
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        if facts.pop("sha256", None) != _digest(tensors, facts):
            raise ValueError("its checksum is wrong")
        steps = checked("num_timesteps", int(facts["num_timesteps"]), Index)
        for name, value in config.labels.items():
            if facts.get(name) != value:
                raise ValueError(f"its {name} is {facts.get(name)!r}, not {value!r}")
    except Exception as error:  # a damaged file fails in any way
        raise RunError(
            f"Weights '{path}' cannot be loaded ({one_line(error)}): expected the file that "
            "'sb3-piano export' wrote for this run."
        ) from error
    return tensors, steps


def _digest(tensors: Tensors, facts: Mapping[str, str]) -> str:
    """Return a checksum of all tensors and facts; safetensors has none of its own."""
    digest = hashlib.sha256(json.dumps(facts, sort_keys=True).encode())
    for name in sorted(tensors):
        tensor = tensors[name].contiguous()
        digest.update(f"{name} {tensor.dtype} {(*tensor.shape,)}".encode())
        digest.update(tensor.reshape(-1).view(torch.uint8).numpy().tobytes())
    return digest.hexdigest()


def _statistics(normalizer: VecNormalize) -> Iterator[tuple[str, RunningMeanStd, str]]:
    """Yield each statistic of ``VecNormalize``: its name, its owner and its attribute."""
    observed = normalizer.obs_rms if normalizer.norm_obs else {}
    several = observed if isinstance(observed, dict) else {}
    found = {"returns": normalizer.ret_rms, **{f"observations.{k}": v for k, v in several.items()}}
    if not isinstance(observed, dict):
        found["observations"] = observed
    for name, statistics in found.items():
        for field in _FIELDS:
            yield f"{_NORMALIZATION}{name}.{field}", statistics, field


def _normalization_tensors(normalizer: VecNormalize) -> Iterator[tuple[str, torch.Tensor]]:
    for name, owner, field in _statistics(normalizer):
        yield name, torch.tensor(getattr(owner, field)).double()


def _put_normalization(tensors: Tensors, normalizer: VecNormalize) -> None:
    """Set the statistics of ``VecNormalize`` from tensors."""
    found = {name: t for name, t in tensors.items() if name.startswith(_NORMALIZATION)}
    wanted = dict(_normalization_tensors(normalizer))
    if found.keys() != wanted.keys():
        raise ValueError(f"it has {', '.join(found) or 'no statistics'}, not {', '.join(wanted)}")
    for name, tensor in found.items():
        shapes = tuple(tensor.shape), tuple(wanted[name].shape)
        if shapes[0] != shapes[1]:
            raise ValueError(f"{name} has the shape {shapes[0]}, not {shapes[1]}")
        least = -torch.inf if name.endswith(".mean") else 0.0
        if not (tensor.isfinite() & (tensor >= least)).all():
            raise ValueError(f"{name} has numbers that no statistics have")
    for name, owner, field in _statistics(normalizer):
        array = found[name].numpy().copy()
        setattr(owner, field, float(array) if field == "count" else array)
