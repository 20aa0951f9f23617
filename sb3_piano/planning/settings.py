"""Settings of a plan."""

from __future__ import annotations

from sb3_piano.reading.key_frames import HOVER
from sb3_piano.settings import Count, Index, Number, Positive, Share, settings


@settings
class PlanSettings:
    """Settings of a plan.

    A depth is a share of a key's travel: 0 is its top at rest, 1 fully down, less than 0 above.

    Raises:
        ConfigError: If a value is out of range.
    """

    passes: Index = 0
    """Passes of refinement: number of times that the plan is played in simulation and its errors
    are searched for better motions (:mod:`sb3_piano.planning.refinement`)."""
    dynamics: Index = 0
    """Passes, before those, that seek the speed of each strike for which the note is as loud as its
    velocity asks for (:mod:`sb3_piano.planning.touch`); all passes then rate it."""
    feedback: Number = 1.0
    """Share of the optimal feedback to use; its linear model has no contacts."""
    lift: Number = 0.02
    """Height by which a fingertip to the side of its place is lifted, m; it has caught or is late
    (:mod:`sb3_piano.planning.correction`)."""

    hover: Number = HOVER
    """Height of a finger over its next key, m."""
    hold_depth: Number = 1.2
    """Depth of a key while it is down: more than its travel, so that it is pressed."""
    press_force: Number = 3.0
    """Force on a held key, as a multiple of its spring's."""
    press_force_thumb: Number = 4.0
    """The same for thumbs."""
    stretch: Share = 0.7
    """Share of two fingers' span within which a hand strikes the next key without first coming
    up."""
    hurry: Index = 0
    """Control steps by which leaps shorten the notes around them less than the fingering expects.
    Most music then sounds worse; refinement finds the parts that sound better."""

    leave_early: Index = 0
    """Control steps by which fingers leave their keys earlier before a leap, where the pedal holds
    the notes: keys are held for less time, and more strikes are in time (docs/dynamics.md)."""

    arms_apart: Number | None = None
    """Least distance of the two forearms, m; by default that of the hand."""

    rounds: Count = 8
    """Number of times that the line between the arms is moved."""
    iterations: Count = 8
    """Least-squares iterations in each of these rounds."""
    dynamic_iterations: Count = 8
    """Iterations of the following optimisation with the hands' inertia."""
    window: Positive = 30.0
    """Length of the stretches in which a long piece is planned, s."""
    overlap: Positive = 3.0
    """Time beyond its end that the planning of each stretch considers, s."""
