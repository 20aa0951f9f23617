"""Settings of a piano environment."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from annotated_types import Ge, Le

from sb3_piano.envs.blocks import block_classes
from sb3_piano.envs.terms import SELF_ACTUATED_TERMS, TERMS, RewardWeight, Term, own_terms
from sb3_piano.exceptions import ConfigError
from sb3_piano.hands import DEFAULT_HAND, find_hand
from sb3_piano.music.hands import HANDS, Hand
from sb3_piano.music.pedalling import Pedalling
from sb3_piano.settings import Listed, Number, TextOrPath, Unit, Whole, refuse_unknown, settings
from sb3_piano.simulation.physics import physics_profile
from sb3_piano.viewing.views import PictureHeight, PictureWidth, View

ObservationKind = Literal["roll", "window", "fingers", "hands"]
"""Ways to observe goal and state."""

NEWEST_HANDS = 2
"""Newest version of the observation "hands"; a change of its numbers makes another."""

LookaheadSteps = Annotated[
    Whole,
    Ge(0),
    Le(10_000),
    Unit(
        "control steps, as each observation holds 89 numbers for each of them, 3.6 MB for that many"
    ),
]
"""Control steps after the current one that an observation shows."""


@settings
class PianoEnvConfig:
    """Settings of a :class:`~sb3_piano.envs.PianoEnv`, besides the score.

    The defaults are the training settings of RoboPianist's authors.

    Raises:
        ConfigError: If a value has the wrong type or is out of range.
    """

    fingering: TextOrPath = "keep"
    """Source of the finger labels. "keep" leaves them as they are. "ergonomic" labels the notes
    without a finger. "robot" does, too, and changes hands and fingers that do not suit the
    simulated hands. "optimal-transport" removes all labels, so that any finger may play. The path
    of a fingering file labels the environment's own score, but not a score that ``reset`` names."""
    n_steps_lookahead: LookaheadSteps = 10
    """Control steps after the current one that the goal shows; 0 to 10,000."""
    observation: ObservationKind = "roll"
    """"roll" is RoboPianist's observation. "window" is the same for the keys of the piece and three
    more on either side, and refuses pieces with others. "fingers" has 130 numbers: the place and
    time of each finger's next press, the pedal, the number of wrong keys, and the joints. "hands"
    has two equal parts, one per hand, with its coming targets; the left hand is mirrored, as in the
    actions of :class:`~sb3_piano.wrappers.HandActions`. Both need finger labels."""
    hands_version: Annotated[Whole, Ge(1), Le(NEWEST_HANDS)] = 1
    """Version of the observation "hands". 1 is that of the shipped sight-reader, which plays with
    either; 2 also shows how loud each hand's coming notes should be."""
    observation_blocks: Annotated[tuple[Any, ...], Listed] = ()
    """Your own blocks at the end of the observation: subclasses of
    :class:`~sb3_piano.envs.Block`, or their import paths, "package.module.Name"."""
    control_timestep: Number = 0.05
    """Length of a control step, s; a whole number of physics steps."""
    initial_buffer_time: Annotated[Number, Ge(0), Unit("s")] = 0.0
    """Silence before the score, s, in which the hands can move to their first notes."""
    trim_silence: bool = True
    """Start the score at its first note."""
    pedal: Pedalling = "score"
    """Sustain pedal that is due: "score" is the score's, "none" none. "auto" is the score's, or
    where it has none, legato pedalling at its changes of harmony
    (:mod:`sb3_piano.music.pedalling`)."""
    hands_in_scene: Literal["both", "right", "left", "none"] = "both"
    """Hands in the scene. A single hand has only its own actions, observation and joints, and no
    forearm to collide with. It plays its own notes and those without a known hand. With "none"
    actuators drive the keys themselves, and the reward has other terms."""
    hands: Literal["both", "right", "left"] = "both"
    """Hands whose notes are played; the other hand's notes are left out. Notes without a hand are
    assigned to one first."""
    hand: TextOrPath = DEFAULT_HAND
    """Robot hand on both sides: a name, or the path of its folder (docs/hands.md)."""
    reduced_action_space: bool = True
    """Leave out three joints of each Shadow hand, two of the thumb and one of the little finger's
    metacarpal: 39 actions instead of 45; for one hand 20 instead of 23."""
    forearm_dofs: Annotated[tuple[str, ...], Listed] | None = None
    """Joints of each forearm, in the hand's order; by default its sliders along the keyboard and
    towards the keys' hinges. The Shadow hand has RoboPianist's names: these two, a slider up, and
    turns about its own axis, up and to the side (docs/environments.md). The first joint is
    required. Each further joint adds one action and one observed number to each hand."""
    gravity_compensation: bool = True
    """Balance the weight of the hands by forces."""
    physics: str = "reference"
    """Name of a physics profile, from the slowest to the fastest: "reference" (RoboPianist's),
    "faithful", "fast-contacts" or "fast"."""
    fingering_reward: Literal["auto", "labels", "optimal-transport", "off"] = "auto"
    """"labels" rewards labelled fingers at their keys, "optimal-transport" any finger near a due
    key (RP1M). "auto" uses labels if the score has any, else optimal transport. "off" is 0."""
    forearm_reward: bool = True
    """Reward forearms that do not touch. If off, or with one hand, the term is 0."""
    reward_weights: Mapping[str, RewardWeight] = dataclasses.field(default_factory=dict)
    """Weights of reward terms by name, which override the default ones: ``DEFAULT_REWARD_WEIGHTS``,
    or ``SELF_ACTUATED_REWARD_WEIGHTS`` without hands."""
    reward_terms: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    """Your own reward terms by name: each a ``Term``, a function of a ``StepView``, or the import
    path of either, "package.module.name"."""
    goal_time: Literal["beginning", "end"] = "beginning"
    """Time at which keys are due. With "beginning", as in RoboPianist, a key must be down by the
    end of the control step in which its note begins. With "end" it must be down when the note
    begins, and up one step earlier. The option changes the observation, the reward (except
    ``strike``) and ``wrong_press_termination``, but not the metrics."""
    wrong_press_termination: bool = False
    """Terminate the episode when a key that is not due sounds."""
    randomize_hand_positions: bool = False
    """Start each episode with both hands moved along the keyboard by up to 5 cm."""
    musicianship: bool = False
    """Whether the final ``info`` also has the numbers of musicianship (docs/musicianship.md)."""
    width: PictureWidth = 640
    """Width of a rendered picture, pixels; at most 1920."""
    height: PictureHeight = 360
    """Height of a rendered picture, pixels; at most 1080."""
    view: View = "stage"
    """View of the rendered picture: "stage", "close", "top" or "roll"."""

    @classmethod
    def from_options(cls, options: Mapping[str, Any]) -> PianoEnvConfig:
        """Make a config from settings by name; unknown names are refused."""
        fields = [field.name for field in dataclasses.fields(cls)]
        refuse_unknown(options, fields, "option", "the piano environment")
        return cls(**options)

    def __post_init__(self) -> None:
        object.__setattr__(self, "observation_blocks", block_classes(self.observation_blocks))
        object.__setattr__(self, "reward_terms", own_terms(self.reward_terms))
        default = {name: term.weight for name, term in self.terms.items()}
        refuse_unknown(self.reward_weights, default, "reward term")
        object.__setattr__(self, "reward_weights", {**default, **self.reward_weights})
        if self.hands_in_scene not in ("both", "none", self.hands) and self.hands != "both":
            raise ConfigError(
                f"hands is {self.hands!r} and hands_in_scene {self.hands_in_scene!r}: the hand "
                "whose notes are played is not there. Expected the same hand, or 'both'."
            )
        if len(self.sides) < len(HANDS):
            object.__setattr__(self, "forearm_reward", False)
        if not self.sides and self.observation in ("fingers", "hands"):
            raise ConfigError(
                f"observation is {self.observation!r}, but no hand is in the scene: expected "
                "'roll' or 'window'."
            )
        find_hand(self.hand).forearm_dofs(self.forearm_dofs)  # raises if there are none
        self.n_substeps  # noqa: B018  raises if the timesteps do not fit

    @property
    def sides(self) -> tuple[Hand, ...]:
        """Hands of the scene."""
        return tuple(side for side in HANDS if self.hands_in_scene in (side, "both"))

    @property
    def terms(self) -> dict[str, Term]:
        """All terms of the reward."""
        return {**(TERMS if self.sides else SELF_ACTUATED_TERMS), **self.reward_terms}

    @property
    def simulation(self) -> str:
        """Options on which the physics depends, as text."""
        hand = find_hand(self.hand)
        dofs = hand.forearm_dofs(self.forearm_dofs)
        forearms = "" if dofs == hand.forearm_dofs() else f", forearm_dofs {list(dofs)}"
        return (
            f"physics {self.physics!r}, gravity_compensation {self.gravity_compensation}, "
            f"control_timestep {self.control_timestep:g}{forearms}"
        )

    @property
    def n_substeps(self) -> int:
        """Physics steps in a control step."""
        timestep = physics_profile(self.physics).timestep
        count = round(self.control_timestep / timestep)
        if count < 1 or not math.isclose(count * timestep, self.control_timestep, rel_tol=1e-9):
            raise ConfigError(
                f"control_timestep {self.control_timestep} s is not a whole number of physics "
                f"steps: expected a multiple of {timestep} s (physics profile {self.physics!r})."
            )
        return count
