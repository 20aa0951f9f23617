"""Report of a performance: a self-contained HTML page with interactive figures."""

from sb3_piano.viewing.report.report import Curve, Report, report_html, score_html

__all__ = ["Curve", "Report", "report_html", "score_html"]
