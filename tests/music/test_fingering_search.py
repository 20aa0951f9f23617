"""The search for the cheapest fingering of a hand, against trying every fingering."""

from __future__ import annotations

import itertools
import math
import random
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sb3_piano.music import Note
from sb3_piano.music.fingering.cost import DEFAULT_WEIGHTS, PARNCUTT_WEIGHTS
from sb3_piano.music.fingering.search import WIDEST, finger_hand
from sb3_piano.music.fingering.states import OVERLAP

W = DEFAULT_WEIGHTS
BLACK = {1, 3, 6, 8, 10}
WHITE_WIDTH = 12 / 7


def note(onset, pitch, *, length=0.25, finger=-1, hand="right"):
    return Note(onset=onset, offset=onset + length, pitch=pitch, finger=finger, hand=hand)


def melody(pitches, step=0.25):
    return [note(step * index, pitch, length=step) for index, pitch in enumerate(pitches)]


def numbers(notes, hand="right", weights=W):
    """The fingers, numbered as pianists do."""
    return [finger + 1 for finger in finger_hand(notes, hand, weights).fingers]


# A second, slow way to the cost of a melody: rule by rule, note by note.


def place(pitch, w):
    octave, key = divmod(pitch, 12)
    if key in BLACK or w.physical == 0:
        inside = (key + 0.5) * 3 * WHITE_WIDTH / 5
        if key > 4:
            inside = 3 * WHITE_WIDTH + (key - 4.5) * 4 * WHITE_WIDTH / 7
    else:
        inside = ((0, 2, 4, 5, 7, 9, 11).index(key) + 0.5) * WHITE_WIDTH
    return 12 * octave + w.physical * inside + (1 - w.physical) * (key + 0.5)


def beyond(value, low, high):
    return max(low - value, 0) + max(value - high, 0)


def limited(cost, w):
    return cost * w.leap / (cost + w.leap)


def speed(time, w):
    return min(max((w.pace / time) ** w.haste, 0.3), 2.0)


def calm(before, after, w):
    return math.exp(-max(after.onset - before.offset, 0) / w.rest)


def movement(a, b, f, g, w):
    distance = place(b.pitch, w) - place(a.pitch, w)
    if a.pitch == b.pitch:
        return w.other_finger if f != g else 0.0
    change = w.place * abs(distance - (g - f) * WHITE_WIDTH)
    if f == g:
        return limited(w.same_finger + w.same_finger_size * abs(distance) + change, w)
    reach = w.reaches[min(f, g), max(f, g)]
    up = distance if f < g else -distance
    span = w.span_thumb if min(f, g) == 1 else w.span_fingers
    strain = w.stretch * beyond(up, reach.min_comfortable, reach.max_comfortable)
    strain += span * beyond(up, reach.min_relaxed, reach.max_relaxed)
    strain += w.impractical * beyond(up, reach.min_practical, reach.max_practical)
    cost = limited(strain + change, w)
    if min(f, g) == 1 and up < 0:
        thumb, finger = (a, b) if f == 1 else (b, a)
        blacks = (thumb.pitch % 12 in BLACK, finger.pitch % 12 in BLACK)
        cost += {(True, False): w.passing_on_black, (False, True): 0.0}.get(blacks, w.passing)
        cost += w.passing_size * min(abs(a.pitch - b.pitch), 12)
    return cost


def colour(a, b, f, g, w):
    blacks = (a.pitch % 12 in BLACK, b.pitch % 12 in BLACK)
    cost = 0.0
    if (f, g) == (3, 4):
        cost += w.three_to_four + (w.four_on_black if blacks == (False, True) else 0)
    if (f, g) == (4, 3) and blacks == (True, False):
        cost += w.four_on_black
    # The finger on the black key, if the other one is white.
    raised = {(True, False): f, (False, True): g}.get(blacks)
    if f != g:
        cost += {1: w.thumb_on_black_white, 5: w.five_on_black_white}.get(raised, 0.0)
    return cost


def shift(a, b, c, f, g, h, w):
    distance = place(c.pitch, w) - place(a.pitch, w)
    change = w.place_later * abs(distance - (h - f) * WHITE_WIDTH)
    if f == h:
        if a.pitch == c.pitch:
            return 0.0
        return limited(w.position_count + w.position_size * abs(distance) + change, w)
    reach = w.reaches[min(f, h), max(f, h)]
    up = distance if f < h else -distance
    size = beyond(up, reach.min_comfortable, reach.max_comfortable)
    cost = change + w.position_size * size + (w.position_count if size else 0)
    between = min(a.pitch, c.pitch) < b.pitch < max(a.pitch, c.pitch)
    if g == 1 and between and beyond(up, reach.min_practical, reach.max_practical):
        cost += w.position_count
    return limited(cost, w) + (w.other_finger_later if a.pitch == c.pitch else 0.0)


