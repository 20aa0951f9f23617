"""Fingers for whole scores, both hands."""

import itertools
import random
from dataclasses import replace

import pytest
from short_scores import note_of, score_of
from yaml_rows import Tables

from sb3_piano.exceptions import ScoreError
from sb3_piano.music import BUILT_IN, Pedal, Score
from sb3_piano.music.fingering import agreement, finger_score, without_fingers
from sb3_piano.music.fingering.agreement import match_rates

KEYS = ("C", "Db", "D", "Eb", "E", "F", "Gb", "G", "Ab", "A", "Bb", "B")


def shares(pieces, **options):
    """The share of fingers found again, over all of some pieces: (right hand, left hand)."""
    found = [
        agreement(score, finger_score(without_fingers(score, keep_hands=True)))
        for score in (BUILT_IN[name].score(**options) for name in pieces)
    ]
    return tuple(
        sum(a.same_finger[hand] for a in found) / sum(a.notes[hand] for a in found)
        for hand in (0, 1)
    )


def numbers(score, hand):
    """The fingers of a hand, numbered as pianists do."""
    return "".join(str(note.finger % 5 + 1) for note in score.notes if note.hand == hand)


def tune(*pitches, hand=None, step=0.25):
    return score_of(*((step * i, step * (i + 1), p, hand) for i, p in enumerate(pitches)))


def test_a_score_without_any_hint_gets_hands_and_fingers():
    pitches = (60, 62, 64, 65, 67)
    both = score_of(
        *((0.25 * i, 0.25 * (i + 1), p + away) for i, p in enumerate(pitches) for away in (-24, 12))
    )
    found = finger_score(both)
    assert numbers(found, "right") == "12345"
    assert numbers(found, "left") == "54321"
    assert {note.finger for note in found.notes if note.hand == "left"} == {5, 6, 7, 8, 9}


def test_everything_but_hand_and_finger_stays():
    note = note_of(0.0, 1.0, velocity=33)
    piece = Score(notes=[note], pedals=[Pedal(onset=0, offset=1)], title="piece", bars=[0, 1])
    found = finger_score(piece)
    (note,) = found.notes
    assert note.finger >= 0
    assert replace(note, finger=-1, hand=None) == piece.notes[0]
    assert (found.pedals, found.title, found.bars) == (piece.pedals, piece.title, piece.bars)


def test_a_known_hand_is_kept_even_in_the_others_register():
    assert {note.hand for note in finger_score(tune(72, 74, 76, hand="left")).notes} == {"left"}
    assert {note.hand for note in finger_score(tune(40, 41, 43, hand="right")).notes} == {"right"}


def test_the_mirrored_piece_has_the_mirrored_fingers():
    piece = without_fingers(BUILT_IN["repertoire-MapleLeafRag"].score(), keep_hands=True)

    def mirrored(score):
        # About D4 and with hands changed; fingers 0-4 are the right hand's, 5-9 the left's.
        swap = {"right": "left", "left": "right"}
        notes = [
            replace(
                note,
                pitch=124 - note.pitch,
                hand=swap[note.hand],
                finger=(note.finger + 5) % 10 if note.finger >= 0 else -1,
            )
            for note in score.notes
        ]
        return Score(notes=notes)

    assert finger_score(mirrored(piece)) == mirrored(finger_score(piece))


def test_notes_held_for_ever_do_not_use_the_fingers_up():
    # As from a file whose pedal is written out: nothing is let go before the end.
    piece = score_of(*((0.2 * i, 60.0, 36 + 7 * i % 50) for i in range(60)))
    assert all(note.finger >= 0 for note in finger_score(piece).notes)


def test_a_key_beyond_ten_has_a_hand_but_no_finger():
    found = finger_score(score_of(*((0.0, 1.0, pitch) for pitch in range(50, 62))))
    assert sorted(note.finger for note in found.notes) == [-1, -1, *range(10)]
    assert all(note.hand is not None for note in found.notes)


def test_major_scales_get_the_standard_fingers():
    # Those of one octave from a black key excepted, at their ends and their top: there the
    # standard has the fingers with which a longer scale would go on.
    for key in KEYS:
        piece = BUILT_IN[f"scale-{key}Major"].score()
        found = finger_score(without_fingers(piece, keep_hands=True))
        for hand in ("right", "left"):
            pairs = zip(numbers(piece, hand), numbers(found, hand), strict=True)
            other = {place for place, (standard, digit) in enumerate(pairs) if standard != digit}
            assert other <= {0, 1, 7, 13, 14}, (key, hand, other)
            if key in ("C", "D", "E", "F", "G", "A"):
                assert not other, (key, hand, other)


def test_most_fingers_of_the_studies_are_found_again():
    studies = {
        kind: [name for name, piece in BUILT_IN.items() if piece.collection == kind]
        for kind in ("scale", "arpeggio", "hanon")
    }
    assert min(shares(studies["scale"])) > 0.85
    assert min(shares(studies["arpeggio"])) > 0.7
    assert min(shares(studies["hanon"][::4])) > 0.8


def test_most_fingers_of_music_are_found_again():
    repertoire = [name for name, piece in BUILT_IN.items() if piece.collection == "repertoire"]
    right, left = shares(repertoire)
    assert right > 0.8
    assert left > 0.73


# How far fingerings agree: hand-worked cases, and the recombination tried out in full.


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
