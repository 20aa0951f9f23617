"""Terms of the reward: a table of the built-in ones, and checks of a user's own.

The reward of a control step is the sum over the terms of ``weight * term``. With the default
weights each weighted term equals RoboPianist's (without hands ``SelfActuatedPiano``'s).
``strike`` and ``dynamics`` are new, with the default weight 0.
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
from sb3_piano.metrics.presses import strike_speeds
from sb3_piano.music import PianoRoll
from sb3_piano.music.dynamics import velocity_of
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
    """Input of a reward term: the control step just played. Nothing in it is a copy.

    ``set_state`` restores ``controls`` and ``controls_before``, so a term that depends on them
    needs no state of its own.
    """

    simulation: Simulation
    """State after the step as last read: keys, fingertips, forces, MuJoCo's ``data``."""
    goal: Goal
    """The score as the goal of each control step."""
    number: int
    """Number of earlier control steps of the episode."""
    asked: StepGoal
    """Goal of the state: ``goal.steps[number]``."""
    pedal_down: bool
    """Whether the sustain pedal is down."""
    controls: FloatArray
    """(nu,) targets of the actuators, rad or m."""
    controls_before: FloatArray
    """(nu,) targets in the step before; 0 at the start of the episode."""
    record: EpisodeRecord
    """Record of the earlier steps; :attr:`~EpisodeRecord.struck` has the strikes of this one."""

    @property
    def scene(self) -> PianoScene:
        """The scene, with the indices of its parts in MuJoCo's arrays."""
        return self.simulation.scene

    @property
    def controls_change(self) -> FloatArray:
        """(nu,) change of ``controls`` in units of the action, whose range is 2 wide."""
        span = self.scene.ctrl_high - self.scene.ctrl_low
        return 2.0 * (self.controls - self.controls_before) / span

    @property
    def wrong(self) -> bool:
        """Whether a key that is not due sounds."""
        return int.from_bytes(self.simulation.sounding) & self.asked.not_due > 0


def _nothing(goal: Goal) -> float:
    del goal
    return 0.0


@dataclass(frozen=True)
class Term:
    """Term of the reward: its function and its weight.

    Raises:
        ConfigError: If a value does not fit.
    """

    value: Callable[[StepView], float]
    """Function that computes the unweighted term of a control step, a finite number, from a
    ``StepView``; it must not change its input."""
    weight: float = 1.0
    """Default weight; ``reward_weights`` overrides it."""
    best: Callable[[Goal], float] = _nothing
    """Highest sum of the term in an episode, for ``normalized_return``; 0 for costs."""
    label: str = ""
    """Name in reports, by default that in ``info``. Built-in terms: ``metrics/definitions.yml``."""

    def __post_init__(self) -> None:
        for name in ("value", "best"):
            if not callable(getattr(self, name)):
                raise ConfigError(f"{name} is {getattr(self, name)!r}: expected a function.")
        object.__setattr__(self, "weight", checked("weight", self.weight, RewardWeight))
        checked("label", self.label, str)


def _key_press(step: StepView) -> float:
    """Reward pressing the keys that are due, and no others.

    One half is the mean closeness of the due keys to being fully down (0 if none is due). The other
    half is all or nothing: all unless a key sounds that is not due.
    """
    key_state = step.simulation.key_state
    recall = rewards.held([1.0 - key_state.item(key) for key in step.asked.keys])
    return (0.0 if step.wrong else 0.5) + 0.5 * recall


def _sustain(step: StepView) -> float:
    """Reward holding the pedal when it is due and releasing it when it is not."""
    return rewards.sustain(step.asked.sustain, step.pedal_down)


def _energy(step: StepView) -> float:
    """Return the negative power of the actuators, W."""
    force, velocity = step.simulation.actuator_force, step.simulation.actuator_velocity
    return -float(np.abs(force).dot(np.abs(velocity)))


def _fingering(step: StepView) -> float:
    """Reward fingers near their keys."""
    simulation, kind = step.simulation, step.goal.fingering_reward
    tips, point = simulation.fingertips, simulation.press_point
    if kind == "labels":
        pairs = step.asked.labelled
        return rewards.labelled_fingering([math.dist(point(k), tips[f].tolist()) for k, f in pairs])
    if kind == "off":
        return 0.0
    points = np.array([point(key) for key in step.asked.keys]).reshape(-1, 3)
    # Of the hands in the scene.
    return rewards.optimal_transport_fingering(tips[simulation.scene.fingers], points)


def _forearm(step: StepView) -> float:
    """Return 1 while the forearms do not touch each other, else 0."""
    return float(step.goal.forearm_reward and not step.scene.forearms_touch(step.simulation.data))


def _strike(step: StepView) -> float:
    """Return the number of strikes in time in a control step minus the number of others."""
    hits, misses = step.record.struck
    return float(hits - misses)


