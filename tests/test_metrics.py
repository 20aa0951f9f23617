"""Music metrics: values worked by hand, and properties that always hold."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from sb3_piano.metrics import EPISODE_METRICS, episode_metrics, frame_scores, noop_scores


def frames(*steps, keys=4):
    """Return a (T, keys) bool array from the keys that are on in each step."""
    array = np.zeros((len(steps), keys), dtype=bool)
    for step, on in enumerate(steps):
        array[step, list(on)] = True
    return array


@pytest.mark.parametrize(
    ("target", "played", "expected"),
    [
        ([{0}], [{0}], (1, 1, 1)),
        ([set()], [set()], (1, 1, 1)),  # silence where silence is due
        ([{0}], [set()], (1, 0, 0)),  # nothing pressed: precision 1
        ([set()], [{0}], (0, 1, 0)),  # nothing due: recall 1
        ([{0}], [{1}], (0, 0, 0)),
        ([{0, 1}], [{0}], (1, 1 / 2, 2 / 3)),
        ([{0}], [{0, 1, 2}], (1 / 3, 1, 1 / 2)),
        ([{0, 1}], [{1, 2}], (1 / 2, 1 / 2, 1 / 2)),
        ([{0}, set()], [{1}, set()], (1 / 2, 1 / 2, 1 / 2)),  # the mean over two steps
    ],
)
def test_frame_scores_of_hand_worked_cases(target, played, expected):
    assert frame_scores(frames(*target), frames(*played)) == pytest.approx(expected)


def test_no_step_at_all_scores_one():
    assert frame_scores(np.zeros((0, 88)), np.zeros((0, 88))) == (1.0, 1.0, 1.0)


def test_arrays_of_different_shapes_are_refused():
    with pytest.raises(ValueError, match=r"one shape, got \(2, 88\) and \(3, 88\)"):
        frame_scores(np.zeros((2, 88)), np.zeros((3, 88)))


def test_playing_nothing_scores_the_share_of_silent_steps():
    target = frames({0}, set(), {1, 2}, set())
    assert noop_scores(target) == (1.0, 0.5, 0.5)


rolls = hnp.arrays(bool, st.tuples(st.integers(1, 6), st.just(5)))


@given(rolls)
def test_perfect_playing_scores_one(target):
    assert frame_scores(target, target) == (1.0, 1.0, 1.0)


@given(st.data())
def test_frame_scores_equal_a_plain_python_twin(data):
    target = data.draw(rolls)
    played = data.draw(hnp.arrays(bool, target.shape))
    precisions, recalls, f1s = [], [], []
    for due, on in zip(target, played, strict=True):
        due, on = set(np.flatnonzero(due)), set(np.flatnonzero(on))
        precisions.append(len(due & on) / len(on) if on else 1.0)
        recalls.append(len(due & on) / len(due) if due else 1.0)
        f1s.append(2 * len(due & on) / (len(due) + len(on)) if due or on else 1.0)
    expected = (np.mean(precisions), np.mean(recalls), np.mean(f1s))
    assert frame_scores(target, played) == pytest.approx(expected)


@given(st.data())
def test_pressing_a_wrong_key_never_raises_precision_or_f1(data):
    target = data.draw(rolls)
    played = data.draw(hnp.arrays(bool, target.shape))
    wrong = np.argwhere(~target & ~played)
    if len(wrong) == 0:
        return
    worse = played.copy()
    worse[tuple(wrong[0])] = True
    before, after = frame_scores(target, played), frame_scores(target, worse)
    assert after.precision <= before.precision
    assert after.f1 <= before.f1


def test_episode_metrics_score_keys_and_pedal_apart():
    keys = frames({0}, {1})
    pedal = np.array([True, False])
    metrics = episode_metrics(keys, keys, pedal, ~pedal)
    assert tuple(metrics) == EPISODE_METRICS
    assert metrics["f1"] == 1.0
    # Step 0: due, not pressed (precision 1, recall 0); step 1: pressed, not due (0, 1).
    assert (metrics["sustain_precision"], metrics["sustain_recall"]) == (0.5, 0.5)
    assert metrics["sustain_f1"] == 0.0