def slow_cost(notes, fingers, w):
    total = 0.0
    for a, f in zip(notes, fingers, strict=True):
        black = a.pitch % 12 in BLACK
        total += {4: w.weak_four, 5: w.weak_five}.get(f, 0.0)
        total += {1: w.thumb_on_black, 5: w.five_on_black}.get(f, 0.0) if black else 0.0
    for (a, b), (f, g) in zip(itertools.pairwise(notes), itertools.pairwise(fingers), strict=True):
        weight = speed(b.onset - a.onset, w) * calm(a, b, w)
        total += weight * movement(a, b, f, g, w) + colour(a, b, f, g, w)
    for a, b, c, f, g, h in zip(
        notes, notes[1:], notes[2:], fingers, fingers[1:], fingers[2:], strict=False
    ):
        weight = speed((c.onset - a.onset) / 2, w) * calm(a, b, w) * calm(b, c, w)
        total += weight * shift(a, b, c, f, g, h, w)
        total += w.three_four_five if {f, g, h} == {3, 4, 5} else 0.0
    return total


@pytest.mark.slow
@pytest.mark.parametrize("weights", [DEFAULT_WEIGHTS, PARNCUTT_WEIGHTS])
@pytest.mark.parametrize("seed", range(4))
def test_no_fingering_of_a_melody_costs_less_than_the_one_found(seed, weights):
    rng = random.Random(seed)
    notes, onset = [], 0.0
    for _ in range(5):
        pitch = rng.randint(58, 72)
        time = rng.choice((0.1, 0.3, 0.8))
        notes.append(note(onset, pitch, length=time * rng.choice((0.5, 1.0))))
        onset += time
    costs = {
        fingers: slow_cost(notes, fingers, weights)
        for fingers in itertools.product(range(1, 6), repeat=len(notes))
    }
    found = finger_hand(notes, "right", weights)
    fingers = tuple(finger + 1 for finger in found.fingers)
    assert found.cost == pytest.approx(min(costs.values()))
    assert costs[fingers] == pytest.approx(min(costs.values()))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_no_fingering_of_chords_costs_less_than_the_one_found(seed):
    rng = random.Random(seed)
    notes = []
    for slice_index, count in enumerate((2, 3, 2)):
        length = rng.choice((0.2, 0.2, 0.7))
        for pitch in sorted(rng.sample(range(60, 72), count)):
            notes.append(note(0.3 * slice_index, pitch, length=length))
    found = finger_hand(notes, "right", W)
    choices = [list(itertools.combinations(range(5), count)) for count in (2, 3, 2)]
    best = math.inf
    for chosen in itertools.product(*choices):
        fingers = itertools.chain.from_iterable(chosen)
        labelled = [replace(n, finger=f) for n, f in zip(notes, fingers, strict=True)]
        tried = finger_hand(labelled, "right", W)
        if tried.released == found.released:
            best = min(best, tried.cost)
    assert found.cost == pytest.approx(best)


def test_what_a_fingering_costs_is_what_it_costs_when_given_as_labels():
    notes = melody([60, 64, 67, 72, 71, 67, 61, 62])
    found = finger_hand(notes, "right")
    labelled = [replace(n, finger=f) for n, f in zip(notes, found.fingers, strict=True)]
    again = finger_hand(labelled, "right")
    assert again.fingers == found.fingers
    assert again.cost == pytest.approx(found.cost)


def test_five_neighbouring_white_keys_have_one_finger_each():
    assert numbers(melody([60, 62, 64, 65, 67, 65, 64, 62, 60])) == [1, 2, 3, 4, 5, 4, 3, 2, 1]


def test_the_left_hand_is_the_mirror_image_of_the_right():
    pitches = [60, 64, 61, 70, 72, 65, 66, 58]
    right = finger_hand(melody(pitches), "right")
    mirrored = [replace(n, pitch=124 - n.pitch, hand="left") for n in melody(pitches)]
    left = finger_hand(mirrored, "left")
    assert left == right


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


def test_labels_that_contradict_each_other_are_kept():
    chord = [note(0.0, p, finger=f) for p, f in ((60, 3), (62, 0), (64, 0))]
    assert numbers(chord) == [4, 1, 1]


def test_a_key_beside_labels_that_leave_its_place_no_finger_takes_one_from_elsewhere():
    chord = [note(0.0, 60, finger=1), note(0.0, 62), note(0.0, 64, finger=2)]
    assert numbers(chord)[0::2] == [2, 3]
    assert numbers(chord)[1] in (1, 4, 5)


