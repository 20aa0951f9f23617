"""Planning of both hands' motion through a piece, from the score and the simulation model.

:func:`plan` computes the motion for a whole piece from the targets of :mod:`sb3_piano.reading`, and
:class:`Refinement` improves it in simulation. :mod:`sb3_piano.players` has players that follow it.
"""

from typing import Any

from sb3_piano.planning.hand_plan import HandPlan as HandPlan
from sb3_piano.planning.plan import Plan, plan
from sb3_piano.planning.plan_file import load_plan as load_plan
from sb3_piano.planning.plan_file import save_plan as save_plan
from sb3_piano.planning.refinement import Refinement
from sb3_piano.planning.settings import PlanSettings
from sb3_piano.planning.tracker import Tracker as Tracker

__all__ = [
    "Plan",
    "PlanSettings",
    "Refinement",
    "plan",
]


def __getattr__(name: str) -> Any:
    if name in ("PianoPolicy", "PlannedPianist"):
        raise ImportError(f"{name} is in sb3_piano.players now: expected it to be imported there.")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
