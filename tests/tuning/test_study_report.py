"""The page of a study: whatever the study holds, it opens, in a browser without a network too."""

from __future__ import annotations

import csv
import html
import re
import warnings
from pathlib import Path

import optuna
import pytest
from browser_tab import PHONE
from finished_study import (
    SPACE,
    begin,
    complete,
    complete_by_learning_rate,
    complete_preset,
    fail,
    finished_study,
    interrupt,
    new_study,
    prune,
    study_config,
)
from html_page import Page
from optuna.distributions import FloatDistribution

from sb3_piano.tuning.report import (
    importances,
    report_html,
    study_figures,
    write_report,
    write_table,
)
from sb3_piano.tuning.study import StudyFolder

EVIL = "<script>alert(1)</script><img src=x onerror=alert(2)>"


def texts_of(study, config, folder=None):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return Page(report_html(study, config, folder))


# What it says.


@pytest.mark.slow
def test_the_page_counts_trials_and_compares_the_best_settings_with_the_presets(tmp_path):
    space = {**SPACE, "target_entropy": {"float": [-40.0, -10.0]}}
    config, study = study_config(space=space), new_study("evenings")
    complete_preset(study, config, 0.25)
    complete(study, config, 0.5)
    prune(study, config, 0.9)
    fail(study, config, f"RuntimeError: {EVIL}")
    fail(study, config)
    begin(study, config)
    interrupt(study, config)
    study.enqueue_trial({})
    folder = StudyFolder(tmp_path / "a study")
    page = texts_of(study, config, folder)
    for text in (
        *("Study of SAC", "TwinkleTwinkleLittleStar evenings", "train with other seeds"),
        "7 trials: 2 complete, 1 pruned, 2 failed, 1 running, 1 waiting.",
        "The best value is 0.500, of trial 1; the preset's is 0.250. 1 interrupted trial not coun",
        "F1 of the model at the end of a training, in 1 episode from seed 1000",
        f"--config '{folder.best_file}' --seed 0",
        f"--conf-file '{folder.best_file}' --seed 0 --eval-env-kwargs",
        "optuna-dashboard URL",  # there is no journal: it is in a database
    ):
        assert text in page.text
    best = config.space.settings(study.trials[1].params)
    assert page.tables[0] == [
        ["setting", "best", "preset"],
        ["learning_rate", f"{best['learning_rate']:.4g}", "0.001"],
        ["gamma", f"{best['gamma']:.4g}", "0.8"],
        ["batch_size", str(best["batch_size"]), "32"],
        ["policy_kwargs.net_arch", str(best["policy_kwargs.net_arch"]), "[16]"],
        ["target_entropy", f"{best['target_entropy']:.4g}", "auto"],
    ]
    _, reason, killed = page.tables[2]
    assert reason == ["3", f"RuntimeError: {EVIL}"]
    assert (killed[0], "killed" in killed[1]) == ("4", True)
    folder.path.mkdir()
    folder.journal_file.touch()
    assert f"optuna-dashboard '{folder.journal_file}'" in texts_of(study, config, folder).text


@pytest.mark.slow
def test_the_ten_best_complete_trials_are_listed_the_best_first():
    config, study = study_config(), new_study()
    values = [0.1, 0.5, 0.3, 0.7, 0.2, 0.0, 0.9, 0.4, 0.8, 0.6, 0.7, 0.05]
    for value in values:
        complete(study, config, value)
    prune(study, config, 0.99)
    heads, *rows = texts_of(study, config).tables[1]
    assert heads[:3] == ["trial", "value", "final f1"]
    assert [row[0] for row in rows] == ["6", "8", "3", "10", "9", "1", "7", "2", "4", "0"]
    assert rows[0][1:6] == ["0.900", "0.900", "0.450", "0.910", "0.460"]
    settings = config.space.settings(study.trials[6].params)
    assert rows[0][heads.index("gamma")] == f"{settings['gamma']:.4g}"


# The table.


@pytest.fixture
def rows_of(tmp_path):
    """Return a function that writes the table of a study and reads it again."""

    def read(study, config):
        file = write_table(study, config, StudyFolder(tmp_path))
        assert file == tmp_path / "trials.csv"
        return list(csv.DictReader(file.read_text(encoding="utf-8").splitlines()))

    return read


