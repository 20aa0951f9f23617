"""Evaluation of runs, comparison of evaluations, reports."""
