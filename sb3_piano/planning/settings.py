"""The constants of a plan.

All of them were found on generated studies (scales, arpeggios, Hanon, the debug pieces), but for
``leap_more``, ``change_finger`` and ``thumb_on_black``: for these the Nocturne and the Maple Leaf
Rag of the repertoire were looked at, too, as written and transposed.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from numbers import Real

from sb3_piano.exceptions import ConfigError


@dataclass(frozen=True, kw_only=True)
class PlanSettings:
    """Constants of a plan.

    Positions are the world's: x points from the keys' hinges to the player, y to the right, z up.
    A depth is a share of a key's travel: 0 is its top at rest, 1 fully down, less than 0 above.

    Raises:
        ConfigError: If a value is no finite number, or one that must be above 0 is not.
    """

    # Where keys are pressed.
    white_x: float = 0.042
    """Place on white keys where fingers press, m."""
    white_x_thumb: float = 0.052
    """The same of thumbs, m."""
    mixed_x: float = 0.026
    """Place on white keys where fingers press while their hand plays black ones, too, m."""
    mixed_x_thumb: float = 0.040
    """The same of thumbs, m."""
    black_x: float = -0.002
    """Place on black keys where fingers press, m."""
    black_x_thumb: float = 0.002
    """The same of thumbs, m."""

    # How a key is approached, held and left.
    hover: float = 0.010
    """Height over a key of a finger that will soon play it, m."""
    hover_states: int = 8
    """For how many control steps."""
    lift_depth: float = -0.5
    """Depth two states before a key is down."""
    ready_depth: float = 0.6
    """Depth in the state before: well on its way, but not yet sounding."""
    leap_ready_depth: float = -0.2
    """The same after a leap, when there is less time."""
    repeat_depth: float = 0.45
    """Depth of a key between two strikes of it by the same finger, if there is no more time."""
    hold_depth: float = 1.05
    """Depth while it is down."""
    release_depth: float = 0.2
    """Depth in the state after."""
    leap_release_depth: float = -1.2
    """Depth in the state after, if the hand then moves elsewhere."""

    # How much these places count, per m; a rad of posture counts some 0.01.
    weight_x: float = 4.0
    """Along the key."""
    weight_x_black: float = 20.0
    """Along a black key, from which a finger slips off."""
    weight_y: float = 10.0
    """Across the keys."""
    weight_z: float = 10.0
    """Up and down."""

    # Leaps.
    leap_distance: float = 0.020
    """From how far on the hand's way between two notes costs time, m."""
    leap_frames: int = 2
    """Control steps of sound that a leap costs, less the rest between the notes."""
    leap_more: tuple[float, ...] = (0.09, 0.12, 0.2, 0.25)
    """Distances from which on it costs one more, m."""
    leap_rest: int = 12
    """After how many steps of rest there is time enough for any leap."""
    reach: float = 0.06
    """Distance of a hand from a key within which a finger already moves towards it, m."""

    # Fingers.
    change_finger: float = 0.5
    """Cost of a finger that is not the written one, in control steps of sound; with a large
    number only those are changed that would have to hold two keys, and what they do not reach
    together is let go."""
    thumb_on_black: float = 1.0
    """Cost of a thumb on a black key, in the same."""

    # Keeping out of the way.
    idle_height: float = 0.047
    """Least height of fingertips that play nothing, m; a black key's top is at 0.035."""
    weight_idle: float = 5.0
    """Weight of falling short of it, per m."""
    idle_x: float = 0.030
    """Distance from the black keys that such fingertips keep while they are below ..."""
    idle_x_height: float = 0.052
    """... this height, m."""
    wall_x: float = 0.0235
    """The same for fingertips that play: nearer than this, m, ..."""
    wall_height: float = 0.037
    """... they are above this height (and their radius), m."""
    weight_wall: float = 5.0
    """Weight of coming nearer, per m."""
    spacing: float = 0.016
    """Least distance across the keys of neighbouring fingertips, m."""
    thumb_spacing: float = 0.012
    """The same of thumb and index finger: no thumb passes under."""
    weight_spacing: float = 3.0
    """Weight of falling short of these, per m."""
    arms_apart: float = 0.16
    """Least distance of the two forearms, m; they touch at 0.15."""
    idle_arm_apart: float = 0.05
    """Additional distance of an arm that plays nothing, m."""
    weight_arms: float = 40.0
    """Weight of coming nearer, per m."""

    # Posture and smoothness.
    posture: float = 0.01
    """Weight of a finger's distance from the resting posture, per rad."""
    jerk_finger: float = 0.01
    """Weight of a change of a finger's velocity, per rad and squared control step."""
    jerk_wrist: float = 0.02
    """The same of the wrist's two joints."""
    jerk_along: float = 0.12
    """The same of the slider along the keyboard, per m and squared control step."""
    jerk_inwards: float = 0.2
    """The same of the slider towards the keys' hinges."""
    velocity: float = 0.002
    """Weight of a velocity, per rad or m and control step."""

    # Control.
    press_force: float = 3.0
    """Force on a key that is held, as a multiple of what its spring takes."""
    press_force_thumb: float = 4.0
    """The same for thumbs."""
    effort: float = 1e-4
    """Weight of a finger's command that differs from the planned position, per squared rad."""
    effort_arm: float = 1e-2
    """The same of the sliders, per squared m."""
    feedback: float = 0.5
    """Share of the optimal feedback that is used: contacts are not in the linear model."""

    # The search.
    rounds: int = 8
    """Number of times that the line between the arms is moved."""
    iterations: int = 8
    """Iterations of the least squares in each of these rounds."""
    dynamic_iterations: int = 8
    """Iterations that then take the hands' inertia into account."""
    rehearsals: int = 0
    """Number of times that the plan is played in a simulation of its own, to adjust what went wrong
    (:mod:`sb3_piano.planning.rehearsal`)."""
    window: float = 30.0
    """Length of the stretches in which a long piece is planned, s."""
    overlap: float = 3.0
    """Time beyond its end that each of them considers, s."""

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if field.name == "leap_more":
                continue
            if isinstance(value, bool) or not isinstance(value, Real) or not math.isfinite(value):
                raise ConfigError(f"{field.name} is {value!r}: expected a finite number.")
        for name in ("rounds", "iterations", "window", "overlap", "weight_y", "weight_z"):
            if getattr(self, name) <= 0:
                raise ConfigError(f"{name} is {getattr(self, name)!r}: expected more than 0.")
        if self.rehearsals < 0:
            raise ConfigError(f"rehearsals is {self.rehearsals!r}: expected 0 or more.")


AS_WRITTEN = PlanSettings(change_finger=1000.0)
"""The constants, for plans that change no fingers but those that would hold two keys. What the
written ones do not reach together is let go."""