def test_a_row_holds_what_a_trial_scored_took_and_had_as_settings(rows_of):
    config, study = study_config(), new_study()
    assert rows_of(study, config) == []
    complete(study, config, 0.25)
    (row,) = rows_of(study, config)
    settings = config.space.settings(study.trials[0].params)
    assert float(row.pop("learning_rate")) == settings["learning_rate"]
    assert float(row.pop("gamma")) == settings["gamma"] > 0.5  # not its distance from 1
    assert int(row.pop("batch_size")) == settings["batch_size"]
    assert row.pop("policy_kwargs.net_arch") == str(settings["policy_kwargs.net_arch"])
    assert row == {
        **{"number": "0", "state": "complete", "value": "0.25", "final_f1": "0.25"},
        **{"best_f1": "0.26", "final_onset_f1": "0.125", "best_onset_f1": "0.135"},
        **{"steps": "1000", "seconds": "2.5", "origin": "", "failure": "", "host": "here"},
        "folder": "study/trials/0",
    }


def test_states_reasons_and_origins_are_told(rows_of):
    config, study = study_config(), new_study()
    complete_preset(study, config, 0.5)
    prune(study, config, 0.125)
    fail(study, config, 'RuntimeError: "nan",\nagain')
    fail(study, config)
    interrupt(study, config)
    begin(study, config)
    study.ask()  # has no settings yet
    study.enqueue_trial({"batch_size": 64})
    rows = rows_of(study, config)
    assert [row["number"] for row in rows] == [*map(str, range(8))]
    told = [(row["state"], row["value"], row["origin"]) for row in rows]
    assert told == [
        ("complete", "0.5", "preset"),
        ("pruned", "0.125", ""),
        ("failed", "", ""),
        ("failed", "", ""),
        ("repeated", "", ""),
        ("running", "", ""),
        ("running", "", ""),
        ("waiting", "", ""),
    ]
    assert "nan" in rows[2]["failure"]
    assert "killed" in rows[3]["failure"]
    assert rows[0]["gamma"] == "0.8"
    assert rows[5]["gamma"] != rows[6]["gamma"] == ""


# Importance.


@pytest.mark.slow
def test_what_alone_decides_is_the_most_important_and_of_how_many_trials_is_said():
    config, study = study_config(), new_study()
    for _ in range(40):
        complete_by_learning_rate(study, config)
    prune(study, config, 0.3)
    found = importances(study)
    assert next(iter(found)) == "learning_rate"
    assert sum(found.values()) == pytest.approx(1)
    assert importances(study) == found  # nothing random
    page = report_html(study, config)
    assert "of 40 complete trials (PED-ANOVA" in page
    assert re.findall("<h3>(.*?)</h3>", page) == list(found)


@pytest.mark.slow
@pytest.mark.parametrize("values", [[], [0.5], [0.5, 0.5, 0.5]])
def test_without_two_different_values_no_importance_is_made_up(values):
    config, study = study_config(), new_study()
    for value in values:
        complete(study, config, value)
    assert importances(study) == {}
    trials = f"{len(values)} complete trial{'' if len(values) == 1 else 's'}"
    assert f"This needs values that differ; so far: {trials}." in texts_of(study, config).text


# Figures.


def test_a_long_choice_is_shortened_where_there_is_no_room():
    space = {
        **SPACE,
        "policy": {"choice": ["MlpPolicy", "sb3_piano.policies.RegularizedSACPolicy"]},
    }
    config, study = study_config(space=space), new_study()
    for value in (0.1, 0.2, 0.3, 0.4):
        complete(study, config, value)
    figure = study_figures(study, "F1")["parallel"]
    texts = [annotation.text for annotation in figure.layout.annotations]
    assert "…ularizedSACPolicy" in texts
    assert max(map(len, texts)) == 18


# Studies of every kind.


def figures_in(page):
    return re.findall(r'<div id="([\w-]+)" class="plotly-graph-div"', page)


ALL = ["history", "importance", "reports", "timeline", "parallel"]


def add(study, value, params, distributions):
    study.add_trial(optuna.create_trial(value=value, params=params, distributions=distributions))


