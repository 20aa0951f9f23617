"""Domain randomisation: physics, latency and noise that differ from episode to episode."""

from __future__ import annotations

import dataclasses
from typing import Annotated, Any, SupportsFloat

import gymnasium as gym
import numpy as np
from annotated_types import Ge, Le

from sb3_piano.arrays import Arrays, FloatArray
from sb3_piano.engine import mujoco
from sb3_piano.envs.observation import ObservationLayout
from sb3_piano.exceptions import ConfigError
from sb3_piano.settings import Number, Unit, Whole, checked
from sb3_piano.simulation import PianoScene
from sb3_piano.wrappers.piano import unwrap_piano

_Factor = Annotated[Number, Ge(0.01), Le(100.0)]
_Factors = tuple[_Factor, _Factor]
_Steps = Annotated[Whole, Ge(0), Le(20), Unit("control steps")]
_Size = Annotated[Number, Ge(0.0), Le(1.0)]

_SAME = (1.0, 1.0)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Conditions:
    """What was drawn for n episodes."""

    fields: Arrays
    """Changed fields of MuJoCo's model by name, (n, ...)."""
    sounding_angle: FloatArray
    """(n, 88) angle at and above which each key sounds, rad."""
    latency: np.ndarray
    """(n,) control steps by which actions come late."""


