"""Which notes the report calls hit, and what it calls each press."""

import numpy as np
import pytest
from report_parts import C4, D4, long_performance, note, performance, resting
from yaml_rows import Tables

from sb3_piano.metrics.presses import wrong_presses
from sb3_piano.viewing.report.judgement import Fate, Verdict, judge

tables = Tables(__file__)
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
