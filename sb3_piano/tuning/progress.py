"""A progress bar on the terminal while a study runs."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Iterator, Sequence

from optuna.trial import FrozenTrial, TrialState
from rich.console import Console
from rich.progress import Progress

from sb3_piano.tuning.supervisor import OnProgress


@contextlib.contextmanager
def progress_bar(n_trials: int, label: str) -> Iterator[OnProgress]:
    """Show how many trials are finished on standard error, as long as the context lasts.

    Args:
        n_trials: Trials of the whole study.
        label: What is maximised, such as "final f1".
    """
    with Progress(console=Console(stderr=True)) as progress:
        task = progress.add_task("trials", total=n_trials)

        def show(trials: Sequence[FrozenTrial]) -> None:
            finished = sum(trial.state.is_finished() for trial in trials)
            progress.update(task, completed=finished, description=summary(trials, label))

        yield show


def summary(trials: Sequence[FrozenTrial], label: str) -> str:
    """Return ``"7 trials (2 running, 3 pruned), highest final f1 0.430 (trial 5)"``."""
    counts = Counter(trial.state for trial in trials)
    finished = sum(trial.state.is_finished() for trial in trials)
    states = {
        "running": counts[TrialState.RUNNING],
        "pruned": counts[TrialState.PRUNED],
        "failed": counts[TrialState.FAIL],
    }
    details = ", ".join(f"{count} {name}" for name, count in states.items() if count)
    text = f"{finished} trials" + (f" ({details})" if details else "")
    complete = [trial for trial in trials if trial.state is TrialState.COMPLETE]
    if complete:
        best = max(complete, key=lambda trial: trial.value or 0.0)
        text += f", highest {label} {best.value:.3f} (trial {best.number})"
    return text
