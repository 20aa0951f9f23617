"""Playing from knowledge: the score and the simulator are known, so a plan plays without training.

:func:`plan` finds the motion of both hands for a whole piece, :class:`PlannedPianist` follows it
behind the ``predict`` of a trained model. What a plan starts from is
read by :mod:`sb3_piano.reading`.
"""

from sb3_piano.planning.hand_plan import HandPlan as HandPlan
from sb3_piano.planning.pianist import PlannedPianist
from sb3_piano.planning.pianist import Trackers as Trackers
from sb3_piano.planning.pianist import forget_plans as forget_plans
from sb3_piano.planning.plan import Plan, plan
from sb3_piano.planning.plan_file import load_plan as load_plan
from sb3_piano.planning.plan_file import save_plan as save_plan
from sb3_piano.planning.policy import PianoPolicy as PianoPolicy
from sb3_piano.planning.problems import Problem as Problem
from sb3_piano.planning.refinement import Refinement
from sb3_piano.planning.settings import PlanSettings
from sb3_piano.planning.tracker import Tracker as Tracker

__all__ = [
    "Plan",
    "PlanSettings",
    "PlannedPianist",
    "Refinement",
    "plan",
]
