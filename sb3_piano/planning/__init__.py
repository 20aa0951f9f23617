"""Playing from knowledge: the score and the simulator are known, so a plan plays without training.

:func:`plan` finds the motion of both hands for a whole piece, :class:`PlannedPianist` follows it
behind the ``predict`` of a trained model. What a plan is made of is cheap, and public:
:func:`presses_of_hand` of a roll with fingers, :func:`time_presses`, :func:`key_frames`,
:func:`wanted_places`.
"""

from sb3_piano.music.presses import Press, presses_of_hand
from sb3_piano.planning.hand_plan import HandPlan
from sb3_piano.planning.pianist import PlannedPianist, Trackers, forget_plans
from sb3_piano.planning.plan import Plan, plan
from sb3_piano.planning.plan_file import load_plan, save_plan
from sb3_piano.planning.policy import PianoPolicy
from sb3_piano.planning.problems import Problem
from sb3_piano.planning.refinement import Refinement
from sb3_piano.planning.settings import PlanSettings
from sb3_piano.planning.tracker import Tracker
from sb3_piano.reading.arms import wanted_places
from sb3_piano.reading.key_frames import KeyFrames, key_frames
from sb3_piano.reading.keyboard import KeyPlaces
from sb3_piano.reading.kinematics import HandKinematics
from sb3_piano.reading.presses import TimedPress, time_presses

__all__ = [
    "HandKinematics",
    "HandPlan",
    "KeyFrames",
    "KeyPlaces",
    "PianoPolicy",
    "Plan",
    "PlanSettings",
    "PlannedPianist",
    "Press",
    "Problem",
    "Refinement",
    "TimedPress",
    "Tracker",
    "Trackers",
    "forget_plans",
    "key_frames",
    "load_plan",
    "plan",
    "presses_of_hand",
    "save_plan",
    "time_presses",
    "wanted_places",
]
