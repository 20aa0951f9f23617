"""The settings of a piano environment."""

from __future__ import annotations

import dataclasses
import math
import os
import reprlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from numbers import Integral, Real
from typing import Any

from sb3_piano.envs.rewards import DEFAULT_REWARD_WEIGHTS
from sb3_piano.exceptions import ConfigError, near_names
from sb3_piano.simulation import physics_profile

OBSERVATIONS = ("roll", "window", "fingers")
"""Ways to observe goal and state."""

MAX_LOOKAHEAD = 10_000
"""The most control steps after the current one that an observation may show."""

MAX_REWARD_WEIGHT = 1e6
"""The largest weight of a term of the reward."""

FINGERING_REWARDS = ("auto", "labels", "optimal-transport", "off")
"""Measures of the fingering term of the reward."""


@dataclass(frozen=True, kw_only=True)
class PianoEnvConfig:
    """Settings of a :class:`~sb3_piano.envs.PianoEnv`, besides the score.

    The defaults are those with which RoboPianist's authors train.

    Raises:
        ConfigError: If a value has the wrong type or is out of range.
    """

    fingering: str = "keep"
    """Which finger labels the score gets: "keep" leaves it as it is; "ergonomic" chooses fingers
    for the notes without; "optimal-transport" takes all labels away, so that any finger may play;
    or the path of a file whose labels are put on the environment's own score (not on another one
    that ``reset`` names)."""
    n_steps_lookahead: int = 10
    """Control steps after the current one that the goal shows; 0 to 10,000."""
    observation: str = "roll"
    """"roll" is RoboPianist's observation; "window" is the same for the keys of the piece and three
    beside them; "fingers" has for each finger where and when it must press next."""
    control_timestep: float = 0.05
    """Length of a control step, s; a whole number of physics steps."""
    initial_buffer_time: float = 0.0
    """Silence put before the score, s, in which the hands can take their place."""
    trim_silence: bool = True
    """Start the score at its first note."""
    reduced_action_space: bool = True
    """Leave out the joints LFJ5, THJ5 and THJ1 of both hands: 39 actions instead of 45."""
    gravity_compensation: bool = True
    """Let forces balance the weight of the hands."""
    physics: str = "reference"
    """Name of a physics profile: "reference" (RoboPianist's) or "fast"."""
    fingering_reward: str = "auto"
    """"labels" rewards labelled fingers at their keys; "optimal-transport" any finger near a due
    key (RP1M); "auto" takes labels if the score has any, else optimal transport; "off" is 0."""
    forearm_reward: bool = True
    """Reward forearms that do not touch; otherwise the term is 0."""
    reward_weights: Mapping[str, float] = field(default_factory=dict)
    """Weights of reward terms by name, in place of the default ones."""
    wrong_press_termination: bool = False
    """End the episode when a key sounds that is not due."""
    randomize_hand_positions: bool = False
    """Start each episode with both hands moved along the keyboard by up to 5 cm."""
    width: int = 640
    """Width of a rendered picture, pixels; at most 1920."""
    height: int = 360
    """Height of a rendered picture, pixels; at most 1080."""
    camera_name: str = "overview"
    """Camera of the rendered picture: "overview" or "topdown"."""

    @classmethod
    def from_options(cls, options: Mapping[str, Any]) -> PianoEnvConfig:
        """Return the config with the given settings, refusing unknown ones by name."""
        known = [f.name for f in dataclasses.fields(cls)]
        for name in options:
            if name not in known:
                raise ConfigError(
                    f"Unknown option {name!r} of the piano environment."
                    f"{near_names(name, known)} Known options: {', '.join(sorted(known))}."
                )
        return cls(**options)

    def __post_init__(self) -> None:
        self._check_types()
        check_lookahead("n_steps_lookahead", self.n_steps_lookahead)
        _require(
            self.initial_buffer_time >= 0, "initial_buffer_time", self.initial_buffer_time, ">= 0 s"
        )
        _require(0 < self.width <= 1920, "width", self.width, "1 to 1920 pixels")
        _require(0 < self.height <= 1080, "height", self.height, "1 to 1080 pixels")
        _one_of("observation", self.observation, OBSERVATIONS)
        _one_of("fingering_reward", self.fingering_reward, FINGERING_REWARDS)
        _one_of("camera_name", self.camera_name, ("overview", "topdown"))
        given = self.reward_weights
        for name in given:
            _one_of("reward_weights", name, tuple(DEFAULT_REWARD_WEIGHTS))
        weights = {k: reward_weight(f"reward_weights[{k!r}]", v) for k, v in given.items()}
        object.__setattr__(self, "reward_weights", {**DEFAULT_REWARD_WEIGHTS, **weights})
        self.n_substeps  # noqa: B018  raises if the timesteps do not fit

    @property
    def n_substeps(self) -> int:
        """Physics steps in a control step."""
        timestep = physics_profile(self.physics).solver.timestep
        count = round(self.control_timestep / timestep)
        if count < 1 or not math.isclose(count * timestep, self.control_timestep, rel_tol=1e-9):
            raise ConfigError(
                f"control_timestep {self.control_timestep} s is not a whole number of physics "
                f"steps: expected a multiple of {timestep} s (physics profile {self.physics!r})."
            )
        return count

    def _check_types(self) -> None:
        object.__setattr__(self, "fingering", _text_or_path("fingering", self.fingering))
        for option in dataclasses.fields(self):
            value = getattr(self, option.name)
            expected = str(option.type)
            if expected == "float":
                object.__setattr__(self, option.name, finite_number(option.name, value))
            elif expected == "bool" and not isinstance(value, bool):
                raise ConfigError(f"{option.name} is {value!r}: expected true or false.")
            elif expected == "int" and (isinstance(value, bool) or not isinstance(value, Integral)):
                raise ConfigError(f"{option.name} is {value!r}: expected a whole number.")
            elif expected.startswith("Mapping") and not isinstance(value, Mapping):
                raise ConfigError(f"{option.name} is {value!r}: expected a mapping of names.")


