"""What the page in the browser needs of this package, as files."""

from sb3_piano.lab.web.export import CATALOGUE, DEFAULT_PIECES, export_web, score_table

__all__ = ["CATALOGUE", "DEFAULT_PIECES", "export_web", "score_table"]
