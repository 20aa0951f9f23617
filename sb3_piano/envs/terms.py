"""The terms of the reward, each a row of a table; others are given from outside.

The reward of a control step is the sum over the terms of ``weight * term``. With the default
weights each weighted term equals RoboPianist's own (without hands those of ``SelfActuatedPiano``);
``strike``, which RoboPianist does not have, has the weight 0.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from numbers import Real
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np
from annotated_types import Ge, Le

from sb3_piano.arrays import FloatArray
from sb3_piano.envs import rewards
from sb3_piano.exceptions import ConfigError
from sb3_piano.imports import import_instance
from sb3_piano.metrics.episode import RETURN_PREFIX
from sb3_piano.settings import Number, Unit, checked
from sb3_piano.simulation import PianoScene, Simulation

if TYPE_CHECKING:
    from sb3_piano.envs.goal import Goal, StepGoal
    from sb3_piano.envs.record import EpisodeRecord

RewardWeight = Annotated[
    Number,
    Ge(-1e6),
    Le(1e6),
    Unit(", as rewards are kept and summed as 32-bit floats, which larger ones overflow"),
]
"""Weight of a term of the reward."""


class StepView(NamedTuple):
    """What a term of the reward sees of a control step that was just played; none of it is a copy.

    ``controls`` and ``controls_before`` belong to the state that ``set_state`` restores, so that a
    function of them needs no memory of its own.
    """

    simulation: Simulation
    """The state after the step, as it was read: keys, fingertips, forces, MuJoCo's ``data``."""
    goal: Goal
    """The score as the goal of each control step."""
    number: int
    """Control steps of the episode that were over before."""
    asked: StepGoal
    """What is asked of the state: ``goal.steps[number]``."""
    pedal_down: bool
    """Whether the sustain pedal is down."""
    controls: FloatArray
    """(nu,) what the actuators were told, rad or m."""
    controls_before: FloatArray
    """(nu,) what they were told in the step before; 0 where the episode begins."""
    record: EpisodeRecord
    """What was played before this step, and :attr:`~EpisodeRecord.struck` in it."""

    @property
    def scene(self) -> PianoScene:
        """Where in MuJoCo's arrays everything stands."""
        return self.simulation.scene

    @property
    def controls_change(self) -> FloatArray:
        """(nu,) by how much ``controls`` changed, in units of the action, whose range is 2 wide."""
        span = self.scene.ctrl_high - self.scene.ctrl_low
        return 2.0 * (self.controls - self.controls_before) / span

    @property
    def wrong(self) -> bool:
        """Whether a key sounds that should not be down."""
        return int.from_bytes(self.simulation.sounding) & self.asked.not_due > 0


def _nothing(goal: Goal) -> float:
    del goal
    return 0.0


@dataclass(frozen=True)
class Term:
    """A term of the reward: what it is of a control step, and how much it counts.

    Raises:
        ConfigError: If a value does not fit.
    """

    value: Callable[[StepView], float]
    """The unweighted term of a control step, a finite number; it changes nothing that it sees."""
    weight: float = 1.0
    """Its weight, unless ``reward_weights`` has another one."""
    best: Callable[[Goal], float] = _nothing
    """The highest sum that an episode allows, for ``normalized_return``; 0, as of costs."""
    label: str = ""
    """Its name in reports; by default that in ``info``. What is built in has its words in
    ``metrics/definitions.yml``."""

    def __post_init__(self) -> None:
        for name in ("value", "best"):
            if not callable(getattr(self, name)):
                raise ConfigError(f"{name} is {getattr(self, name)!r}: expected a function.")
        object.__setattr__(self, "weight", checked("weight", self.weight, RewardWeight))
        checked("label", self.label, str)


def _key_press(step: StepView) -> float:
    """Reward pressing the keys that are due, and no others.

    Half of it is the mean closeness of the due keys to being fully down (0 if none is due), the
    other half is earned whole if no key sounds that is not due.
    """
    key_state = step.simulation.key_state
    recall = rewards.held([1.0 - key_state.item(key) for key in step.asked.keys])
    return (0.0 if step.wrong else 0.5) + 0.5 * recall


def _sustain(step: StepView) -> float:
    """Reward holding the pedal when it is due and releasing it when it is not."""
    return rewards.sustain(step.asked.sustain, step.pedal_down)


def _energy(step: StepView) -> float:
    """Return minus the power that the actuators turn over, W."""
    force, velocity = step.simulation.actuator_force, step.simulation.actuator_velocity
    return -float(np.abs(force).dot(np.abs(velocity)))


def _fingering(step: StepView) -> float:
    """Reward fingers near their keys."""
    simulation, kind = step.simulation, step.goal.fingering_reward
    tips = simulation.fingertips
    if kind == "labels":
        return rewards.labelled_fingering(
            [
                math.dist(simulation.press_point(key), tips[finger].tolist())
                for key, finger in step.asked.labelled
            ]
        )
    if kind == "off":
        return 0.0
    points = [simulation.press_point(key) for key in step.asked.keys]
    tips = tips[simulation.scene.fingers]  # of the hands that are there
    return rewards.optimal_transport_fingering(tips, np.array(points).reshape(-1, 3))


