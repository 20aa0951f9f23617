"""Reproducible results: files of evaluations, aggregates, and checks by replaying."""

from sb3_piano.lab.results.checking import check, drawn
from sb3_piano.lab.results.held_out import held_out
from sb3_piano.lab.results.measuring import Measurement, measure
from sb3_piano.lab.results.records import Results

__all__ = ["Measurement", "Results", "check", "drawn", "held_out", "measure"]