def with_conditional(study, config):
    """One trial has fewer parameters than the others."""
    distributions = {"batch_size": config.space.distributions["batch_size"]}
    add(study, 0.2, {"batch_size": 64}, distributions)
    for value in (0.1, 0.25, 0.35):
        complete(study, config, value)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fill", "space", "expected"),
    [
        (lambda s, c: None, SPACE, []),
        (lambda s, c: begin(s, c), SPACE, ["timeline"]),
        (lambda s, c: prune(s, c, 0.5), SPACE, ["reports", "timeline"]),
        (
            lambda s, c: complete(s, c, 0.5),
            SPACE,
            ["history", "reports", "timeline", "parallel", *(f"slice-{n}" for n in range(1, 5))],
        ),
        (
            lambda s, c: [complete(s, c, value / 40) for value in range(40)],
            {"tau": {"float": [0.001, 0.1]}},
            [*ALL, "slice-1"],
        ),
        (
            lambda s, c: [complete(s, c, value / 40) for value in range(40)],
            {"train_freq": {"choice": [1, 2, [1, "episode"]]}},
            [*ALL, "slice-1"],
        ),
        (with_conditional, SPACE, [*ALL, *(f"slice-{n}" for n in range(1, 5))]),
    ],
    ids=[
        *("empty", "running", "pruned", "one", "one number", "one choice", "conditional"),
    ],
)
def test_every_study_has_the_figures_for_which_there_is_something(fill, space, expected):
    config, study = study_config(space=space), new_study()
    fill(study, config)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        page = report_html(study, config)
    assert figures_in(page) == expected


# In a browser.


@pytest.fixture
def opened(tab, tmp_path):
    """Return a function that opens the report of a study, and returns the page."""

    def open_page(study, config):
        tab.open(write_report(study, config, StudyFolder(tmp_path)))
        return tab.page

    return open_page


POINTS = "node => node.querySelectorAll('.scatterlayer .point').length"
LINES = "node => node.querySelectorAll('.scatterlayer .js-line').length"
BARS = "node => node.querySelectorAll('.barlayer .point path').length"


@pytest.mark.slow
def test_all_figures_are_drawn_with_all_their_trials(opened, tmp_path):
    config = study_config()
    study = finished_study(config)
    page = opened(study, config)
    assert (tmp_path / "report.html").is_file()
    assert page.title() == "sac_twinkle · sb3-piano"
    assert page.eval_on_selector("#history", POINTS) == 24
    assert page.eval_on_selector("#importance", BARS) == 4
    assert page.eval_on_selector("#reports", LINES) >= 24
    assert page.eval_on_selector("#timeline", BARS) == len(study.trials)
    assert page.eval_on_selector("#parallel", LINES) == 24
    assert page.eval_on_selector_all("[id^=slice-]", f"f => f.map({POINTS})") == [24] * 4
    legend = page.eval_on_selector("#timeline .legend", "node => node.textContent")
    for state in ("complete", "pruned", "failed", "running", "waiting"):
        assert state in legend
    legend = page.eval_on_selector("#history .legend", "node => node.textContent")
    for name in ("final F1", "best so far", "preset"):
        assert name in legend


@pytest.mark.slow
@pytest.mark.parametrize("tab", [PHONE], indirect=True)
def test_on_a_phone_only_tables_and_the_lines_are_scrolled(opened, tab):
    space = {**SPACE, **{f"env_kwargs.reward_weights.{name}": {"float": [0.1, 2.0]}
                         for name in ("energy", "fingering", "key_press", "sustain")}}  # fmt: skip
    config = study_config(space=space)
    page = opened(finished_study(config), config)
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    assert tab.right_edge("main *:not(svg *):not(.wide *)") <= 390
    assert page.eval_on_selector("#parallel", "node => node.clientWidth") >= 9 * 100


@pytest.mark.slow
def test_names_and_reasons_like_scripts_do_nothing(opened):
    space = {**SPACE, "policy_kwargs.net_arch": {"choice": {EVIL: [16], "other": [32]}}}
    config, study = study_config(space=space), new_study(EVIL)
    for value in (0.1, 0.2, 0.3, 0.4):
        complete(study, config, value, origin=EVIL)
    fail(study, config, EVIL, host=EVIL)
    add(study, 0.5, {EVIL: 0.5}, {EVIL: FloatDistribution(0, 1)})
    page = opened(study, config)
    assert page.locator("h1").inner_text() == EVIL
    assert page.locator("main img").count() == 0
    page.locator("#timeline .barlayer .point").first.hover(force=True)
    assert html.escape(EVIL) in Path(page.url.removeprefix("file://")).read_text(encoding="utf-8")
