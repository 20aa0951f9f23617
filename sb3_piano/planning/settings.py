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
    """Passes of refinement: number of times that the plan is played in a simulation of its own,
    where other ways are tried around what goes wrong (:mod:`sb3_piano.planning.refinement`)."""
    feedback: Number = 1.0
    """Share of the optimal feedback that is used: contacts are not in the linear model."""
    lift: Number = 0.02
    """Height by which a fingertip is lifted that is to the side of its place, m: it has caught on
    something, or is late (:mod:`sb3_piano.planning.correction`)."""

    hover: Number = HOVER
    """Height over a key of a finger that will soon play it, m."""
    hold_depth: Number = 1.2
    """Depth of a key while it is down: more than its travel, so that it is pressed."""
    press_force: Number = 3.0
    """Force on a key that is held, as a multiple of what its spring takes."""
    press_force_thumb: Number = 4.0
    """The same for thumbs."""
    stretch: Share = 0.7
    """Share of what two fingers can spread within which a hand strikes the next key without coming
    up before."""
    hurry: Index = 0
    """Control steps that a leap takes less from the notes around it than the fingering expects.
    Most music is played worse then; refinement looks for the parts that are played better."""

    arms_apart: Number | None = None
    """Least distance of the two forearms, m; none is what the hand says."""

    rounds: Count = 8
    """Number of times that the line between the arms is moved."""
    iterations: Count = 8
    """Iterations of the least squares in each of these rounds."""
    dynamic_iterations: Count = 8
    """Iterations that then take the hands' inertia into account."""
    window: Positive = 30.0
    """Length of the stretches in which a long piece is planned, s."""
    overlap: Positive = 3.0
    """Time beyond its end that each of them considers, s."""