def test_of_more_than_five_keys_the_outer_five_have_a_finger():
    cluster = [note(0.0, pitch) for pitch in (60, 62, 64, 65, 67, 69, 71)]
    assert numbers(cluster) == [1, 2, 3, 0, 0, 4, 5]


def test_labels_go_before_the_outer_keys():
    cluster = [note(0.0, pitch) for pitch in (60, 62, 64, 65, 67, 69, 71)]
    cluster[3] = replace(cluster[3], finger=2)
    assert numbers(cluster) == [1, 2, 0, 3, 0, 4, 5]


def test_a_held_key_keeps_its_finger_from_the_others():
    held = [note(0.0, 60, length=2.0), *(note(0.5 * i, p) for i, p in enumerate((64, 65, 67), 1))]
    fingers = numbers(held)
    assert fingers[0] not in fingers[1:]
    assert not finger_hand(held, "right").released


def test_a_key_held_out_of_reach_is_let_go():
    bass = [note(0.0, 36, length=2.0), note(0.5, 36 + WIDEST + 1)]
    assert finger_hand(bass, "right").released == {0}
    assert not finger_hand([bass[0], note(0.5, 36 + WIDEST)], "right").released


def test_of_too_many_held_keys_the_one_held_longest_is_let_go():
    held = [note(0.1 * i, pitch, length=3.0) for i, pitch in enumerate((64, 60, 62, 67, 69, 65))]
    assert finger_hand(held, "right").released == {0}


def test_a_label_that_takes_a_finger_from_a_held_key_lets_the_longest_held_go():
    held = [note(0.0, 64, length=3.0, finger=2), note(0.1, 60, length=3.0, finger=0)]
    assert finger_hand([*held, note(0.5, 67, finger=2)], "right").released == {0}


def test_a_grip_costs_its_pairs_of_keys_over_the_partners_of_each():
    # 2-5 on a minor third is two semitones less than relaxed; one point for the little finger.
    chord = [note(0.0, p, finger=f) for p, f in ((60, 0), (64, 1), (67, 4))]
    assert finger_hand(chord, "right", PARNCUTT_WEIGHTS).cost == pytest.approx(2 * 2 / 2 + 1)


def test_a_chord_moves_on_with_the_same_fingers_at_a_cost_of_its_own():
    octaves = [
        note(0.3 * i, p + up, finger=f)
        for i, p in enumerate((60, 62))
        for up, f in ((0, 0), (12, 4))
    ]

    def cost(**weights):
        return finger_hand(octaves, "right", replace(W, **weights)).cost

    assert cost(chord_finger=5.0) > cost(chord_finger=0.0)
    assert cost(chord_finger_size=5.0) > cost(chord_finger_size=0.0)
    assert cost(same_finger=5.0) == cost(same_finger=0.0)


def test_a_doubled_key_is_held_until_its_last_note_ends_and_any_of_its_labels_counts():
    doubled = [note(0.0, 60, length=0.2), note(0.0, 60, length=2.0, finger=0)]
    found = finger_hand([*doubled, note(0.5, 62, finger=0)], "right")
    assert found.fingers == (0, 0, 0)
    assert found.released == {0, 1}


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
    assert not finger_hand(notes, "right").released


def test_a_rest_frees_the_hand():
    near = melody([60, 62, 64, 65, 67])
    after = [replace(n, onset=n.onset + 9, offset=n.offset + 9, pitch=n.pitch + 2) for n in near]
    assert numbers([*near, *after]) == numbers(near) + numbers(after)


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


@settings(max_examples=60, deadline=None)
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


@settings(max_examples=40, deadline=None)
@given(PARTS)
def test_fingers_of_a_chord_follow_its_keys_and_octaves_are_alike(drawn):
    notes = part(drawn)
    found = finger_hand(notes, "right")
    for onset in {n.onset for n in notes}:
        fingers = [f for n, f in zip(notes, found.fingers, strict=True) if n.onset == onset]
        assert fingers == sorted(set(fingers))
    higher = [replace(n, pitch=n.pitch + 12) for n in notes]
    assert finger_hand(higher, "right") == found


@settings(max_examples=40, deadline=None)
@given(PARTS, st.data())
def test_labels_are_kept_whatever_they_are(drawn, data):
    notes = part(drawn)
    labels = data.draw(st.lists(st.integers(-1, 4), min_size=len(notes), max_size=len(notes)))
    labelled = [replace(n, finger=f) for n, f in zip(notes, labels, strict=True)]
    found = finger_hand(labelled, "right").fingers
    for label, finger in zip(labels, found, strict=True):
        assert finger == label if label >= 0 else finger >= 0
