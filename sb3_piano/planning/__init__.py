"""Playing from knowledge: the score and the simulator are known, so a plan plays without training.

:func:`plan` finds the motion of both hands for a whole piece, :class:`PlannedPianist` follows it
behind the ``predict`` of a trained model.
"""

from sb3_piano.planning.pianist import PlannedPianist, Trackers
from sb3_piano.planning.plan import Plan, plan
from sb3_piano.planning.policy import PianoPolicy
from sb3_piano.planning.problems import Problem
from sb3_piano.planning.settings import PlanSettings
from sb3_piano.planning.tracker import Tracker

__all__ = [
    "PianoPolicy",
    "Plan",
    "PlanSettings",
    "PlannedPianist",
    "Problem",
    "Tracker",
    "Trackers",
    "plan",
]
