"""The search for the cheapest fingering of a hand, against trying every fingering."""

import itertools
import math
import random
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from yaml_rows import Tables

from sb3_piano.exceptions import ConfigError
from sb3_piano.music import Note
from sb3_piano.music.fingering.cost import (
    DEFAULT_WEIGHTS,
    MAX_INTERVAL,
    CostTables,
    FingeringWeights,
)
from sb3_piano.music.fingering.ergonomic import OVERLAP, WIDEST, finger_hand

tables = Tables(__file__)

W = DEFAULT_WEIGHTS
# As first published.
RULES = yaml.safe_load(
    (Path(__file__).parents[1] / "data" / "music" / "published_rules.yml").read_text()
)
PARNCUTT_WEIGHTS = FingeringWeights(
    **{field.name: RULES["points"].get(field.name, 0.0) for field in fields(FingeringWeights)}
)
PARNCUTT_HAND = {
    tuple(map(int, pair.split("-"))): tuple(distances) for pair, distances in RULES["hand"].items()
}


def note(onset, pitch, *, length=0.25, finger=-1, hand="right"):
    return Note(onset=onset, offset=onset + length, pitch=pitch, finger=finger, hand=hand)


def melody(pitches, step=0.25):
    return [note(step * index, pitch, length=step) for index, pitch in enumerate(pitches)]


def numbers(notes, hand="right", weights=W):
    """The fingers, numbered as pianists do."""
    return [finger + 1 for finger in finger_hand(notes, hand, weights).fingers]


@pytest.mark.slow
@pytest.mark.parametrize("counts", [(2, 3, 2), (2, 1, 3), (1, 1, 1, 1)], ids=str)
@pytest.mark.parametrize("seed", range(2))
def test_no_fingering_costs_less_than_the_one_found(seed, counts):
    rng = random.Random(seed)
    notes = []
    for slice_index, count in enumerate(counts):
        length = rng.choice((0.2, 0.2, 0.7))
        for pitch in sorted(rng.sample(range(60, 72), count)):
            notes.append(note(0.3 * slice_index, pitch, length=length))
    found = finger_hand(notes, "right", W)
    choices = [list(itertools.combinations(range(5), count)) for count in counts]
    best = math.inf
    for chosen in itertools.product(*choices):
        fingers = itertools.chain.from_iterable(chosen)
        labelled = [replace(n, finger=f) for n, f in zip(notes, fingers, strict=True)]
        tried = finger_hand(labelled, "right", W)
        if tried.released == found.released:
            best = min(best, tried.cost)
    assert found.cost == pytest.approx(best)


def test_a_repeated_key_keeps_its_finger():
    fingers = numbers(melody([64, 64, 64, 65, 65, 67, 67, 67, 64]))
    assert len(set(fingers[:3])) == len(set(fingers[3:5])) == len(set(fingers[5:8])) == 1


def test_notes_that_are_nearly_together_are_a_chord():
    chord = [note(0.0, 67), note(0.01, 60), note(0.02, 64)]
    low, middle, high = (numbers(chord)[index] for index in (1, 2, 0))
    assert low < middle < high
    exact = [replace(n, onset=0.0, offset=0.25) for n in chord]
    assert finger_hand(chord, "right").cost == finger_hand(exact, "right").cost


def test_notes_that_double_each_other_share_a_finger():
    doubled = [note(0.0, 60), note(0.0, 60, length=0.5), note(0.0, 67)]
    fingers = numbers(doubled)
    assert fingers[0] == fingers[1] < fingers[2]


def test_a_label_is_kept_and_the_others_make_way_for_it():
    free = melody([60, 62, 64, 65, 67])
    assert numbers(free)[1] == 2
    labelled = [replace(n, finger=2) if n.pitch == 62 else n for n in free]
    fingers = numbers(labelled)
    assert fingers[1] == 3
    assert 3 not in (fingers[0], fingers[2])


def test_a_key_beside_labels_that_leave_its_place_no_finger_takes_one_from_elsewhere():
    chord = [note(0.0, 60, finger=1), note(0.0, 62), note(0.0, 64, finger=2)]
    assert numbers(chord)[0::2] == [2, 3]
    assert numbers(chord)[1] in (1, 4, 5)


def test_of_more_than_five_keys_those_with_labels_then_the_outer_ones_have_a_finger():
    cluster = [note(0.0, pitch) for pitch in (60, 62, 64, 65, 67, 69, 71)]
    assert numbers(cluster) == [1, 2, 3, 0, 0, 4, 5]
    cluster[3] = replace(cluster[3], finger=2)
    assert numbers(cluster) == [1, 2, 0, 3, 0, 4, 5]


def test_a_key_held_out_of_reach_is_let_go():
    bass = [note(0.0, 36, length=2.0), note(0.5, 36 + WIDEST + 1)]
    assert finger_hand(bass, "right").released == {0}
    assert not finger_hand([bass[0], note(0.5, 36 + WIDEST)], "right").released


@Tables(__file__)("notes, released, why")
def test_what_a_hand_lets_go(notes, released, why):
    held = [note(at, pitch, length=length, finger=finger) for at, pitch, length, finger in notes]
    assert finger_hand(held, "right").released == set(released), why


def test_a_grip_costs_its_pairs_of_keys_over_the_partners_of_each():
    # 2-5 on a minor third is two semitones less than relaxed; one point for the little finger.
    chord = [note(0.0, p, finger=f) for p, f in ((60, 0), (64, 1), (67, 4))]
    assert finger_hand(chord, "right", PARNCUTT_WEIGHTS).cost == pytest.approx(2 * 2 / 2 + 1)


