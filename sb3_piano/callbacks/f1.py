"""The two metrics by which a training is usually judged."""

from __future__ import annotations

from sb3_piano.callbacks.metric_eval import MetricEvalCallback


class F1Callback(MetricEvalCallback):
    """Evaluate, and keep the best model, by F1: key by key and control step by control step."""

    metric = "f1"


class OnsetF1Callback(MetricEvalCallback):
    """Evaluate, and keep the best model, by onset F1: is each note struck, and struck in time."""

    metric = "onset_f1"
