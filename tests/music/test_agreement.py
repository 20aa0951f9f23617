"""How far fingerings agree: hand-worked cases, and the recombination tried out in full."""

import itertools
import random

import pytest
from short_scores import score_of
from yaml_rows import Tables

from sb3_piano.exceptions import ScoreError
from sb3_piano.music.fingering.agreement import agreement, match_rates


def score(fingers, *, hands=None, title="piece", shift=0.0):
    """A note every half second, from C4 upwards, with the given fingers or hands alone."""
    labels = hands or fingers
    notes = ((0.5 * i + shift, 0.5 * i + 0.4, 60 + i, label) for i, label in enumerate(labels))
    return score_of(*notes, title=title)


def test_the_share_of_labelled_notes_with_the_same_finger_is_told_for_each_hand():
    labelled = score([0, 1, 2, 5, 6, -1])
    found = agreement(labelled, score([0, 1, 3, 5, 1, 4]))
    assert (found.notes, found.same_finger, found.same_hand) == ((3, 2), (2, 1), (3, 1))
    assert (found.right, found.left) == (pytest.approx(2 / 3), 0.5)
    assert (found.both, found.hands) == (3 / 5, 4 / 5)
    found = agreement(score([0, 1]), score([0, 2]))
    assert (found.right, found.left, found.both) == (0.5, None, 0.5)
    # A note that has only a hand agrees with the hand, but with no finger.
    found = agreement(score([0, 5]), score([], hands=["right", -1]))
    assert (found.both, found.hands) == (0.0, 0.5)


def test_notes_of_a_chord_are_told_apart_by_their_pitch_and_doubled_ones_are_paired_once():
    one, other = (
        score_of(*((0, 1, *note) for note in notes))
        for notes in (((60, 0), (64, 2), (64, 3)), ((64, 2), (64, 3), (60, 1)))
    )
    assert agreement(one, other).same_finger == (2, 0)


def test_onsets_may_differ_by_the_rounding_of_a_file_but_not_by_more():
    labelled = score([0, 1])
    assert agreement(labelled, score([0, 1], shift=0.0009)).both == 1.0
    with pytest.raises(
        ScoreError,
        match=r"2 of 2 notes of 'piece' are not in 'late', first note 0 \(C4 at 0 s\): expected",
    ):
        agreement(labelled, score([0, 1], shift=0.0011, title="late"))


def test_notes_that_an_annotator_left_without_a_finger_do_not_count():
    rates = match_rates([score([0, -1, 2]), score([0, 1, 3])], score([0, 1, 3]))
    assert (rates.notes, rates.general, rates.highest, rates.soft) == (2, 0.75, 1.0, 1.0)


def value_of(path, truths, estimate):
    """Right fingers less changes of annotator; nothing at all if one of them is forbidden."""
    value = 0
    for place, k in enumerate(path):
        value += truths[k][place] == estimate[place]
        before = path[place - 1] if place else k
        if before != k:
            value -= 1
            if truths[k][place - 1] != truths[before][place - 1]:
                return 0
    return value


def slow_rates(truths, estimate):
    """Return recombination and highest rate: try every way to follow annotators, by hand."""
    best = followed = 0
    for hand in ("right", "left"):
        notes = [i for i, note in enumerate(estimate.notes) if note.hand == hand]
        given = [[truth.notes[i].finger for i in notes] for truth in truths]
        fingers = [estimate.notes[i].finger for i in notes]
        paths = itertools.product(range(len(truths)), repeat=len(notes))
        best += max(value_of(path, given, fingers) for path in paths)
        followed += max(sum(map(int.__eq__, each, fingers)) for each in given)
    return best / len(estimate.notes), followed / len(estimate.notes)


def annotator(estimate, draw, same):
    """Fingers that are those of the estimate for a while, then one of two others for a while."""
    fingers = []
    for note in estimate.notes:
        same = same if draw.random() < 0.8 else not same
        others = [note.finger // 5 * 5 + (note.finger + shift) % 5 for shift in (1, 2)]
        fingers.append(note.finger if same else draw.choice(others))
    return score(fingers)


@pytest.mark.parametrize("seed", range(40))
def test_the_recombination_is_the_best_of_all_and_rates_are_in_their_order(seed):
    draw = random.Random(seed)
    hands = draw.choice([(0, 1), (0, 1), (0, 1, 5, 6)])
    length, n_annotators = draw.choice([(draw.randint(1, 4), 1), (7, 3), (11, 2), (11, 2)])
    estimate = score([draw.choice(hands) for _ in range(length)])
    truths = [annotator(estimate, draw, k % 2 == 0) for k in range(n_annotators)]
    rates = match_rates(truths, estimate)
    found = rates.recombination, rates.highest
    assert found == pytest.approx(slow_rates(truths, estimate))
    by_note = zip(estimate.notes, *(truth.notes for truth in truths), strict=True)
    right = [any(note.finger == one.finger for one in given) for note, *given in by_note]
    assert rates.soft == pytest.approx(sum(right) / len(right))
    simple = [agreement(truth, estimate).both for truth in truths]
    assert rates.general == pytest.approx(sum(simple) / len(truths))
    assert rates.highest <= rates.recombination <= rates.soft


@Tables(__file__)("annotations, estimate, message")
def test_annotations_of_the_same_notes_with_a_label_in_common_are_needed(
    annotations, estimate, message
):
    given = [score(fingers, title=title) for fingers, title in annotations]
    with pytest.raises(ScoreError, match=message):
        match_rates(given, score(estimate))
    with pytest.raises(ScoreError, match="Score 'piece' has no finger labels"):
        agreement(score([-1, -1]), score([0, 1]))
