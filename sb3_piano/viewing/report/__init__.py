"""The report of what was played: a self-contained HTML page with interactive figures."""

from sb3_piano.viewing.report.curves import Curve, training_figures
from sb3_piano.viewing.report.fingers import finger_usage_figure
from sb3_piano.viewing.report.judgement import (
    DueNotes,
    Fate,
    PlayedPresses,
    Verdict,
    judge,
)
from sb3_piano.viewing.report.keyboard import note_name
from sb3_piano.viewing.report.page import Report, report_html
from sb3_piano.viewing.report.piano_roll import piano_roll_figure
from sb3_piano.viewing.report.rewards import reward_terms_figure

__all__ = [
    "Curve",
    "DueNotes",
    "Fate",
    "PlayedPresses",
    "Report",
    "Verdict",
    "finger_usage_figure",
    "judge",
    "note_name",
    "piano_roll_figure",
    "report_html",
    "reward_terms_figure",
    "training_figures",
]