class DomainRandomization(gym.Wrapper[Any, Any, Any, Any], gym.utils.RecordConstructorArgs):
    """Draw physics, latency and noise for each episode, by which a policy becomes robust.

    Each range is a pair (lowest, highest), from which numbers are drawn uniformly; equal seeds of
    ``reset`` draw equal numbers. By default nothing changes. It belongs inside all other wrappers
    of actions and observations, such as ``HandActions``. Scores are not changed. In a batch each
    world has its own numbers (docs/batch.md).

    Args:
        env: A piano environment, wrapped or not.
        mass: Factors of mass and inertia, one for each body of the hands.
        friction: Factors of the sliding friction of all contacts, one for an episode.
        key_spring: Factors of the springs, one for each key.
        key_threshold: Factors of the angle at which a key sounds, one for each key; at most the
            key's largest angle.
        actuator_gain: Factors of the position gain, one for each actuator.
        latency: Control steps by which actions come late, 0 to 20, one number for an episode. Until
            then the hands rest.
        observation_noise: Standard deviation of the noise of each observed joint position, rad or
            m, drawn anew in each control step.
        keyboard_offset: Largest displacement of the keyboard along each axis, m. The observation
            "hands" does not show it.

    Raises:
        ConfigError: If a range is not valid, or ``env`` is no piano.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any],
        mass: tuple[float, float] = _SAME,
        friction: tuple[float, float] = _SAME,
        key_spring: tuple[float, float] = _SAME,
        key_threshold: tuple[float, float] = _SAME,
        actuator_gain: tuple[float, float] = _SAME,
        latency: tuple[int, int] = (0, 0),
        observation_noise: float = 0.0,
        keyboard_offset: float = 0.0,
    ) -> None:
        factors: dict[str, Any] = {
            "mass": mass,
            "friction": friction,
            "key_spring": key_spring,
            "key_threshold": key_threshold,
            "actuator_gain": actuator_gain,
        }
        sizes: dict[str, Any] = {
            "observation_noise": observation_noise,
            "keyboard_offset": keyboard_offset,
        }
        gym.utils.RecordConstructorArgs.__init__(self, **factors, latency=latency, **sizes)
        super().__init__(env)
        self._piano = unwrap_piano(env, type(self).__name__)
        self.factors = {name: _range(name, pair, _Factors) for name, pair in factors.items()}
        """Range of each factor."""
        self.latency: tuple[int, int] = _range("latency", latency, tuple[_Steps, _Steps])
        """Range of the latency, control steps."""
        self.noise: float = checked("observation_noise", observation_noise, _Size)
        """Standard deviation of observed joint positions, rad or m."""
        self.offset: float = checked("keyboard_offset", keyboard_offset, _Size)
        """Largest displacement of the keyboard along each axis, m."""
        self._random = np.random.default_rng()
        self._model: Any = None
        self.noisy = noisy_columns(self._piano.observation_layout)
        """Columns of the observation with noise."""

    @property
    def varied(self) -> tuple[str, ...]:
        """Names of the fields of MuJoCo's model that are drawn."""
        names = {
            "mass": ("body_mass", "body_inertia"),
            "friction": ("geom_friction",),
            "key_spring": ("jnt_stiffness",),
            "actuator_gain": ("actuator_gainprm", "actuator_biasprm"),
        }
        found = [name for kind, own in names.items() if self.factors[kind] != _SAME for name in own]
        return (*found, *(("body_pos",) if self.offset else ()))

    @property
    def unchanged(self) -> PianoScene:
        """The scene as it was before any change by this wrapper."""
        scene = self._piano.scene
        if scene.model is not self._model:  # at first, and after a change of the moving keys
            self._model, self._unchanged = scene.model, scene.copy()
        return self._unchanged

    def draw(self, count: int, random: np.random.Generator) -> Conditions:
        """Draw the conditions of some episodes."""
        scene = self.unchanged
        model = scene.model

        def factors(kind: str, size: int) -> FloatArray:
            low, high = self.factors[kind]
            return random.uniform(low, high, (count, size))

        fields = {name: np.repeat(getattr(model, name)[None], count, 0) for name in self.varied}
        keys = model.geom_bodyid[scene.key_geom]
        keyboard = model.body_parentid[keys[0]]
        if "body_mass" in fields:
            hands = np.flatnonzero(~np.isin(model.body_rootid, (0, model.body_rootid[keyboard])))
            drawn = factors("mass", len(hands))
            fields["body_mass"][:, hands] *= drawn
            fields["body_inertia"][:, hands] *= drawn[..., None]
        if "geom_friction" in fields:
            fields["geom_friction"][..., 0] *= factors("friction", 1)
        if "jnt_stiffness" in fields:
            joints = model.body_jntadr[keys[scene.moving_keys]]
            fields["jnt_stiffness"][:, joints] *= factors("key_spring", len(joints))
        if "actuator_gainprm" in fields:
            drawn = factors("actuator_gain", model.nu)
            fields["actuator_gainprm"][..., 0] *= drawn
            fields["actuator_biasprm"][..., 1] *= drawn
        if "body_pos" in fields:
            displaced = random.uniform(-self.offset, self.offset, (count, 3))
            fields["body_pos"][:, keyboard] += displaced
        angle = scene.key_sounding_angle * factors("key_threshold", len(scene.key_geom))
        low, high = self.latency
        return Conditions(
            fields=fields,
            sounding_angle=np.minimum(angle, scene.key_max_angle),
            latency=random.integers(low, high + 1, count),
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode under drawn conditions."""
        if seed is not None:
            self._random = np.random.default_rng(seed)
        drawn, scene = self.draw(1, self._random), self._piano.scene
        for name, value in drawn.fields.items():
            getattr(scene.model, name)[:] = value[0]
        if "body_mass" in drawn.fields:
            mujoco.mj_setConst(scene.model, mujoco.MjData(scene.model))
        scene.key_sounding_angle[:] = drawn.sounding_angle[0]
        self._piano.latency = int(drawn.latency[0])
        observation, info = self.env.reset(seed=seed, options=options)
        return self._noisy(observation), info

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """Play a control step."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        return self._noisy(observation), reward, terminated, truncated, info

    def _noisy(self, observation: Any) -> Any:
        if not self.noise:
            return observation
        noisy = observation.copy()
        noisy[self.noisy] += self._random.normal(0.0, self.noise, len(self.noisy))
        return noisy


def noisy_columns(layout: ObservationLayout) -> np.ndarray:
    """Return the columns of an observation that are joint positions."""
    names = [name for name in layout if name.endswith(("_joints", "_positions"))]
    return np.concatenate([np.empty(0, int), *(np.r_[layout[name].slice] for name in names)])


def _range(name: str, pair: Any, annotation: Any) -> Any:
    given = tuple(pair) if isinstance(pair, list | tuple) else pair
    low, high = checked(name, given, annotation)
    if low > high:
        raise ConfigError(f"{name} is {given!r}: expected the lowest number first.")
    return low, high
