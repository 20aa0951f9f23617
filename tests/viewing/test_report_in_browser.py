"""The report in a real browser without a network: it draws, answers the mouse, fits a phone."""

import numpy as np
import pytest
from browser_tab import PHONE, Tab
from report_parts import C4, E4, long_performance, metrics_of, resting, three_notes
from short_scores import score_of
from yaml_rows import Tables

from sb3_piano.viewing.report import Curve, Report, report_html, score_html

pytestmark = pytest.mark.slow

tables = Tables(__file__)
PLACE, MARKS = tables["place"], tables["marks"]
VIEW = "document.getElementById('piano-roll').layout.xaxis.range"
TRACES = "document.getElementById('piano-roll').data"


class Roll:
    """The piano roll of the page that is open in a tab."""

    def __init__(self, tab):
        self.page = tab.page

    def count(self, mark):
        return self.page.evaluate(MARKS, mark)

    def view(self):
        return self.page.evaluate(VIEW)

    def point_at(self, second, key):
        """Return the text that appears."""
        self.page.mouse.move(2, 2)
        self.page.mouse.move(*self.page.evaluate(PLACE, [second, key]))
        shown = self.page.locator("#piano-roll .hoverlayer .hovertext")
        shown.wait_for()
        return " ".join(shown.all_text_contents())


@pytest.fixture
def roll(tab):
    return Roll(tab)


