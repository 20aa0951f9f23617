"""Presses: the unbroken runs in which a key sounds, and those that nobody asked for."""

from itertools import groupby

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from sb3_piano.metrics import presses_of
from sb3_piano.metrics.presses import wrong_presses, wrong_presses_per_second


def keys_of(text):
    """Return a (T, n) bool array from one line a key, ``x`` where it sounds."""
    return np.array([[c == "x" for c in line] for line in text.split()]).T


def listed(presses):
    return list(zip(*(field.tolist() for field in presses), strict=True))


rolls = hnp.arrays(bool, st.tuples(st.integers(0, 8), st.integers(1, 4)))


def plain_presses(active):
    """Return the presses by key, with a loop in place of array operations."""
    for key in range(active.shape[1]):
        for sounds, run in groupby(range(len(active)), key=lambda step: active[step, key]):
            steps = list(run)
            if sounds:
                yield key, steps[0], steps[-1] + 1


@given(rolls)
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
    played = data.draw(rolls)
    target = data.draw(hnp.arrays(bool, played.shape))
    runs = plain_presses(played)
    expected = sum(not target[first:end, key].any() for key, first, end in runs)
    assert wrong_presses(target, played) == expected
