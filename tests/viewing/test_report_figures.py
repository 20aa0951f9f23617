"""What the report's figures show, bar by bar."""

from __future__ import annotations

import numpy as np
import pytest
from report_parts import C4, D4, E4, STEP, long_performance, note, performance, resting, three_notes

from sb3_piano.metrics import FINGER_SHARES
from sb3_piano.viewing.colors import FINGER_COLORS, PRESSED_COLOR
from sb3_piano.viewing.report import (
    Curve,
    finger_usage_figure,
    judge,
    note_name,
    piano_roll_figure,
    reward_terms_figure,
    training_figures,
)
from sb3_piano.viewing.report.curves import MOST_POINTS, thinned
from sb3_piano.viewing.report.theme import css_color

NONE = "\N{EN DASH}"


def piano_roll(played):
    return piano_roll_figure(played, *judge(played))


def traces(figure, meta):
    return [trace for trace in figure.data if trace.meta == meta]


def bars(figure, meta):
    """Return (key, start, end) of the bars of a mark, s."""
    return [
        (int(y), pytest.approx(base), pytest.approx(base + x))
        for trace in traces(figure, meta)
        for y, base, x in zip(trace.y, trace.base, trace.x, strict=True)
    ]


def test_keys_have_the_names_of_their_pitches():
    assert [note_name(key) for key in (0, 1, 2, 3, 39, 87)] == ["A0", "A♯0", "B0", "C1", "C4", "C8"]


def test_each_note_due_is_a_bar_outlined_in_the_colour_of_its_finger():
    figure = piano_roll(three_notes())
    assert bars(figure, "due-thumb") == [(C4, 0.5, 1.0)]
    assert bars(figure, "due-index-finger") == [(D4, 1.0, 1.5)]
    assert bars(figure, "due-middle-finger") == [(E4, 1.5, 2.0)]  # the left one's
    for meta, finger in (("due-thumb", 0), ("due-index-finger", 1), ("due-middle-finger", 7)):
        (trace,) = traces(figure, meta)
        assert trace.marker.line.color == css_color(FINGER_COLORS[finger])
    assert not traces(figure, "due-ring-finger")
    assert not traces(figure, "due-any-finger")
    unlabelled = piano_roll(performance([note(C4, 0.0, 0.5)], []))
    assert bars(unlabelled, "due-any-finger") == [(C4, 0.0, 0.5)]


def test_each_press_is_a_bar_of_its_kind():
    figure = piano_roll(three_notes())
    assert bars(figure, "hit") == [(C4, 0.52, 0.98)]
    assert bars(figure, "late") == [(E4, 1.62, 2.0)]
    assert bars(figure, "wrong") == [(E4 + 1, 0.72, 0.81)]
    assert bars(figure, "early") == bars(figure, "again") == []
    (hit,) = traces(figure, "hit")
    assert hit.marker.color == css_color(PRESSED_COLOR)
    (due,) = traces(figure, "due-thumb")
    assert hit.width < due.width
    again = performance([note(C4, 0.5, 1.0)], [(C4, 0.4, 0.6, 0), (C4, 0.8, 0.95, 0)])
    assert bars(piano_roll(again), "early") == [(C4, 0.4, 0.6)]


def test_a_missed_note_has_a_cross_at_its_onset():
    (crosses,) = traces(piano_roll(three_notes()), "missed")
    assert list(zip(crosses.x, crosses.y, strict=True)) == [(1.0, D4), (1.5, E4)]


def test_pointing_at_a_bar_tells_pitch_result_fingers_times_and_error():
    figure = piano_roll(three_notes())

    def texts(meta):
        (trace,) = traces(figure, meta)
        assert all(f"customdata[{i}]" in trace.hovertemplate for i in range(7))
        return [list(row) for row in trace.customdata]

    hit = ["C4", "hit", "right thumb", "right index", "0.500 s", "0.520 s", "+20 ms"]
    late = ["left middle", "left middle", "1.500 s", "1.620 s", "+120 ms"]
    assert texts("due-thumb") == texts("hit") == [hit]
    assert texts("due-index-finger") == [
        ["D4", "missed", "right index", NONE, "1.000 s", NONE, NONE]
    ]
    assert texts("due-middle-finger") == [["E4", "missed, struck late", *late]]
    assert texts("late") == [["E4", "late", *late]]
    assert texts("missed") == [*texts("due-index-finger"), *texts("due-middle-finger")]
    assert texts("wrong") == [["F4", "wrong", NONE, "left little", NONE, "0.720 s", NONE]]


