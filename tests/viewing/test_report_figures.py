"""What the report's figures are told to show, bar by bar; how they look is seen in a browser."""

import numpy as np
import pytest
from report_parts import C4, D4, E4, STEP, long_performance, note, performance, resting, three_notes
from yaml_rows import Tables

from sb3_piano.metrics.presses import wrong_presses
from sb3_piano.viewing.report import Curve
from sb3_piano.viewing.report.judgement import Fate, Verdict, judge
from sb3_piano.viewing.report.piano_roll import piano_roll
from sb3_piano.viewing.report.report import (
    MOST_POINTS,
    finger_usage,
    reward_terms,
    thinned,
    training_panels,
)

tables = Tables(__file__)

NONE = "\N{EN DASH}"


def roll_of(played):
    return piano_roll(played, *judge(played))


def bars(roll, mark):
    """Return (key, start, end) of the bars of a mark, s."""
    of = roll["bars"][mark]
    return [
        (int(key), pytest.approx(onset), pytest.approx(onset + length))
        for key, onset, length in zip(of["key"], of["onset"], of["length"], strict=True)
    ]


def test_each_note_due_is_a_bar_of_its_finger():
    roll = roll_of(three_notes())
    assert bars(roll, "due-thumb") == [(C4, 0.5, 1.0)]
    assert bars(roll, "due-index-finger") == [(D4, 1.0, 1.5)]
    assert bars(roll, "due-middle-finger") == [(E4, 1.5, 2.0)]  # the left one's
    assert not {"due-ring-finger", "due-any-finger", "not-reached"} & set(roll["bars"])
    unlabelled = roll_of(performance([note(C4, 0.0, 0.5)], []))
    assert bars(unlabelled, "due-any-finger") == [(C4, 0.0, 0.5)]


def test_each_press_is_a_bar_of_its_kind_and_a_missed_note_has_its_onset():
    roll = roll_of(three_notes())
    assert bars(roll, "hit") == [(C4, 0.52, 0.98)]
    assert bars(roll, "late") == [(E4, 1.62, 2.0)]
    assert bars(roll, "wrong") == [(E4 + 1, 0.72, 0.81)]
    assert bars(roll, "early") == bars(roll, "again") == []
    assert bars(roll, "missed") == [(D4, 1.0, 1.5), (E4, 1.5, 2.0)]
    again = performance([note(C4, 0.5, 1.0)], [(C4, 0.4, 0.6, 0), (C4, 0.8, 0.95, 0)])
    assert bars(roll_of(again), "early") == [(C4, 0.4, 0.6)]


def test_pointing_at_a_bar_tells_pitch_result_fingers_times_and_error():
    roll = roll_of(three_notes())

    def texts(mark):
        return roll["bars"][mark]["texts"]

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


def test_the_pedal_has_what_is_due_and_what_was_played_rightly_and_wrongly():
    pedal = roll_of(three_notes())["pedal"]
    expected = {"due": [0.5, 1.0], "hit": [0.75, 1.0], "wrong": [1.0, 1.25]}
    assert {row: spans.tolist() for row, spans in pedal.items()} == {
        row: [pytest.approx(span)] for row, span in expected.items()
    }


def test_an_episode_that_ended_early_shows_where():
    roll = roll_of(performance([note(C4, 0.0, 0.5, 0), note(D4, 1.0, 1.5, 1)], [], steps=12))
    assert bars(roll, "not-reached") == [(D4, 1.0, 1.5)]
    assert "due-index-finger" not in roll["bars"]
    assert roll["end"] == pytest.approx(12 * STEP)
    assert roll_of(three_notes())["end"] is None


def test_fingers_stand_as_on_the_keyboard_beside_what_the_score_asks_for():
    """C4 sounds for 9 steps under finger 1, E4 for 7 under 7, F4 for 2 under 9; 10 steps are due
    with each of fingers 0, 1 and 7."""
    played = three_notes()
    shown = finger_usage(played, played.metrics())
    assert shown["name"] == [
        *("left little", "left ring", "left middle", "left index", "left thumb"),
        *("right thumb", "right index", "right middle", "right ring", "right little"),
    ]
    steps = {"right index": 9, "left middle": 7, "left little": 2}
    for name, share in zip(shown["name"], shown["played"], strict=True):
        assert share == pytest.approx(100 * steps.get(name, 0) / sum(steps.values())), name
    due = {name: share for name, share in zip(shown["name"], shown["due"], strict=True) if share}
    assert due == pytest.approx(
        {"left middle": 100 / 3, "right thumb": 100 / 3, "right index": 100 / 3}
    )


def test_reward_terms_stand_beside_those_of_resting_hands():
    metrics = {"f1": 1.0, "return": 9.0, "return_key_press": 10.5, "return_energy": -1.25}
    nothing = {**metrics, "return_key_press": 4.0, "return_energy": 0.0}
    shown = reward_terms(metrics, nothing)
    assert shown["terms"] == ["Pressing keys", "Energy"]
    assert [(row["name"], row["sums"]) for row in shown["rows"]] == [
        ("played", [10.5, -1.25]),
        ("playing nothing", [4.0, 0.0]),
    ]
    assert shown["rows"][0]["texts"][1] == "\N{MINUS SIGN}1.25"
    assert [row["name"] for row in reward_terms(metrics, None)["rows"]] == ["played"]
    assert reward_terms({"f1": 1.0, "return": 2.0}, None) is None


