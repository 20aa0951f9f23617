"""Write the files of a study: the best settings, a table, and a page of Optuna's figures."""

from __future__ import annotations

import shlex
import warnings
from collections import Counter
from typing import Any

import optuna
from optuna import visualization as plots
from optuna.importance import PedAnovaImportanceEvaluator
from optuna.trial import FrozenTrial

from sb3_piano.files import write_csv, write_text
from sb3_piano.training.configuration.entries import train_commands, with_settings, write_entry
from sb3_piano.tuning import study as of_study
from sb3_piano.tuning.objective import RESULTS
from sb3_piano.tuning.study import StudyConfig, StudyFolder
from sb3_piano.viewing.report.page import render

_WHERE = (of_study.HOST, of_study.FOLDER)
_CAVEAT = (
    "Values of few seeds are noisy, and the best of many trials was lucky as well as good:",
    "train with other seeds, and compare with the preset, before you believe it.",
)


def best_entry(best: FrozenTrial, config: StudyConfig) -> dict[str, Any]:
    """Return the study's entry with a trial's settings."""
    return with_settings(config.entry, config.space.settings(best.params))


def commands_of(best: FrozenTrial, config: StudyConfig, folder: StudyFolder) -> dict[str, str]:
    """Return the commands that train with the best settings, for this package and for RL Zoo."""
    entry = best_entry(best, config)
    return train_commands(config.algo, config.env_id, folder.best_file, entry)


def write_best(study: optuna.Study, config: StudyConfig, folder: StudyFolder) -> None:
    """Write the entry with the best settings and a comment, if a trial is complete."""
    count = of_study.counting(study)
    for best in of_study.best_first(count)[:1]:
        comment = [
            f"Trial {best.number}, the best of {len(count)} of the study {study.study_name!r}: "
            f"{config.value_name} {best.value}, from the seeds {list(config.seeds)}.",
            *_CAVEAT,
            *commands_of(best, config, folder).values(),
            "n_timesteps is the trials' value; to train longer: --steps N, in RL Zoo -n N.",
        ]
        entry = best_entry(best, config)
        write_entry(folder.best_file, config.algo, config.env_id, entry, comment)


def write_table(study: optuna.Study, config: StudyConfig, folder: StudyFolder) -> None:
    """Write a row for each trial.

    The ``value`` of a pruned trial is its last reported one. Settings are written as the training
    got them. Missing values are empty.
    """
    found = study.get_trials(deepcopy=False)
    again, noted = of_study.repeated(found), (*RESULTS, of_study.STEPS, of_study.ORIGIN, *_WHERE)
    rows = (
        {
            **{name: trial.user_attrs.get(name) for name in noted},
            **config.space.settings(trial.params),
            "number": trial.number,
            "state": "repeated" if trial.number in again else of_study.STATES[trial.state],
            "value": trial.value,
            "seconds": trial.duration and round(trial.duration.total_seconds(), 1),
            of_study.FAILURE: of_study.failure_of(trial),
        }
        for trial in found
    )
    columns = ("number", "state", "value", *RESULTS, of_study.STEPS, "seconds", of_study.ORIGIN)
    write_csv(folder.table_file, (*columns, *config.space, of_study.FAILURE, *_WHERE), rows)


def write_report(study: optuna.Study, config: StudyConfig, folder: StudyFolder) -> None:
    """Write the report page of a study in any state."""
    count = of_study.counting(study)
    counts, best = Counter(trial.state for trial in count), of_study.best_first(count)
    store = shlex.quote(str(folder.journal_file)) if folder.journal_file.exists() else "URL"
    settings = config.space.settings
    commands = commands_of(best[0], config, folder) if best else {}
    page = render(
        "study.html",
        study=study,
        config=config,
        caveat=" ".join(_CAVEAT),
        trials=count,
        states=[f"{counts[state]} {n}" for state, n in of_study.STATES.items() if counts[state]],
        repeated=len(study.get_trials(deepcopy=False)) - len(count),
        best=best,
        preset=of_study.preset_trial(count),
        best_trials=[(trial, settings(trial.params)) for trial in best[:10]],
        preset_settings=settings(config.preset_params()),
        results=RESULTS,
        failures=[(t.number, why) for t in count if (why := of_study.failure_of(t))],
        figures=_figures(study, config.value_name),
        commands=[*commands.items(), ("Look closer", f"optuna-dashboard {store}")],
    )
    write_text(folder.report_file, page)


def _figures(study: optuna.Study, value_name: str) -> dict[str, Any]:
    """Draw Optuna's figures of a study, by name, once a trial is complete.

    PED-ANOVA, which draws no random numbers, rates each parameter's importance for the best tenth
    of the trials. ``slice-<n>`` shows the n-th parameter of complete trials.
    """
    complete = of_study.best_first(study.get_trials(deepcopy=False))
    if not complete:
        return {}
    label: Any = {"target_name": value_name}
    with warnings.catch_warnings(action="ignore"):  # about few trials; the page warns, too
        found = {
            "history": plots.plot_optimization_history(study, **label),
            "reports": plots.plot_intermediate_values(study),
            "timeline": plots.plot_timeline(study),
            "parallel": plots.plot_parallel_coordinate(study, **label),
        }
        if len({trial.value for trial in complete}) > 1:
            found["importance"] = plots.plot_param_importances(study, PedAnovaImportanceEvaluator())
        for number, name in enumerate(sorted({n for t in complete for n in t.params}), start=1):
            found[f"slice-{number}"] = plots.plot_slice(study, params=[name], **label)
    for figure in found.values():
        figure.update_layout(title=None, height=340)
        # Time labels that widen a margin could change the ticks, and these the labels, ...
        figure.update_xaxes(automargin="height")
    return found