def test_an_early_strike_and_a_note_without_a_label_are_told_as_such():
    figure = piano_roll(performance([note(C4, 0.5, 1.0)], [(C4, 0.4, 0.9, 0)]))
    (early,) = traces(figure, "early")
    assert list(early.customdata[0])[1:3] == ["early", "not said"]
    assert early.customdata[0][-1] == "-100 ms"


def test_the_pedal_has_a_row_for_what_is_due_and_one_for_what_was_played():
    rows = [
        (trace.name, int(y), pytest.approx(base), pytest.approx(base + x))
        for trace in traces(piano_roll(three_notes()), "pedal")
        for y, base, x in zip(trace.y, trace.base, trace.x, strict=True)
        if trace.yaxis == "y2"
    ]
    assert rows == [
        ("pedal due", 1, 0.5, 1.0),
        ("pedal down, as it should be", 0, 0.75, 1.0),
        ("pedal down, not due", 0, 1.0, 1.25),
    ]


def test_an_episode_that_ended_early_shows_where():
    figure = piano_roll(performance([note(C4, 0.0, 0.5, 0), note(D4, 1.0, 1.5, 1)], [], steps=12))
    assert bars(figure, "not-reached") == [(D4, 1.0, 1.5)]
    assert not traces(figure, "due-index-finger")
    (line,) = [shape for shape in figure.layout.shapes if shape.label.text]
    assert line.label.text == "the episode ended"
    assert line.x0 == line.x1 == pytest.approx(12 * STEP)
    whole = piano_roll(three_notes())
    assert not traces(whole, "not-reached")
    assert not [shape for shape in whole.layout.shapes if shape.label.text]


@pytest.mark.slow
def test_thousands_of_notes_are_few_traces_and_few_shapes():
    played = long_performance(3000)
    figure = piano_roll(played)
    assert len(figure.data) <= 16
    assert len(figure.layout.shapes) < 60
    due = [trace for trace in figure.data if str(trace.meta).startswith("due-")]
    assert sum(len(trace.x) for trace in due) == len(played.roll.onset_time)
    low, high = figure.layout.xaxis.range
    assert low <= 0 < high < 30 < played.roll.duration


def test_all_keys_that_are_used_are_in_view_and_named():
    played = performance([note(C4, 0.5, 1.0)], [(87, 0.1, 0.3, 4), (0, 0.1, 0.3, 5)])
    axis = piano_roll(played).layout.yaxis
    assert axis.range[0] < 0
    assert axis.range[1] > 87
    narrow = piano_roll(performance([note(C4, 0.5, 1.0)], [])).layout.yaxis
    assert narrow.range[0] < C4 - 5
    assert narrow.range[1] - narrow.range[0] == 13
    for layout in (axis, narrow):
        labels = dict(zip(layout.tickvals, layout.ticktext, strict=True))
        assert labels[C4] == "C4"
        assert all(note_name(key) == text for key, text in labels.items())
    assert D4 in narrow.tickvals


def test_fingers_stand_as_on_the_keyboard_beside_what_the_score_asks_for():
    """C4 sounds for 9 steps under finger 1, E4 for 7 under 7, F4 for 2 under 9; 10 steps are due
    with each of fingers 0, 1 and 7."""
    played = three_notes()
    figure = finger_usage_figure(played, played.metrics())
    asked, shown = figure.data
    assert list(shown.customdata) == [
        *("left little", "left ring", "left middle", "left index", "left thumb"),
        *("right thumb", "right index", "right middle", "right ring", "right little"),
    ]
    counts = dict(zip(shown.customdata, shown.y, strict=True))
    steps = {"right index": 9, "left middle": 7, "left little": 2}
    total = sum(steps.values())
    for name, share in counts.items():
        assert share == pytest.approx(100 * steps.get(name, 0) / total), name
    due = {name: share for name, share in zip(asked.customdata, asked.y, strict=True) if share}
    assert due == pytest.approx(
        {"left middle": 100 / 3, "right thumb": 100 / 3, "right index": 100 / 3}
    )