def curve(*values):
    return Curve(np.arange(1, len(values) + 1) * 100, np.array(values))


def test_training_has_a_panel_for_each_thing_the_log_knows():
    curves = {
        "music/f1": curve(0.1, 0.2),
        "eval/f1": curve(0.3),
        "eval/mean_reward": curve(5.0, 6.0),
        "reward/energy": curve(-1.0),
        "reward/own_term": curve(2.0),
        "time/fps": curve(900.0),
    }
    f1, returns, rewards = training_panels(curves, {"f1": 0.07, "return": 4.0})
    assert [panel["title"] for panel in (f1, returns, rewards)] == ["F1", "Return", "Reward terms"]
    assert [panel["level"] for panel in (f1, returns, rewards)] == [0.07, 4.0, None]
    assert [panel["share"] for panel in (f1, returns, rewards)] == [True, False, False]
    lines = [(line["name"], list(line["x"]), list(line["y"])) for line in f1["lines"]]
    assert lines == [("training", [100, 200], [0.1, 0.2]), ("evaluation", [100], [0.3])]
    assert [line["name"] for line in returns["lines"]] == ["evaluation"]
    assert [line["name"] for line in rewards["lines"]] == ["Energy", "Own term"]
    assert training_panels({}, None) == []
    assert training_panels({"music/f1": Curve(np.array([]), np.array([]))}, None) == []
    assert training_panels({"music/f1": curve(0.1)}, None)[0]["level"] is None


def test_a_long_curve_is_drawn_by_means_of_neighbours():
    thin = thinned(Curve(np.arange(5), np.array([1.0, 2, 4, 6, 9])), most=3)
    assert (thin.steps.tolist(), thin.values.tolist()) == ([0, 2, 4], [1.5, 5, 9])
    short = curve(1.0, 2.0)
    assert thinned(short) is short
    long = Curve(np.arange(10_001), np.full(10_001, 0.5))
    ((drawn,),) = [panel["lines"] for panel in training_panels({"music/f1": long}, None)]
    assert len(drawn["x"]) <= MOST_POINTS
    assert set(drawn["y"]) == {0.5}


# Which notes the report calls hit, and what it calls each press.


HIT, MISSED, NOT_REACHED = Fate
RIGHT, _, LATE, AGAIN, WRONG = Verdict


@tables("presses, fate, verdicts")
def test_a_note_due_from_half_a_second_to_one_is_judged_by_its_strikes(presses, fate, verdicts):
    played = performance([note(C4, 0.5, 1.0), note(D4 + 9, 1.5, 2.0)], presses)
    notes, judged = judge(played)
    assert notes.fate.tolist() == [Fate[fate], MISSED]
    assert [Verdict(verdict).name for verdict in judged.verdict] == verdicts
    belongs = [-1 if verdict == "WRONG" else 0 for verdict in verdicts]
    assert judged.note.tolist() == belongs


def test_a_note_after_the_end_of_the_episode_is_neither_hit_nor_missed():
    played = performance(
        [note(C4, 0.0, 0.4), note(C4, 0.5, 1.0), note(D4, 1.0, 1.5)], [(C4, 0.01, 0.4, 0)], steps=10
    )
    notes, _ = judge(played)
    assert notes.fate.tolist() == [HIT, NOT_REACHED, NOT_REACHED]


def test_a_press_over_two_notes_belongs_to_the_one_whose_onset_is_nearer():
    due = [note(C4, 0.2, 0.5), note(C4, 0.6, 0.9)]
    for strike, owner in ((0.30, 0), (0.46, 1)):
        notes, presses = judge(performance(due, [(C4, strike, 0.9, 0)]))
        assert presses.note.tolist() == [owner]
        assert notes.press.tolist() == [0 if i == owner else -1 for i in range(2)]


def test_counts_are_those_of_the_metrics():
    played = long_performance(400)
    notes, presses = judge(played)
    metrics = played.metrics()
    hits = int((notes.fate == HIT).sum())
    assert 0 < hits == (presses.verdict == RIGHT).sum()
    assert hits / len(notes.key) == pytest.approx(metrics["onset_recall"])
    assert hits / len(presses.key) == pytest.approx(metrics["onset_precision"])
    wrong = int((presses.verdict == WRONG).sum())
    assert wrong == wrong_presses(played.roll.active, played.key_active)
    assert set(presses.verdict.tolist()) >= {RIGHT, LATE, AGAIN}
    late = 1000 * (presses.onset[notes.press] - notes.onset)[notes.fate == HIT]
    assert late.mean() == pytest.approx(metrics["onset_error_mean_ms"])


def test_where_nothing_is_due_or_played_nothing_is_judged():
    played = performance([note(C4, 0.5, 1.0)], [(D4, 0.1, 0.3, 2)])
    silent_notes, silence = judge(resting(played))
    assert silent_notes.fate.tolist() == [MISSED]
    assert silent_notes.press.tolist() == [-1]
    for array in vars(silence).values():
        assert len(array) == 0
    before = judge(performance([note(C4, 0.5, 1.0)], [], steps=0))[0]
    np.testing.assert_array_equal(before.fate, [NOT_REACHED])