_UNLIKE = 30.0
"""Difference of MIDI velocities from which on a strike is worth nothing: 2.3 times the speed."""


def _dynamics(step: StepView) -> float:
    """Reward strikes in time that are as loud as their notes.

    Each is worth 1 less its share of a difference of 30 MIDI velocities, at least 0.
    """
    goal, number, simulation = step.goal, step.number, step.simulation
    return sum(as_loud(goal.roll, number, simulation, key) for key in step.record.hit_keys)


def as_loud(roll: PianoRoll, step: int, simulation: Simulation, key: int) -> float:
    """Return how near the loudness of a strike in a control step is to its note's, 0 to 1."""
    scene = simulation.scene
    angles = scene.angles_of([simulation.key_angles_before, *simulation.key_angles])[None]
    moved = strike_speeds(angles, angles[:, 1:] >= scene.key_sounding_angle)[0, key]
    # A strike in time is at most a control step beside the first one of its note.
    due = int(roll.velocity[max(step - 1, 0) : step + 2, key].max())
    away = abs(due - velocity_of(moved.item() / scene.model.opt.timestep, key))
    return max(1.0 - away / _UNLIKE, 0.0)


def _distance(step: StepView) -> float:
    """Return the negative Euclidean distance between sounding and due keys (and pedal)."""
    return -math.sqrt(_mistakes(step))


def _log_likelihood(step: StepView) -> float:
    """Return the negative binary cross-entropy between sounding and due keys (and pedal)."""
    return _mistakes(step) * math.log(1e-6)  # in place of the logarithm of 0


def _mistakes(step: StepView) -> int:
    """Count the keys that sound wrongly or are missing, plus 1 if the pedal is wrong."""
    due = int.from_bytes(step.asked.due.tobytes())
    mistakes = (int.from_bytes(step.simulation.sounding) ^ due).bit_count()
    return mistakes + (step.asked.sustain != step.pedal_down)


def _best_key_press(goal: Goal) -> float:
    # In steps without a due key the term is at most 0.5.
    return 0.5 * (len(goal) + int(goal.asked.active.any(axis=1).sum()))


def _best_fingering(goal: Goal) -> float:
    labelled = int((goal.asked.finger >= 0).any(axis=1).sum())
    return {"labels": labelled, "optimal-transport": len(goal), "off": 0}[goal.fingering_reward]


def _best_strike(goal: Goal) -> float:
    return float(np.count_nonzero(goal.roll.onset))


TERMS: Mapping[str, Term] = {
    "key_press": Term(_key_press, 1.0, _best_key_press),
    "sustain": Term(_sustain, 1.0, len),
    "energy": Term(_energy, 0.005),
    "fingering": Term(_fingering, 1.0, _best_fingering),
    "forearm": Term(_forearm, 0.5, lambda goal: len(goal) * goal.forearm_reward),
    "strike": Term(_strike, 0.0, _best_strike),
    "dynamics": Term(_dynamics, 0.0, _best_strike),
}
"""Terms of scenes with hands."""

SELF_ACTUATED_TERMS: Mapping[str, Term] = {
    "distance": Term(_distance, 1.0),
    "log_likelihood": Term(_log_likelihood, 0.0),
    **{
        name: dataclasses.replace(TERMS[name], weight=0.0)
        for name in ("key_press", "sustain", "strike", "dynamics")
    },
}
"""Terms of scenes without hands, where actuators drive the keys."""

DEFAULT_REWARD_WEIGHTS = MappingProxyType({name: term.weight for name, term in TERMS.items()})
"""RoboPianist's weights. ``energy`` is in watts, ``strike`` and ``dynamics`` count strikes; the
other terms are in [0, 1]."""

SELF_ACTUATED_REWARD_WEIGHTS = MappingProxyType(
    {name: term.weight for name, term in SELF_ACTUATED_TERMS.items()}
)
"""Weights of scenes without hands, where actuators drive the keys. ``distance`` is RoboPianist's
default there, ``log_likelihood`` its alternative."""

RETURN_KEYS = tuple(RETURN_PREFIX + name for name in DEFAULT_REWARD_WEIGHTS)
"""Names of the weighted terms' episode sums in the final ``info``."""


def own_terms(given: Mapping[str, Any]) -> dict[str, Term]:
    """Resolve reward terms by name, each given as a term, a function or an import path.

    Raises:
        ConfigError: If a name is taken or invalid, or a path cannot be imported or is no term.
            Settings of an exported run may not import code.
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
    """Raise a ConfigError unless the value of a user's term is a finite number; return it."""
    if not isinstance(value, Real) or not math.isfinite(value):
        raise ConfigError(
            f"Reward term {name!r} is {value!r} in control step {step.number}: expected a finite "
            "number."
        )
    return float(value)
