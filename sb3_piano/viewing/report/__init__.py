"""The report of what was played: a self-contained HTML page with interactive figures."""

from sb3_piano.viewing.report.judgement import (
    DueNotes,
    Fate,
    PlayedPresses,
    Verdict,
    judge,
)
from sb3_piano.viewing.report.piano_roll import note_name
from sb3_piano.viewing.report.report import Curve, Report, report_html, score_html

__all__ = [
    "Curve",
    "DueNotes",
    "Fate",
    "PlayedPresses",
    "Report",
    "Verdict",
    "judge",
    "note_name",
    "report_html",
    "score_html",
]