def finite_number(name: str, value: Any) -> float:
    """Return a setting as a float.

    Raises:
        ConfigError: If it is no finite number.
    """
    try:
        if not isinstance(value, bool) and isinstance(value, Real) and math.isfinite(value):
            return float(value)
    except OverflowError:  # a whole number beyond all floats
        pass
    raise ConfigError(f"{name} is {reprlib.repr(value)}: expected a finite number.")


def reward_weight(name: str, value: Any) -> float:
    """Return the weight of a term of the reward as a float.

    Raises:
        ConfigError: If it is no number, or so large that returns may not be finite.
    """
    weight = finite_number(name, value)
    if abs(weight) > MAX_REWARD_WEIGHT:
        raise ConfigError(
            f"{name} is {weight:g}: expected {-MAX_REWARD_WEIGHT:g} to {MAX_REWARD_WEIGHT:g}, as "
            "rewards are kept and summed as 32-bit floats, which larger ones overflow."
        )
    return weight


def check_lookahead(name: str, steps: int) -> None:
    """Refuse a number of control steps to look ahead that is out of range.

    Raises:
        ConfigError: If it is.
    """
    if not 0 <= steps <= MAX_LOOKAHEAD:
        raise ConfigError(
            f"{name} is {reprlib.repr(steps)}: expected 0 to {MAX_LOOKAHEAD} control steps, as "
            "each observation holds 89 numbers for each of them, 3.6 MB for that many."
        )


def _text_or_path(name: str, value: Any) -> str:
    if not isinstance(value, str | os.PathLike):
        raise ConfigError(f"{name} is {value!r}: expected text or a path.")
    return os.fspath(value)


def _require(condition: bool, name: str, value: object, valid: str) -> None:
    if not condition:
        raise ConfigError(f"{name} is {value!r}: expected {valid}.")


def _one_of(name: str, value: object, valid: tuple[str, ...]) -> None:
    if value not in valid:
        raise ConfigError(
            f"{name} is {value!r}: expected one of {', '.join(map(repr, valid))}."
            f"{near_names(str(value), valid)}"
        )