def test_a_doubled_key_is_held_until_its_last_note_ends_and_any_of_its_labels_counts():
    doubled = [note(0.0, 60, length=0.2), note(0.0, 60, length=2.0, finger=0)]
    found = finger_hand([*doubled, note(0.5, 62, finger=0)], "right")
    assert found.fingers == (0, 0, 0)


def test_legato_overlap_holds_no_finger():
    notes = [note(0.0, 60, length=0.25 + OVERLAP / 2), note(0.25, 62)]
    apart = [note(0.0, 60, length=0.25), note(0.25, 62)]
    assert finger_hand(notes, "right").fingers == finger_hand(apart, "right").fingers
    labelled = [replace(n, finger=1) for n in notes]
    assert not finger_hand(labelled, "right").released
    assert finger_hand([replace(labelled[0], offset=0.5), labelled[1]], "right").released == {0}


def test_a_key_struck_again_while_it_is_held_is_not_held_besides():
    notes = [note(0.0, 60, length=2.0), note(0.5, 60, length=0.2), note(1.0, 60)]
    assert len(set(finger_hand(notes, "right").fingers)) == 1


def test_a_part_without_notes_has_no_fingers():
    assert finger_hand([], "left").fingers == ()


PARTS = st.lists(
    st.tuples(
        st.sampled_from((0.04, 0.1, 0.25, 0.6)),
        st.lists(st.integers(0, 14), min_size=1, max_size=4, unique=True),
        st.sampled_from((0.05, 0.2, 0.4, 1.0)),
        st.integers(50, 70),
    ),
    min_size=1,
    max_size=12,
)


def part(drawn, finger=-1):
    notes, onset = [], 0.0
    for wait, keys, length, base in drawn:
        onset += wait
        notes += [note(onset, base + key, length=length, finger=finger) for key in sorted(keys)]
    return notes


@given(PARTS)
def test_every_key_has_a_finger_and_no_finger_has_two_keys_unless_one_was_let_go(drawn):
    notes = part(drawn)
    found = finger_hand(notes, "right")
    assert min(found.fingers) >= 0
    for (i, a), (j, b) in itertools.combinations(enumerate(notes), 2):
        together = a.offset > b.onset + OVERLAP and a.pitch != b.pitch
        if together and i not in found.released and found.fingers[i] == found.fingers[j]:
            struck_again = any(n.pitch == a.pitch and a.onset < n.onset <= b.onset for n in notes)
            assert struck_again


@given(PARTS)
def test_fingers_of_a_chord_follow_its_keys_and_octaves_are_alike(drawn):
    notes = part(drawn)
    found = finger_hand(notes, "right")
    for onset in {n.onset for n in notes}:
        fingers = [f for n, f in zip(notes, found.fingers, strict=True) if n.onset == onset]
        assert fingers == sorted(set(fingers))
    higher = [replace(n, pitch=n.pitch + 12) for n in notes]
    assert finger_hand(higher, "right") == found


@given(PARTS, st.data())
def test_labels_are_kept_whatever_they_are(drawn, data):
    notes = part(drawn)
    labels = data.draw(st.lists(st.integers(-1, 4), min_size=len(notes), max_size=len(notes)))
    labelled = [replace(n, finger=f) for n, f in zip(notes, labels, strict=True)]
    found = finger_hand(labelled, "right").fingers
    for label, finger in zip(labels, found, strict=True):
        assert finger == label if label >= 0 else finger >= 0


# The costs of fingers on keys, against the rules as published and worked by hand.


PARNCUTT = CostTables(PARNCUTT_WEIGHTS, PARNCUTT_HAND)


def points(table, first, second, fingers):
    """The cost of two pitches with two fingers, numbered as pianists do."""
    at = (first % 12, second - first + MAX_INTERVAL, fingers[0] - 1, fingers[1] - 1)
    return pytest.approx(float(table[at]), rel=1e-5, abs=1e-5)


@tables("first, second, fingers, expected, why")
def test_two_keys_in_succession_cost_the_published_points(first, second, fingers, expected, why):
    assert points(PARNCUTT.moves, first, second, fingers) == expected, why


@tables("first, second, fingers, expected, why")
def test_the_colours_of_two_keys_cost_the_published_points(first, second, fingers, expected, why):
    assert points(PARNCUTT.colours, first, second, fingers) == expected, why


def test_weak_fingers_and_the_thumb_on_black_cost_the_published_points():
    assert PARNCUTT.single.tolist() == [[0, 0, 0, 1, 1], [1, 0, 0, 1, 1]]


@tables("first, third, fingers, half, full")
def test_a_change_of_position_counts_once_or_twice_and_with_its_size(
    first, third, fingers, half, full
):
    assert points(PARNCUTT.shifts, first, third, fingers) == half
    assert points(PARNCUTT.full_shifts, first, third, fingers) == full


def test_only_the_three_outer_fingers_one_after_the_other_cost_a_point():
    found = {tuple(fingers) for fingers in np.argwhere(PARNCUTT.triples == 1.0)}
    assert found == set(itertools.permutations((2, 3, 4)))
    assert PARNCUTT.triples.sum() == 6


@tables("name, value, expected")
def test_a_weight_out_of_range_is_refused(name, value, expected):
    with pytest.raises(ConfigError, match=f"{name} is {value!r}: expected {expected}"):
        FingeringWeights(**{name: value})