def test_without_a_fingering_only_what_was_played_is_drawn():
    played = performance([note(C4, 0.5, 1.0)], [(C4, 0.5, 1.0, 2)])
    (shown,) = finger_usage_figure(played, played.metrics()).data
    assert shown.name == "played"
    shares = dict.fromkeys(FINGER_SHARES, 0.0)
    (silent,) = finger_usage_figure(resting(played), shares).data
    assert set(silent.y) == {0.0}


def test_reward_terms_stand_beside_those_of_resting_hands():
    metrics = {"f1": 1.0, "return": 9.0, "return_key_press": 10.5, "return_energy": -1.25}
    figure = reward_terms_figure(
        metrics, {**metrics, "return_key_press": 4.0, "return_energy": 0.0}
    )
    played, nothing = figure.data
    assert list(played.y) == list(nothing.y) == ["Pressing keys", "Energy"]
    assert (list(played.x), list(nothing.x)) == ([10.5, -1.25], [4.0, 0.0])
    assert played.text[1] == "\N{MINUS SIGN}1.25"
    assert figure.layout.xaxis.range[0] < -1.25 < 10.5 < figure.layout.xaxis.range[1]
    (alone,) = reward_terms_figure(metrics, None).data
    assert alone.name == "played"
    assert reward_terms_figure({"f1": 1.0, "return": 2.0}, None) is None


def curve(*values):
    return Curve(np.arange(1, len(values) + 1) * 100, np.array(values))


def test_training_has_a_figure_for_each_thing_the_log_knows():
    curves = {
        "music/f1": curve(0.1, 0.2),
        "eval/f1": curve(0.3),
        "eval/mean_reward": curve(5.0, 6.0),
        "reward/energy": curve(-1.0),
        "reward/own_term": curve(2.0),
        "time/fps": curve(900.0),
    }
    figures = training_figures(curves, {"f1": 0.07, "return": 4.0})
    assert list(figures) == ["F1", "Return", "Reward terms"]
    training, evaluation, nothing = figures["F1"].data
    assert (training.name, list(training.x), list(training.y)) == (
        "training",
        [100, 200],
        [0.1, 0.2],
    )
    assert (evaluation.name, list(evaluation.y)) == ("evaluation", [0.3])
    assert (nothing.name, list(nothing.x), list(nothing.y)) == (
        "playing nothing",
        [0, 200],
        [0.07] * 2,
    )
    assert [trace.name for trace in figures["Return"].data] == ["evaluation", "playing nothing"]
    assert [trace.name for trace in figures["Reward terms"].data] == ["Energy", "Own term"]
    assert training_figures({}, None) == {}
    assert training_figures({"music/f1": Curve(np.array([]), np.array([]))}, None) == {}
    (only,) = training_figures({"music/f1": curve(0.1)}, None)["F1"].data
    assert only.name == "training"


def test_a_long_curve_is_drawn_by_means_of_neighbours():
    assert thinned(Curve(np.arange(5), np.array([1.0, 2, 4, 6, 9])), most=3)[1].tolist() == [
        1.5,
        5,
        9,
    ]
    assert thinned(Curve(np.arange(5), np.arange(5.0)), most=3)[0].tolist() == [0, 2, 4]
    short = curve(1.0, 2.0)
    assert thinned(short) is short
    long = Curve(np.arange(10_001), np.full(10_001, 0.5))
    (drawn,) = training_figures({"music/f1": long}, None)["F1"].data
    assert len(drawn.x) <= MOST_POINTS
    assert set(drawn.y) == {0.5}
