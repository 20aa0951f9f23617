"""The files of a study, whatever it holds: the best settings, the table, the page."""

from __future__ import annotations

import csv
import html
import re
import shlex
import warnings

import optuna
import pytest
import torch
import yaml
from browser_tab import PHONE
from finished_study import (
    CONFIG,
    ENTRY,
    ENV_ID,
    SPACE,
    begin,
    complete,
    complete_preset,
    fail,
    finished_study,
    lose,
    new_study,
    prune,
    study_config,
)
from fresh_python import run_python
from html_page import Page
from optuna.distributions import FloatDistribution
from stable_baselines3 import SAC

from sb3_piano.cli import main
from sb3_piano.training.configuration.entries import zoo_entry
from sb3_piano.tuning.report import write_best, write_report, write_table
from sb3_piano.tuning.study import StudyFolder

EVIL = "<script>alert(1)</script><img src=x onerror=alert(2)>"


@pytest.fixture
def folder(tmp_path):
    place = tmp_path / "a study"
    place.mkdir()
    return StudyFolder(place)


# The best settings.


def test_the_file_of_the_best_settings_has_them_in_the_entrys_order(folder):
    study = finished_study()
    write_best(study, CONFIG, folder)
    ((name, found),) = yaml.safe_load(folder.best_file.read_text()).items()
    best = CONFIG.space.settings(study.best_trial.params)
    assert name == ENV_ID
    assert list(found) == list(ENTRY)
    assert found == {
        **zoo_entry("sac", ENV_ID, ENTRY)[0],
        **{name: best[name] for name in ("learning_rate", "gamma", "batch_size")},
        "policy_kwargs": {"net_arch": best["policy_kwargs.net_arch"]},
    }
    assert found["learning_rate"] != 0.001
    assert not list(folder.path.glob("*.partial"))


def test_its_head_says_where_the_settings_come_from(folder):
    config = study_config(seeds=(3, 4), metric="onset_f1", objective="best")
    study = new_study("etudes")
    write_best(study, config, folder)
    assert not folder.best_file.exists()
    for value in (0.125, 0.375, 0.25):
        complete(study, value, config)
    write_best(study, config, folder)
    head = folder.best_file.read_text().split(f"\n{ENV_ID}")[0]
    for text in (
        "# Trial 1, the best of 3 of the study 'etudes': best onset_f1 0.375, from the seeds",
        "compare with the preset, before you believe it",
        f"# sb3-piano train --algo sac --env {ENV_ID} --config '{folder.best_file}'",
    ):
        assert text in head


def episodes_in(folder):
    """Return what Monitor wrote of each episode, without the time."""
    (file,) = folder.glob("*.monitor.csv")
    rows = csv.DictReader(file.read_text().splitlines()[1:])
    return [{name: float(text) for name, text in row.items() if name != "t"} for row in rows]


@pytest.mark.slow
def test_sac_has_the_same_first_500_steps_in_ours_and_in_the_stock_zoo(folder, tmp_path):
    judging = {"sb3_piano.callbacks.F1Callback": {"eval_freq": 450}}
    config, study = study_config({**ENTRY, "n_timesteps": 500, "callback": [judging]}), new_study()
    for value in (0.4, 0.5):
        complete(study, value, config)
    write_best(study, config, folder)
    ours_in_it, theirs_in_it = (
        shlex.split(command)
        for command in re.findall(
            "^# ((?:sb3-piano|python -m) .*)", folder.best_file.read_text(), re.MULTILINE
        )
    )
    ours, more = tmp_path / "ours", ["--seed", "0", "--no-progress", "--out"]
    assert main([*ours_in_it[1:], *more, str(ours)]) == 0
    zoo = [*theirs_in_it[1:], "--seed", "0", "--eval-freq", "-1"]
    done = run_python([*zoo, "--log-folder", str(tmp_path / "zoo")], tmp_path)
    assert done.returncode == 0, done.stderr
    (theirs,) = (tmp_path / "zoo").glob("*/*_1")
    # But for rounding: our updates leave out what changes nothing.
    episodes, expected = episodes_in(ours / "monitor"), episodes_in(theirs)
    assert episodes == [pytest.approx(row, rel=1e-3) for row in expected]
    assert len({row["r"] for row in episodes}) >= 3  # learned something, or explored
    trained, other = (
        SAC.load(file, device="cpu") for file in (ours / "model.zip", theirs / f"{ENV_ID}.zip")
    )
    weights = trained.policy.state_dict()
    for name, expected in other.policy.state_dict().items():
        torch.testing.assert_close(weights[name], expected, rtol=1e-3, atol=1e-3, msg=name)
    best = config.space.settings(study.best_trial.params)
    assert (trained.gamma, trained.batch_size) == (best["gamma"], best["batch_size"])
    assert (trained.num_timesteps, trained._n_updates) == (500, 100)


