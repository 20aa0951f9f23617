"""Results that can be checked: files of evaluations, their aggregates, and playing them again."""

from sb3_piano.lab.results.aggregates import Aggregate, aggregate
from sb3_piano.lab.results.checking import Check, check, drawn
from sb3_piano.lab.results.estimates import Estimate
from sb3_piano.lab.results.held_out import HeldOut, held_out
from sb3_piano.lab.results.measuring import PLAYERS, Measurement, digest, measure
from sb3_piano.lab.results.records import Physics, Result, Results
from sb3_piano.lab.results.tables import aggregate_table, origin_table, score_table

__all__ = [
    "PLAYERS",
    "Aggregate",
    "Check",
    "Estimate",
    "HeldOut",
    "Measurement",
    "Physics",
    "Result",
    "Results",
    "aggregate",
    "aggregate_table",
    "check",
    "digest",
    "drawn",
    "held_out",
    "measure",
    "origin_table",
    "score_table",
]