def written(path, played, **changes):
    steps = np.arange(20) * 100
    curve = Curve(steps, np.linspace(0.0, 0.6, 20))
    names = ("music/f1", "music/onset_f1", "rollout/ep_rew_mean", "reward/key_press")
    settings = {"baseline": metrics_of(resting(played)), "curves": dict.fromkeys(names, curve)}
    report = Report(performance=played, metrics=metrics_of(played), **{**settings, **changes})
    path.write_text(report_html(report), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def shared(browser, tmp_path_factory):
    """A tab with the page of C4 hit, D4 missed, E4 struck late, F4 wrong; the pedal once."""
    page = browser.new_page(offline=True, viewport={"width": 1200, "height": 1000})
    opened = Tab(page)
    opened.open(written(tmp_path_factory.mktemp("page") / "report.html", three_notes()))
    yield opened
    page.close()


@pytest.fixture
def three_notes_tab(shared):
    yield shared
    assert shared.complaints == []


def test_all_figures_are_drawn_with_all_their_marks(three_notes_tab):
    tab, roll = three_notes_tab, Roll(three_notes_tab)
    ids = tab.page.eval_on_selector_all(".plotly-graph-div", "nodes => nodes.map(n => n.id)")
    training = [f"training-{number}" for number in (1, 2, 3, 4)]
    assert ids == ["piano-roll", "finger-usage", "reward-terms", *training]
    expected = {"hit": 1, "late": 1, "wrong": 1, "early": 0, "missed": 2, "pedal": 3}
    expected |= {"due-thumb": 1, "due-index-finger": 1, "due-middle-finger": 1}
    assert {mark: roll.count(mark) for mark in expected} == expected
    bars = "node => node.querySelectorAll('.barlayer .point path').length"
    assert tab.page.eval_on_selector("#finger-usage", bars) == 20  # ten fingers, due and played
    assert tab.page.eval_on_selector("#reward-terms", bars) == 4  # two terms, both with baseline
    lines = "node => node.querySelectorAll('.scatterlayer .js-line').length"
    assert tab.page.eval_on_selector("#training-1", lines) == 2
    assert tab.page.title() == "study · sb3-piano"


def test_pointing_at_a_bar_shows_pitch_finger_onsets_error_and_result(three_notes_tab):
    roll = Roll(three_notes_tab)
    hit = roll.point_at(0.8, C4)
    for text in (
        *("C4", "hit", "finger due: right thumb", "finger nearest: right index"),
        *("onset due: 0.500 s", "onset played: 0.520 s", "error: +20 ms"),
    ):
        assert text in hit
    assert "missed, struck late" in roll.point_at(1.8, E4)


def test_the_page_of_a_piece_shows_its_notes_their_fingers_and_the_pedal(tab, roll, tmp_path):
    notes = (0.5, 1.0, 60, 0), (1.0, 1.5, 64, 7), (2.0, 2.25, 67)
    score = score_of(*notes, pedals=[(0.5, 1.5)], title="<b>A piece</b>")
    page = tmp_path / "piece.html"
    page.write_text(score_html(score, [("Composer", "nobody & co")]), encoding="utf-8")
    tab.open(page)
    expected = {"due-thumb": 1, "due-middle-finger": 1, "due-any-finger": 1, "pedal": 1, "hit": 0}
    assert {mark: roll.count(mark) for mark in expected} == expected
    (pedal,) = (trace for trace in tab.page.evaluate(TRACES) if trace["meta"] == "pedal")
    assert (pedal["base"], pedal["x"]) == ([0.5], [1.0])
    shown = roll.point_at(1.2, 64 - 21)
    for text in ("E4", "left hand", "finger: left middle", "onset: 1.000 s", "offset: 1.500 s"):
        assert text in shown
    bars = "node => node.querySelectorAll('.barlayer .point path').length"
    assert tab.page.eval_on_selector("#finger-usage", bars) == 10
    assert tab.page.locator("h1").text_content() == "<b>A piece</b>"
    assert "nobody & co" in tab.page.locator("main").text_content()
    tab.page.locator("button[data-mark=due-thumb]").click()
    assert roll.count("due-thumb") == 0


def test_marks_are_hidden_and_shown_by_the_legend(three_notes_tab):
    tab, roll = three_notes_tab, Roll(three_notes_tab)
    for mark, count in (("wrong", 1), ("missed", 2), ("due-thumb", 1)):
        button = tab.page.locator(f"button[data-mark={mark}]")
        button.click()
        assert button.get_attribute("aria-pressed") == "false"
        assert roll.count(mark) == 0
        assert roll.count("hit") == 1
        button.click()
        assert button.get_attribute("aria-pressed") == "true"
        assert roll.count(mark) == count
    for _ in range(2):
        tab.page.locator("button[data-mark=early]").click()  # there is none: nothing happens
        assert roll.count("hit") == 1


def test_a_long_piece_is_walked_through_by_buttons_and_by_dragging(tab, roll, tmp_path):
    played = long_performance(260)
    end = played.roll.duration
    tab.open(written(tmp_path / "long.html", played, curves={}))
    due = sum(roll.count(f"due-{name}") for name in (
        *("thumb", "index-finger", "middle-finger", "ring-finger", "little-finger"), "any-finger"
    ))  # fmt: skip
    assert due == len(played.roll.onset_time)

    def press(view):
        tab.page.click(f"button[data-view={view}]")
        return roll.view()

    first, last = roll.view()
    assert first <= 0 < last < 30
    low, high = press("later")
    assert high - low == pytest.approx(last - first)
    assert first < low < last < high
    for _ in range(2):  # there is nothing before
        assert press("earlier") == pytest.approx([first, last])
    for view, share in (("closer", 0.5), ("wider", 1.0)):
        low, high = press(view)
        assert high - low == pytest.approx(share * (last - first))
    low, high = press("all")
    assert low <= 0 < end <= high
    assert press("later") == pytest.approx([low, high])
    for _ in range(3):
        low, high = press("closer")
    tab.page.locator("#piano-roll").scroll_into_view_if_needed()
    x, y = tab.page.evaluate(PLACE, [(low + high) / 2, 40])
    tab.page.mouse.move(x, y)
    tab.page.mouse.down()
    tab.page.mouse.move(x - 200, y, steps=4)
    tab.page.mouse.up()
    moved = roll.view()
    assert moved[0] > low
    assert moved[1] - moved[0] == pytest.approx(high - low)


@pytest.mark.parametrize("tab", [PHONE], indirect=True)
def test_on_a_phone_nothing_is_wider_than_the_screen_and_fingers_scroll_the_page(
    tab, roll, tmp_path
):
    settings = {"facts": [("run", "x" * 300)], "curves": {}}
    tab.open(written(tmp_path / "long.html", long_performance(260), **settings))
    assert tab.page.evaluate("document.documentElement.scrollWidth") == 390
    assert tab.page.evaluate("innerWidth") == 390
    assert tab.right_edge("main *:not(svg *)") <= 390
    first, last = roll.view()
    assert last - first < 9  # of the 24 s that a wide screen shows
    assert tab.page.evaluate("document.getElementById('piano-roll').layout.dragmode") is False
    tab.page.tap("button[data-view=later]")
    assert roll.view()[0] > first
