"""Frame scores: values worked by hand, and properties that always hold."""

from itertools import groupby

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from yaml_rows import Tables

from sb3_piano.metrics import frame_f1, frame_scores, presses_of
from sb3_piano.metrics.frames import non_silent_f1
from sb3_piano.metrics.presses import wrong_presses, wrong_presses_per_second

tables = Tables(__file__)


def frames(*steps, keys=4):
    """Return a (T, keys) bool array from the keys that are on in each step."""
    array = np.zeros((len(steps), keys), dtype=bool)
    for step, on in enumerate(steps):
        array[step, list(on)] = True
    return array


@tables("target, played, expected, why")
def test_frame_scores_of_hand_worked_cases(target, played, expected, why):
    found = frame_scores(frames(*target), frames(*played))
    assert found == pytest.approx(tuple(expected)), why
    assert frame_f1(frames(*target), frames(*played)) == found.f1


rolls = hnp.arrays(bool, st.tuples(st.integers(1, 6), st.just(5)))


@pytest.mark.slow
@given(st.data())
def test_frame_scores_equal_a_plain_python_twin(data):
    target = data.draw(rolls)
    played = data.draw(hnp.arrays(bool, target.shape))
    precisions, recalls, f1s, sounding_f1s = [], [], [], []
    for due, on in zip(target, played, strict=True):
        due, on = set(np.flatnonzero(due)), set(np.flatnonzero(on))
        precisions.append(len(due & on) / len(on) if on else 1.0)
        recalls.append(len(due & on) / len(due) if due else 1.0)
        f1s.append(2 * len(due & on) / (len(due) + len(on)) if due or on else 1.0)
        if due:
            sounding_f1s.append(f1s[-1])
    expected = (np.mean(precisions), np.mean(recalls), np.mean(f1s))
    assert frame_scores(target, played) == pytest.approx(expected)
    assert non_silent_f1(target, played) == pytest.approx(
        np.mean(sounding_f1s) if sounding_f1s else 1.0
    )


def test_the_scores_stored_with_a_recorded_performance_come_out(performance):
    target = np.zeros_like(performance["key_active"], dtype=bool)
    step, key, _ = performance["roll_notes"].T
    target[step, key] = True
    stored = [float(performance[name]) for name in ("precision", "recall", "f1")]
    ours = frame_scores(target, performance["key_active"])
    assert ours == pytest.approx(stored, rel=0, abs=1e-9)


# Presses: the unbroken runs in which a key sounds, and those that nobody asked for.


def keys_of(text):
    """Return a (T, n) bool array from one line a key, ``x`` where it sounds."""
    return np.array([[c == "x" for c in line] for line in text.split()]).T


def listed(presses):
    return list(zip(*(field.tolist() for field in presses), strict=True))


few_keys = hnp.arrays(bool, st.tuples(st.integers(0, 8), st.integers(1, 4)))


def plain_presses(active):
    """Return the presses by key, with a loop in place of array operations."""
    for key in range(active.shape[1]):
        for sounds, run in groupby(range(len(active)), key=lambda step: active[step, key]):
            steps = list(run)
            if sounds:
                yield key, steps[0], steps[-1] + 1


@given(few_keys)
def test_presses_equal_a_plain_python_twin(active):
    expected = sorted(plain_presses(active), key=lambda press: (press[1], press[0]))
    assert listed(presses_of(active)) == expected


def test_a_press_is_wrong_if_its_key_is_due_in_none_of_its_steps():
    target = keys_of("""
        .xxx....
        ...xxx..
        ........
    """)
    played = keys_of("""
        x.xx.xx.
        .....xxx
        xxxxxxxx
    """)
    # Key 0: one press before the note, one in it, one after it. Key 1 is late, not wrong.
    assert wrong_presses(target, played) == 3
    assert wrong_presses_per_second(target, played, 0.05) == pytest.approx(3 / 0.4)


@given(st.data())
def test_wrong_presses_equal_a_plain_python_twin(data):
    played = data.draw(few_keys)
    target = data.draw(hnp.arrays(bool, played.shape))
    runs = plain_presses(played)
    expected = sum(not target[first:end, key].any() for key, first, end in runs)
    assert wrong_presses(target, played) == expected
