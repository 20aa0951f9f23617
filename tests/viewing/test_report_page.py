"""The report's page: all that it should say, harmless, and in need of nothing else."""

import dataclasses
import re

import numpy as np
import pytest
from html_page import Page
from report_parts import C4, E4, STEP, metrics_of, note, performance, resting, three_notes
from short_scores import score_of
from yaml_rows import Tables

from sb3_piano.metrics.episode import FINGER_SHARES, has_value
from sb3_piano.music import PianoRoll
from sb3_piano.viewing.report import Curve, Report, report_html
from sb3_piano.viewing.report.page import definition_of, formatted

tables = Tables(__file__)

NONE = "\N{EN DASH}"

EVIL = '<script>alert(1)</script> & "it\'s" <b>'


def report(played=None, **changes):
    played = three_notes() if played is None else played
    settings = {"metrics": metrics_of(played), "baseline": metrics_of(resting(played)), **changes}
    return Report(performance=played, **settings)


def curves(*names):
    return {name: Curve(np.arange(3) * 100, np.array([0.1, 0.2, 0.3])) for name in names}


@pytest.fixture(scope="module")
def full():
    """The HTML of a report of all there may be."""
    origin = {"facts": [("Physics", "fast")], "subtitle": "TD3 after 700 steps of training"}
    commands = [("This report", "sb3-piano report runs/x")]
    drawn = curves("music/f1", "rollout/ep_rew_mean")
    return report_html(report(**origin, commands=commands, curves=drawn))


def test_the_page_says_who_played_what_and_how_well_and_explains_each_mark(full):
    page = Page(full)
    for text in (*tables["told"], *tables["legend"]):
        assert text in page.text
    marks = [a["data-mark"] for tag, a in page.elements if tag == "button" and "data-mark" in a]
    assert marks == [
        *("hit", "early", "late", "again", "wrong"),
        *("missed", "due-thumb", "due-index-finger", "due-middle-finger"),
    ]
    assert ("title", {}) in page.elements
    assert "study · sb3-piano" in page.text


def test_each_number_stands_beside_what_playing_nothing_scores_and_what_it_means():
    made = report()
    text = Page(report_html(made)).text
    timing = ("onset_error_mean_ms", "onset_error_std_ms")
    for name, value in made.metrics.items():
        if name in FINGER_SHARES:
            continue
        known = definition_of(name)
        is_empty = name in timing or not has_value(name, made.baseline)
        nothing = NONE if is_empty else formatted(name, made.baseline[name])
        row = f"{known.label} {formatted(name, value)} {nothing} {known.meaning}"
        assert row.replace("\N{NO-BREAK SPACE}", " ") in text, name
    alone = Page(report_html(report(baseline=None))).text
    assert alone.count("playing nothing") == 1  # what the no-op F1 is
    assert f"F1 {formatted('f1', made.metrics['f1'])} Frame F1" in alone


def test_musicianship_stands_there_if_the_score_is_known():
    score = score_of((0.0, 1.0, 60, 0), (0.0, 1.0, 64, 2), title="third")
    presses = [(C4, 0.01, 0.8, 0), (E4, 0.02, 0.8, 2)]
    played = performance([], presses, roll=PianoRoll.from_score(score, STEP))
    assert "chord spread" not in Page(report_html(report(played))).text.lower()
    text = Page(report_html(report(dataclasses.replace(played, score=score)))).text
    assert f"Chord spread 10.0 ms {NONE} Time between" in text.replace("\N{NO-BREAK SPACE}", " ")
    assert f"Order in chords {NONE} {NONE}" in text, "both are due at one time"


def test_what_did_not_happen_is_told_in_words_and_dashes():
    played = three_notes()
    metrics = metrics_of(played)
    nothing_of = {name: value for name, value in metrics.items() if name != "length"}
    html = report_html(report(played, metrics={**metrics, "onset_recall": 0.0}, baseline=None))
    assert f"Mean timing error {NONE} How late" in Page(html).text
    assert "The episode ended" not in Page(html).text
    resting_html = report_html(report(played, metrics=metrics, baseline=nothing_of))
    assert f"Control steps 41 {NONE} How long" in Page(resting_html).text
    short = performance([note(C4, 0.0, 0.5), note(C4, 1.0, 1.5)], [], steps=12, title="")
    text = Page(report_html(report(short))).text
    assert "untitled" in text
    assert "0 of 2 notes hit within 50 ms; 0 strikes too early or too late; 0 wrong" in text
    assert "The episode ended before 1 of the notes." in text
    assert "not reached 1" in text


@tables("name, value, label, text")
def test_labels_begin_a_line_and_numbers_are_rounded(name, value, label, text):
    assert definition_of(name).label == label
    assert formatted(name, value) == text


def test_names_are_text_whatever_they_hold():
    played = three_notes(title=EVIL)
    metrics = {**metrics_of(played), f"return_{EVIL}": 1.0}
    facts = {"subtitle": EVIL, "facts": [(EVIL, EVIL)], "commands": [(EVIL, EVIL)]}
    drawn = {"baseline": None, "curves": curves("music/f1", f"reward/{EVIL}")}
    html = report_html(report(played, metrics=metrics, **drawn, **facts))
    page = Page(html)
    assert page.text.count(EVIL) == 8  # head, heading, subtitle, row, fact and command twice each
    harmless = Page(report_html(report(baseline=None, curves=curves("music/f1", "reward/a"))))
    assert page.count("script") == harmless.count("script")
    assert page.count("b") == harmless.count("b")
    assert "<script>alert" not in html


def test_nothing_is_fetched_and_the_browser_is_told_to_refuse_it(full):
    page = Page(full)
    assert page.count("audio") == 1
    assert page.count("link") == page.count("img") == page.count("iframe") == 0
    policies = [
        attributes["content"]
        for tag, attributes in page.elements
        if tag == "meta" and attributes.get("http-equiv") == "Content-Security-Policy"
    ]
    assert len(policies) == 1
    assert "default-src 'none'" in policies[0]
    assert "http" not in policies[0]
    styles = re.findall(r"<style>(.*?)</style>", full, flags=re.DOTALL)
    assert styles
    assert "url(" not in styles[0]
    assert "@import" not in styles[0]


def test_what_is_not_there_is_left_out_or_told(full):
    full = Page(full)
    figures = {"piano-roll", "finger-usage", "reward-terms", "training-1", "training-2"}
    assert set(full.ids()) >= figures
    assert "There is no log" not in full.text
    played = three_notes()
    bare = Page(report_html(report(metrics=played.metrics(), baseline=None)))
    assert set(bare.ids()) & figures == {"piano-roll", "finger-usage"}
    assert "There is no log of the training that could be drawn." in bare.text
    assert "Normalised return" not in bare.text