# The table.


def rows_of(study, folder):
    write_table(study, CONFIG, folder)
    return list(csv.DictReader(folder.table_file.read_text(encoding="utf-8").splitlines()))


def test_a_row_holds_what_a_trial_scored_took_and_had_as_settings(folder):
    study = new_study()
    assert rows_of(study, folder) == []
    complete(study, 0.25)
    (row,) = rows_of(study, folder)
    settings = CONFIG.space.settings(study.trials[0].params)
    assert float(row.pop("learning_rate")) == settings["learning_rate"]
    assert float(row.pop("gamma")) == settings["gamma"] > 0.5  # not its distance from 1
    assert int(row.pop("batch_size")) == settings["batch_size"]
    assert row.pop("policy_kwargs.net_arch") == str(settings["policy_kwargs.net_arch"])
    assert 0 <= float(row.pop("seconds")) < 60
    assert row == {
        **{"number": "0", "state": "complete", "value": "0.25", "final_f1": "0.25"},
        **{"best_f1": "0.26", "final_onset_f1": "0.125", "best_onset_f1": "0.135"},
        **{"steps": "1000", "origin": "", "failure": "", "host": "here"},
        "folder": "study/trials/0",
    }


def test_states_reasons_and_origins_are_told(folder):
    study = new_study()
    complete_preset(study, 0.5)
    prune(study, 0.125)
    fail(study, 'RuntimeError: "nan",\nagain')
    fail(study)
    lose(study)
    begin(study)
    study.ask()  # has no settings yet
    study.enqueue_trial({"batch_size": 64})
    rows = rows_of(study, folder)
    assert [(row["number"], row["state"], row["value"], row["origin"]) for row in rows] == [
        ("0", "complete", "0.5", "preset"),
        ("1", "pruned", "0.125", ""),
        ("2", "failed", "", ""),
        ("3", "failed", "", ""),
        ("4", "repeated", "", ""),
        ("5", "running", "", ""),
        ("6", "running", "", ""),
        ("7", "waiting", "", ""),
    ]
    assert "nan" in rows[2]["failure"]
    assert "killed" in rows[3]["failure"]
    assert rows[0]["gamma"] == "0.8"
    assert rows[4]["gamma"] == rows[5]["gamma"] != rows[6]["gamma"] == ""


# The page.


def page_of(study, config, folder):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        write_report(study, config, folder)
    return folder.report_file.read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_page_counts_trials_and_compares_the_best_settings_with_the_presets(folder):
    space = {**SPACE, "target_entropy": {"float": [-40.0, -10.0]}}
    config, study = study_config(space=space), new_study("evenings")
    complete_preset(study, 0.25, config)
    complete(study, 0.5, config)
    prune(study, 0.9, config)
    fail(study, f"RuntimeError: {EVIL}", config)
    fail(study, None, config)
    lose(study, config)
    begin(study, config)  # what was lost
    study.enqueue_trial({})
    page = Page(page_of(study, config, folder))
    for text in (
        *("Study of SAC", "TwinkleTwinkleLittleStar", "evenings", "train with other seeds"),
        "7 trials: 2 complete, 1 pruned, 2 failed, 1 running, 1 waiting.",
        "The best value is 0.500, of trial 1; the preset's is 0.250. 1 interrupted trial not coun",
        "final f1, mean of the seeds 0, in evaluations of 1 from seed 1000",
        f"--config '{folder.best_file}'",
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
        ["target_entropy", f"{best['target_entropy']:.4g}", "\N{EN DASH}"],
    ]
    _, reason, killed = page.tables[2]
    assert reason == ["3", f"RuntimeError: {EVIL}"]
    assert (killed[0], "killed" in killed[1]) == ("4", True)
    folder.journal_file.touch()
    assert f"optuna-dashboard '{folder.journal_file}'" in Page(page_of(study, config, folder)).text


@pytest.mark.slow
def test_the_ten_best_complete_trials_are_listed_the_best_first(folder):
    study = new_study()
    for value in [0.1, 0.5, 0.3, 0.7, 0.2, 0.0, 0.9, 0.4, 0.8, 0.6, 0.7, 0.05]:
        complete(study, value)
    prune(study, 0.99)
    heads, *rows = Page(page_of(study, CONFIG, folder)).tables[1]
    assert heads[:3] == ["trial", "value", "final f1"]
    assert [row[0] for row in rows] == ["6", "8", "3", "10", "9", "1", "7", "2", "4", "0"]
    assert rows[0][1:6] == ["0.900", "0.9", "0.45", "0.91", "0.46"]
    settings = CONFIG.space.settings(study.trials[6].params)
    assert rows[0][heads.index("gamma")] == f"{settings['gamma']:.4g}"


