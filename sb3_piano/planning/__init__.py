"""Playing from knowledge: the score and the simulator are known, so a plan plays without training.

:func:`plan` finds the motion of both hands for a whole piece, :class:`PlannedPianist` follows it
behind the ``predict`` of a trained model. What a plan starts from is
read by :mod:`sb3_piano.reading`.
"""

from sb3_piano.planning.hand_plan import HandPlan
from sb3_piano.planning.pianist import PlannedPianist, Trackers, forget_plans
from sb3_piano.planning.plan import Plan, plan
from sb3_piano.planning.plan_file import load_plan, save_plan
from sb3_piano.planning.policy import PianoPolicy
from sb3_piano.planning.problems import Problem
from sb3_piano.planning.refinement import Refinement
from sb3_piano.planning.settings import PlanSettings
from sb3_piano.planning.tracker import Tracker

__all__ = [
    "HandPlan",
    "PianoPolicy",
    "Plan",
    "PlanSettings",
    "PlannedPianist",
    "Problem",
    "Refinement",
    "Tracker",
    "Trackers",
    "forget_plans",
    "load_plan",
    "plan",
    "save_plan",
]
