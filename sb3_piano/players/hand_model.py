"""Learned network of one hand: its safetensors file, and its forward pass in NumPy."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import gymnasium as gym
import numpy as np
import numpy.typing as npt
import safetensors
import safetensors.numpy

from sb3_piano.array_files import in_order, read_shapes
from sb3_piano.arrays import Float32Array
from sb3_piano.envs import PianoEnv
from sb3_piano.envs.config import NEWEST_HANDS
from sb3_piano.envs.hand_encoding import CLIP, PRESSES_AHEAD, HandEncoding
from sb3_piano.envs.observation import ObservationLayout
from sb3_piano.exceptions import ConfigError, SB3PianoError, one_line
from sb3_piano.files import write_bytes
from sb3_piano.settings import Count, Index, Positive, settings
from sb3_piano.wrappers.hand_actions import hand_actions_of
from sb3_piano.wrappers.piano import unwrap_piano

if TYPE_CHECKING:
    from stable_baselines3.common.policies import BasePolicy


Tensors = Mapping[str, Float32Array]

SIGHT_READER = "sight-reader"
"""Name of the player with a network."""

SHIPPED = Path(__file__).with_name("sight_reader.safetensors")
"""Network in the package; ``sight_reader.md`` beside it describes its training."""

FILE_NAME = "hand.safetensors"
"""Name of a network's file in the folder of a run."""

FORMAT = "1"
"""Version of the files."""

_EXPECTED = (
    "expected a safetensors file of a hand's network, such as 'sb3-piano export' and "
    "HandModel.save write"
)


def _silu(x: Float32Array) -> Float32Array:
    half: Float32Array = np.float32(0.5) * x
    return half + half * np.tanh(half)  # x / (1 + exp(-x)), which overflows


def _relu(x: Float32Array) -> Float32Array:
    return np.maximum(x, np.float32(0.0))


_ACTIVATIONS: Mapping[str, Callable[[Float32Array], Float32Array]] = {
    "SiLU": _silu,
    "ReLU": _relu,
    "Tanh": np.tanh,
}


def network_file(path: str | os.PathLike[str]) -> Path:
    """Return the path of a network's file, given the file or its folder."""
    return Path(path, FILE_NAME) if os.path.isdir(path) else Path(path)


@settings
class HandFacts:
    """Metadata of a hand's network: its environment and its training."""

    activation: Literal["SiLU", "ReLU", "Tanh"]
    """Name in ``torch.nn`` of the activation function of the hidden layers."""
    control_timestep: Positive
    """Length of a control step, s."""
    reach: Positive
    """Reach of :class:`~sb3_piano.wrappers.HandActions`, rad."""
    blocks: Mapping[str, Count]
    """Sizes of the blocks of a hand's half of the observation "hands", by name."""
    actions: Count
    """Actuators of a hand."""
    observation_version: Count = 1
    """Version of that observation; older files lack it."""
    num_timesteps: Index = 0
    """Environment steps of its training."""
    about: Mapping[str, str] = dataclasses.field(default_factory=dict)
    """Further notes on its training, by name."""