def with_fewer_parameters(study, config):
    """One trial has fewer parameters than the others."""
    distributions = {"batch_size": config.space.distributions["batch_size"]}
    params = {"batch_size": 64}
    study.add_trial(optuna.create_trial(value=0.2, params=params, distributions=distributions))
    for value in (0.1, 0.25, 0.35):
        complete(study, value, config)


def forty(study, config):
    for value in range(40):
        complete(study, value / 40, config)


ALL = ["history", "importance", "reports", "timeline", "parallel"]
ONE = [name for name in ALL if name != "importance"]
SLICES = [f"slice-{number}" for number in range(1, 5)]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fill", "space", "expected"),
    [
        (lambda study, config: None, SPACE, []),
        (lambda study, config: begin(study, config), SPACE, []),
        (lambda study, config: complete(study, 0.5, config), SPACE, [*ONE, *SLICES]),
        (
            lambda study, config: [complete(study, 0.5, config) for _ in range(3)],
            SPACE,
            [*ONE, *SLICES],  # no importance is made up
        ),
        (forty, {"tau": {"float": [0.001, 0.1]}}, [*ALL, "slice-1"]),
        (forty, {"train_freq": {"choice": [1, 2, [1, "episode"]]}}, [*ALL, "slice-1"]),
        (with_fewer_parameters, SPACE, [*ALL, *SLICES]),
    ],
    ids=["empty", "running", "one", "equal", "one number", "one choice", "fewer"],
)
def test_every_study_has_the_figures_for_which_there_is_something(fill, space, expected, folder):
    config, study = study_config(space=space), new_study()
    fill(study, config)
    page = page_of(study, config, folder)
    assert re.findall(r'<div id="([\w-]+)" class="plotly-graph-div"', page) == expected


@pytest.fixture
def opened(tab, folder):
    """Return a function that opens the report of a study in a browser, and returns the page."""

    def open_page(study, config=CONFIG):
        write_report(study, config, folder)
        tab.open(folder.report_file)
        return tab.page

    return open_page


POINTS = "node => node.querySelectorAll('.scatterlayer .point').length"
LINES = "node => node.querySelectorAll('.scatterlayer .js-line').length"
BARS = "node => node.querySelectorAll('.barlayer .point path').length"


@pytest.mark.slow
def test_all_figures_are_drawn_with_all_their_trials(opened):
    study = finished_study()
    page = opened(study)
    assert page.title() == "sac_twinkle · sb3-piano"
    assert page.eval_on_selector("#history", POINTS) == 24
    assert page.eval_on_selector("#importance", BARS) == 4
    names = page.eval_on_selector("#importance .yaxislayer-above", "node => node.textContent")
    assert names.endswith("learning_rate")  # which alone decides, is on top
    assert page.eval_on_selector("#reports", LINES) >= 24
    assert page.eval_on_selector("#timeline", BARS) == len(study.trials)
    assert page.eval_on_selector("#parallel", LINES) == 24
    assert page.eval_on_selector_all("[id^=slice-]", f"f => f.map({POINTS})") == [24] * 4


@pytest.mark.slow
@pytest.mark.parametrize("tab", [PHONE], indirect=True)
def test_on_a_phone_only_tables_and_figures_are_scrolled(opened, tab):
    weights = ("energy", "fingering", "key_press", "sustain")
    more = {f"env_kwargs.reward_weights.{name}": {"float": [0.1, 2.0]} for name in weights}
    config = study_config(space={**SPACE, **more})
    page = opened(finished_study(config), config)
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    assert tab.right_edge("main *:not(svg *):not(.wide *)") <= 390
    assert page.eval_on_selector("#parallel", "node => node.clientWidth") >= 9 * 100


@pytest.mark.slow
def test_names_and_reasons_like_scripts_do_nothing(opened, folder):
    space = {**SPACE, "policy_kwargs.net_arch": {"choice": {EVIL: [16], "other": [32]}}}
    config, study = study_config(space=space), new_study(EVIL)
    for value in (0.1, 0.2, 0.3, 0.4):
        complete(study, value, config, origin=EVIL, host=EVIL)
    fail(study, EVIL, config)
    distributions = {EVIL: FloatDistribution(0, 1)}
    study.add_trial(optuna.create_trial(value=0.5, params={EVIL: 0.5}, distributions=distributions))
    page = opened(study, config)
    assert page.locator("h1").inner_text() == EVIL
    assert page.locator("main img").count() == 0
    page.locator("#timeline .barlayer .point").first.hover(force=True)
    assert html.escape(EVIL) in folder.report_file.read_text(encoding="utf-8")