def _forearm(step: StepView) -> float:
    """Return 1 while the forearms do not touch each other, else 0."""
    return float(step.goal.forearm_reward and not step.scene.forearms_touch(step.simulation.data))


def _strike(step: StepView) -> float:
    """Return how many strikes of a control step were in time less how many were not."""
    hits, misses = step.record.struck
    return float(hits - misses)


def _distance(step: StepView) -> float:
    """Return minus the Euclidean distance between what is down and what is due."""
    return -math.sqrt(_mistakes(step))


def _log_likelihood(step: StepView) -> float:
    """Return minus the binary cross-entropy between what is down and what is due."""
    return _mistakes(step) * _LOG_OF_NOTHING


_LOG_OF_NOTHING = math.log(1e-6)  # stands for that of a probability of 0


def _mistakes(step: StepView) -> int:
    """Return how many keys sound and should not or the other way round, and the pedal likewise."""
    due = int.from_bytes(step.asked.due.tobytes())
    mistakes = (int.from_bytes(step.simulation.sounding) ^ due).bit_count()
    return mistakes + (step.asked.sustain != step.pedal_down)


def _best_key_press(goal: Goal) -> float:
    # In steps in which nothing is due it is 0.5 at most.
    return 0.5 * (len(goal) + int(goal.asked.active.any(axis=1).sum()))


def _best_fingering(goal: Goal) -> float:
    labelled = int((goal.asked.finger >= 0).any(axis=1).sum())
    return {"labels": labelled, "optimal-transport": len(goal), "off": 0}[goal.fingering_reward]


def _best_forearm(goal: Goal) -> float:
    return len(goal) * goal.forearm_reward


def _best_strike(goal: Goal) -> float:
    return int(np.count_nonzero(goal.roll.onset))


TERMS: Mapping[str, Term] = {
    "key_press": Term(_key_press, 1.0, _best_key_press),
    "sustain": Term(_sustain, 1.0, len),
    "energy": Term(_energy, 0.005),
    "fingering": Term(_fingering, 1.0, _best_fingering),
    "forearm": Term(_forearm, 0.5, _best_forearm),
    "strike": Term(_strike, 0.0, _best_strike),
}
"""The terms where there are hands."""

SELF_ACTUATED_TERMS: Mapping[str, Term] = {
    "distance": Term(_distance, 1.0),
    "log_likelihood": Term(_log_likelihood, 0.0),
    **{n: dataclasses.replace(TERMS[n], weight=0.0) for n in ("key_press", "sustain", "strike")},
}
"""The terms where the keys are driven themselves."""


def _weights(terms: Mapping[str, Term]) -> Mapping[str, float]:
    return MappingProxyType({name: term.weight for name, term in terms.items()})


DEFAULT_REWARD_WEIGHTS = _weights(TERMS)
"""RoboPianist's weights. ``energy`` is per watt, ``strike`` for each strike; the other terms lie in
[0, 1]."""

SELF_ACTUATED_REWARD_WEIGHTS = _weights(SELF_ACTUATED_TERMS)
"""Weights where no hand is in the scene and the keys are driven themselves. ``distance`` is
RoboPianist's default there, ``log_likelihood`` its other choice."""

RETURN_KEYS = tuple(RETURN_PREFIX + name for name in DEFAULT_REWARD_WEIGHTS)
"""Names in the final ``info`` of the episode sums of the weighted terms."""


def own_terms(given: Mapping[str, Any]) -> dict[str, Term]:
    """Return reward terms by name that are given as such, as functions or by import paths.

    Raises:
        ConfigError: If a name is taken or none, a path leads nowhere, or what it leads to is no
            term; settings of an exported run name no code of others.
    """
    return {name: _own_term(name, one) for name, one in given.items()}


def _own_term(name: Any, given: Any) -> Term:
    if not isinstance(name, str) or not name.isidentifier():
        raise ConfigError(
            f"Reward term {name!r} has no valid name: expected letters, digits and '_', such as "
            "'smooth'."
        )
    if name in TERMS or name in SELF_ACTUATED_TERMS:
        raise ConfigError(
            f"Reward term {name!r} is built in: expected another name, or reward_weights to weigh "
            "that one."
        )
    try:
        found = import_instance(given, Term) if isinstance(given, str) else given
    except ConfigError as error:
        raise ConfigError(f"Reward term {name!r}: {error}") from error
    if isinstance(found, Term):
        return found
    if not callable(found) or isinstance(found, type):
        raise ConfigError(
            f"Reward term {name!r} is {found!r}: expected a function of the step, a Term, or the "
            "import path of either."
        )
    return Term(found)


def finite_term(name: str, value: Any, step: StepView) -> float:
    """Return the value of a term of one's own, if it is a finite number.

    Raises:
        ConfigError: If it is none.
    """
    if not isinstance(value, Real) or not math.isfinite(value):
        raise ConfigError(
            f"Reward term {name!r} is {value!r} in control step {step.number}: expected a finite "
            "number."
        )
    return float(value)
