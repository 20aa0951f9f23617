"""The report of a study: one HTML page with Optuna's figures that needs no network."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Iterable
from html import escape
from pathlib import Path

import gymnasium as gym
import optuna
import plotly.graph_objects as go

from sb3_piano.files import write_text
from sb3_piano.metrics import DEFINITIONS
from sb3_piano.training.env_ids import registered_id
from sb3_piano.tuning.attributes import counting, repeated
from sb3_piano.tuning.outcome.best import (
    CAVEAT,
    best_entry,
    best_trial,
    complete_trials,
    objective_in_words,
    preset_trial,
    training_in_words,
)
from sb3_piano.tuning.outcome.commands import train_command, zoo_command
from sb3_piano.tuning.outcome.report_figures import (
    history_figure,
    importance_figure,
    parallel_figure,
    reports_figure,
    slice_figures,
    timeline_figure,
)
from sb3_piano.tuning.outcome.report_tables import best_trials_table, failures_table, settings_table
from sb3_piano.tuning.outcome.table import STATES
from sb3_piano.tuning.outcome.zoo_entry import zoo_entry
from sb3_piano.tuning.study_config import StudyConfig
from sb3_piano.tuning.study_folder import StudyFolder
from sb3_piano.viewing.report.document import document_html
from sb3_piano.viewing.report.tables import facts_html
from sb3_piano.viewing.report.theme import figure_html


def write_report(study: optuna.Study, config: StudyConfig, folder: StudyFolder) -> Path:
    """Write the report into the study's folder.

    Returns:
        The file.
    """
    write_text(folder.report_file, report_html(study, config, folder))
    return folder.report_file


def report_html(study: optuna.Study, config: StudyConfig, folder: StudyFolder | None = None) -> str:
    """Return the page.

    Args:
        study: The study, whatever it holds so far.
        config: What it searches.
        folder: Where it is, for the commands; by default the present folder.
    """
    place = StudyFolder(Path()) if folder is None else folder
    label = f"{config.objective} {DEFINITIONS[config.metric].label}"
    parts = [
        f'<p class="eyebrow">{escape(_subject(config))}</p><h1>{escape(study.study_name)}</h1>',
        f"<p>{escape(_summary(study))}</p>",
        f'<p class="note">{escape(CAVEAT)}</p>',
        f'<div class="pair">{_history_section(study, label)}{_importance_section(study)}</div>',
        _best_section(study, config),
        _course_section(study, label),
        _settings_section(study, label),
        _failures_section(study),
        _facts_section(study, config, place),
    ]
    return document_html(study.study_name, parts)


def _subject(config: StudyConfig) -> str:
    env_id = registered_id(config.env_id)[1]
    score = {**gym.spec(env_id).kwargs, **config.config.env_kwargs}.get("score")
    piece = f" · {Path(score).stem}" if isinstance(score, str) else ""
    return f"Study of {config.algo.upper()} · {env_id}{piece}"


def _summary(study: optuna.Study) -> str:
    trials = counting(study)
    counts = Counter(trial.state for trial in trials)
    states = ", ".join(f"{counts[state]} {name}" for state, name in STATES.items() if counts[state])
    text = f"{_count(len(trials), 'trial')}{f': {states}' if states else ''}."
    best, preset = best_trial(study), preset_trial(study)
    if best is not None:
        text += f" The best value is {best.value:.3f}, of trial {best.number}"
        beside = f"; the preset's is {preset.value:.3f}." if preset is not None else "."
        text += " with the preset's settings." if preset is best else beside
    again = len(repeated(study.get_trials(deepcopy=False)))
    if again:
        text += f" {_count(again, 'interrupted trial')} not counted: repeated under other numbers."
    return text


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def _history_section(study: optuna.Study, label: str) -> str:
    figure = history_figure(study, label)
    if figure is None:
        return _section("History", "No trial is complete yet.")
    return _section("History", "Each point is a complete trial.", [figure_html(figure, "history")])


def _importance_section(study: optuna.Study) -> str:
    figure = importance_figure(study)
    complete = _count(len(complete_trials(study)), "complete trial")
    if figure is None:
        return _section("Importance", f"This needs values that differ; so far: {complete}.")
    note = (
        f"What sets the best tenth apart, of {complete} (PED-ANOVA; the shares sum up to 1). "
        "Pruned and failed trials are not in it. Of few trials it is little more than a guess."
    )
    return _section("Importance", note, [figure_html(figure, "importance")])


def _best_section(study: optuna.Study, config: StudyConfig) -> str:
    if best_trial(study) is None:
        return ""
    return _section("Best settings", "", [settings_table(study, config)]) + _section(
        "Best trials", "", [best_trials_table(study, config)]
    )


def _course_section(study: optuna.Study, label: str) -> str:
    reports, timeline = reports_figure(study, label), timeline_figure(study)
    parts = []
    if reports is not None:
        note = "What each trial reported on its way; that of a dotted line was pruned."
        parts.append(_section("Pruning", note, [figure_html(reports, "reports")]))
    if timeline is not None:
        note = "When each trial ran. Point at a bar for its settings."
        parts.append(_section("Time", note, [figure_html(timeline, "timeline")]))
    return f'<div class="pair">{"".join(parts)}</div>'


def _settings_section(study: optuna.Study, label: str) -> str:
    parallel = parallel_figure(study, label)
    if parallel is None:
        return ""
    slices = slice_figures(study, label)
    panels = "".join(
        f"<div><h3>{escape(name)}</h3>{figure_html(figure, f'slice-{number}')}</div>"
        for number, (name, figure) in enumerate(slices.items(), start=1)
    )
    return _section(
        "Settings together",
        "Each line is a complete trial, the darker the better.",
        [_wide(parallel, "parallel")],
    ) + _section(
        "Settings one by one",
        "Each point is a complete trial, the darker the later; the most important setting first.",
        [f'<div class="grid">{panels}</div>'],
    )


def _failures_section(study: optuna.Study) -> str:
    table = failures_table(study)
    return _section("Failed trials", "", [table]) if table else ""


def _facts_section(study: optuna.Study, config: StudyConfig, folder: StudyFolder) -> str:
    facts = [("Value", objective_in_words(config)), ("Training", training_in_words(config))]
    commands = []
    entry = best_entry(study, config)
    if entry is not None:
        written, left_out = zoo_entry(config.algo, config.env_id, entry)
        kwargs = written.get("env_kwargs", {})
        commands = [
            ("Train", train_command(config, folder.best_file, left_out.get("vec_env"))),
            ("Train in RL Zoo", zoo_command(config, folder.best_file, kwargs)),
        ]
    journal = folder.journal_file
    store = shlex.quote(str(journal)) if folder.path == Path() or journal.exists() else "URL"
    commands.append(("Look closer", f"optuna-dashboard {store}"))
    names = [name for name, _ in commands]
    again = [("Go on", "the command that began the study, with more --trials if it has them all")]
    return _section("How to go on", "", [facts_html([*facts, *commands, *again], code=names)])


def _section(title: str, note: str, parts: Iterable[str] = ()) -> str:
    words = f'<p class="note">{escape(note)}</p>' if note else ""
    return f"<section><h2>{escape(title)}</h2>{words}{''.join(parts)}</section>"


def _wide(figure: go.Figure, name: str) -> str:
    """Return a figure that is scrolled where it does not fit."""
    html = figure_html(figure, name)
    return f'<div class="wide"><div style="min-width:{figure.layout.meta}px">{html}</div></div>'