class HandModel:
    """Learned network of one hand, which plays both hands.

    Args:
        tensors: Weights by the names of :func:`~sb3_piano.policies.hand_weights`, float32.
        facts: Metadata of the network.

    Raises:
        ConfigError: If weights and metadata do not fit together.
    """

    def __init__(self, tensors: Tensors, facts: HandFacts) -> None:
        self.tensors = {n: np.ascontiguousarray(t, dtype=np.float32) for n, t in tensors.items()}
        """Weights by name."""
        self.facts = facts
        """Metadata of the network."""
        _check_tensors(self.tensors, facts)
        t, self._activation = self.tensors, _ACTIVATIONS[facts.activation]
        self._mean, self._scale = t["standardize.mean"], t["standardize.scale"]
        self._layers = [
            _centred(*(t[f"network.hidden.{i}.{name}"] for name in _OF_LAYER))
            for i in range(_depth(t))
        ]
        self._head, self._bias = t["head.weight"], t["head.bias"][:, None]

    @classmethod
    def of(
        cls, policy: BasePolicy, env: gym.Env[Any, Any], num_timesteps: int = 0, **about: str
    ) -> HandModel:
        """Extract the network of a trained policy.

        Args:
            policy: A policy of :mod:`sb3_piano.policies` for hands, such as ``model.policy``.
            env: Environment of its training, with :class:`~sb3_piano.wrappers.HandActions`.
            num_timesteps: Environment steps of its training.
            **about: Further notes on its training, by name.

        Raises:
            ConfigError: If the policy is of another kind, or the environment has no such wrapper.
        """
        from sb3_piano.policies.hand_network import hand_weights  # imports torch

        tensors = {name: tensor.numpy() for name, tensor in hand_weights(policy).items()}
        piano = unwrap_piano(env, "HandModel.of")
        activation: Any = policy.activation_fn
        facts = HandFacts(
            activation=activation.__name__,
            reach=float(hand_actions_of(env, "HandModel.of").reach.max()),  # a finger's
            num_timesteps=num_timesteps,
            about=about,
            **_of_piano(piano, piano.config.hands_version),
        )
        return cls(tensors, facts)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> HandModel:
        """Load a network from a file, or from a folder with a ``hand.safetensors``.

        Raises:
            ConfigError: If the file is missing, or is no valid network.
        """
        path = network_file(path)
        try:
            read_shapes(path)  # refuses paths that are no files, and oversized headers
            with safetensors.safe_open(path, framework="np") as file:
                metadata = dict(file.metadata() or {})
                tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        except Exception as error:  # damaged files raise many classes of errors
            raise ConfigError(
                f"'{path}' cannot be read ({one_line(error)}): {_EXPECTED}."
            ) from error
        try:
            if metadata.pop("format", None) != FORMAT:
                raise ConfigError(f"It has no metadata of format {FORMAT}.")
            return cls(tensors, HandFacts(**{n: json.loads(t) for n, t in metadata.items()}))
        except (SB3PianoError, ValueError) as error:
            raise ConfigError(f"'{path}' cannot be used: {_EXPECTED}. {one_line(error)}") from error

    def newest(self) -> HandModel:
        """Return this network for the newest version of "hands"; it plays alike.

        Version 2 appends the notes' loudness, whose weights are 0.
        """
        facts = self.facts
        if facts.observation_version >= NEWEST_HANDS:
            return self
        more = PRESSES_AHEAD * facts.blocks["fingertips"] // 3
        added = {"standardize.mean": _MEAN_LOUDNESS, "standardize.scale": 1 / _STD_LOUDNESS}
        added |= dict.fromkeys((f"network.hidden.0.{_OF_LAYER[0]}", "head.weight"), 0.0)
        tensors = dict(self.tensors)
        for name, value in added.items():
            new = np.full((*tensors[name].shape[:-1], more), value)
            tensors[name] = np.append(tensors[name], new, axis=-1)
        blocks = {**facts.blocks, "loudness": more}
        new_facts = dataclasses.replace(facts, observation_version=NEWEST_HANDS, blocks=blocks)
        return HandModel(tensors, new_facts)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the network to a file for :meth:`load`, replacing an existing one."""
        facts = {name: json.dumps(value) for name, value in dataclasses.asdict(self.facts).items()}
        content = safetensors.numpy.save(self.tensors, {"format": FORMAT, **facts})
        write_bytes(Path(path), in_order(content))

    def predict(
        self,
        observation: npt.NDArray[np.floating],
        state: Any = None,
        episode_start: npt.NDArray[np.bool_] | None = None,
        deterministic: bool = False,
    ) -> tuple[Float32Array, Any]:
        """Return :meth:`act`, for environments with observation "hands" and ``HandActions``."""
        del episode_start, deterministic
        return self.act(observation), state

    def act(self, observation: npt.NDArray[np.floating]) -> Float32Array:
        """Compute the action of the h hands in the scene, (h k,) in [-1, 1].

        Args:
            observation: (h n,) observation "hands": the right hand's numbers, then the left's.
        """
        hands = observation.astype(np.float32, copy=False).reshape(-1, len(self._mean))
        seen = (hands - self._mean) * self._scale
        seen = np.minimum(np.maximum(seen, np.float32(-CLIP)), np.float32(CLIP)).T  # (n, h)
        hidden = seen
        for weight, bias, gain, shift in self._layers:
            hidden = weight @ hidden
            hidden += bias
            # The mean is 0 by construction, see _centred.
            variance = np.einsum("ij,ij->j", hidden, hidden) * np.float32(1 / len(hidden))
            hidden *= 1 / np.sqrt(variance + _EPSILON)
            hidden = self._activation(hidden * gain + shift)
        latent = np.concatenate([hidden, seen])
        return np.tanh(self._head @ latent + self._bias).T.reshape(-1)

    def check(self, piano: PianoEnv, name: str) -> None:
        """Check that this network can play in an environment, whose ``hands_version`` may differ.

        Args:
            piano: The environment.
            name: Name of the network in the message.

        Raises:
            ConfigError: If it was trained for another control step, action space or observation.
        """
        found = _of_piano(piano, min(self.facts.observation_version, NEWEST_HANDS))
        reduced = piano.config.reduced_action_space == (found["actions"] == self.facts.actions)
        for fact, here in found.items():
            trained = getattr(self.facts, fact)
            if trained != here:
                raise ConfigError(
                    f"{name} was trained for {_FACTS[fact]} {_shown(trained)}, and here it is "
                    f"{_shown(here)}: expected an environment such as it was trained in, with "
                    f"control_timestep={self.facts.control_timestep:g} and "
                    f"reduced_action_space={reduced}, or another network."
                )


_FACTS = {
    "observation_version": 'a version of the observation "hands" of',
    "control_timestep": "a control step, in s, of",
    "actions": "a number of actuators of a hand of",
    "blocks": "an observation of a hand of",
}
"""Metadata that must match the environment, in words for messages."""

_OF_LAYER = ("linear.weight", "linear.bias", "norm.weight", "norm.bias")
_MEAN_LOUDNESS, _STD_LOUDNESS = 0.5, 0.2  # of 127: about what music has
_EPSILON = np.float32(1e-5)  # torch.nn.LayerNorm's


def _of_piano(piano: PianoEnv, version: int) -> dict[str, Any]:
    """Return the metadata that a network for a version of "hands" needs in an environment."""
    config = dataclasses.replace(piano.config, hands_version=version)
    layout = HandEncoding(piano.scene, config).layout
    return {
        "observation_version": version,
        "control_timestep": piano.config.control_timestep,
        "actions": len(piano.scene.ctrl_low) // len(piano.scene.sides),
        "blocks": _blocks_of_hand(layout, f"{piano.scene.sides[0]}_"),
    }


def _blocks_of_hand(layout: ObservationLayout, prefix: str) -> dict[str, int]:
    return {n.removeprefix(prefix): b.size for n, b in layout.items() if n.startswith(prefix)}


def _shown(fact: Any) -> str:
    if isinstance(fact, Mapping):
        return f"{sum(fact.values())} numbers ({', '.join(f'{n} {s}' for n, s in fact.items())})"
    return f"{fact:g}"


def _depth(tensors: Tensors) -> int:
    return sum(name.endswith(_OF_LAYER[0]) for name in tensors)


def _check_tensors(tensors: Tensors, facts: HandFacts) -> None:
    """Check the names and shapes of all layers, and that their numbers are finite."""
    inputs = sum(facts.blocks.values())
    shapes: dict[str, tuple[int, ...]] = {"standardize.mean": (inputs,)}
    shapes["standardize.scale"] = (inputs,)
    before = inputs
    for i in range(_depth(tensors)):
        prefix = f"network.hidden.{i}."
        size = np.size(tensors.get(f"{prefix}linear.bias", ()))
        shapes |= {f"{prefix}{name}": (size,) for name in _OF_LAYER[1:]}
        shapes[f"{prefix}{_OF_LAYER[0]}"] = (size, before)
        before = size
    shapes["head.weight"] = (facts.actions, before + inputs)
    shapes["head.bias"] = (facts.actions,)
    if shapes.keys() != tensors.keys():
        different = ", ".join(sorted(shapes.keys() ^ tensors.keys()))
        raise ConfigError(f"The names of its weights differ from those of a network: {different}.")
    for name, shape in shapes.items():
        if tensors[name].shape != shape:
            raise ConfigError(f"{name} has the shape {tensors[name].shape}: expected {shape}.")
        if not np.isfinite(tensors[name]).all():
            raise ConfigError(f"{name} has numbers that are not finite.")


def _centred(
    weight: Float32Array, bias: Float32Array, gain: Float32Array, shift: Float32Array
) -> tuple[Float32Array, Float32Array, Float32Array, Float32Array]:
    """Centre a layer's outputs at a mean of 0, so that no forward pass subtracts it.

    LayerNorm subtracts the mean over the outputs W x + b, which is mean(W) x + mean(b).
    """
    exact, added = weight.astype(np.float64), bias.astype(np.float64)
    exact, added = exact - exact.mean(axis=0), added - added.mean()
    columns = (added.astype(np.float32)[:, None], gain[:, None], shift[:, None])
    return exact.astype(np.float32), *columns
