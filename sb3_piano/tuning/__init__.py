"""Searching hyperparameters with Optuna."""

from sb3_piano.tuning.objective import Objective

__all__ = ["Objective"]
