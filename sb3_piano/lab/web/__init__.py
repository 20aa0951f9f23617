"""Export the web page's files from this package."""

from sb3_piano.lab.web.export import CATALOGUE, DEFAULT_PIECES, export_web, score_table

__all__ = ["CATALOGUE", "DEFAULT_PIECES", "export_web", "score_table"]
