"""Hands for notes that do not say which hand plays them."""

from collections import Counter
from fnmatch import fnmatch

import pytest
from hypothesis import given
from hypothesis import strategies as st
from short_scores import score_of
from yaml_rows import Tables

from sb3_piano.music import BUILT_IN
from sb3_piano.music.fingering import without_fingers
from sb3_piano.music.fingering.hand_search import search
from sb3_piano.music.fingering.split import _Pianist, assign_hands

tables = Tables(__file__)


def score(*notes):
    """A score of (onset, pitch, length, hand)."""
    return score_of(*((onset, onset + length, pitch, hand) for onset, pitch, length, hand in notes))


def hands(*notes):
    """The hand found for each of (onset, pitch, length), R or L, sorted as in a score."""
    found = assign_hands(score(*((*note, None) for note in notes)))
    return "".join("R" if note.hand == "right" else "L" for note in found.notes)


def share_recovered(name):
    labelled = BUILT_IN[name].score()
    found = assign_hands(without_fingers(labelled, keep_hands=False))
    # Notes of equal onset and pitch are the same to whoever sees no hands.
    truth, answer = (
        Counter((n.onset, n.pitch, n.hand) for n in score.notes) for score in (labelled, found)
    )
    return (truth & answer).total() / truth.total()


@tables("why, notes, expected")
def test_hands_go_where_they_have_to_be(why, notes, expected):
    assert fnmatch(hands(*notes), expected), why


def test_notes_that_strike_one_key_together_are_one_hands():
    assert set(hands(*[(0.0, 60, 1.0)] * 12)) in ({"L"}, {"R"})


def test_a_hand_takes_at_most_five_keys_at_a_time_if_the_other_can_help():
    assert hands(*((0.0, pitch, 1.0) for pitch in range(60, 67))).count("L") >= 2


@pytest.mark.parametrize(("hand", "pitch"), [("left", 62), ("right", 58)])
def test_a_known_hand_draws_its_neighbours_with_it(hand, pitch):
    line = [(0.2 * i, pitch, 0.2, hand if i == 2 else None) for i in range(5)]
    assert {note.hand for note in assign_hands(score(*line)).notes} == {hand}


def test_a_score_whose_hands_are_all_known_is_returned_as_it_is():
    known = score((0.0, 60, 1.0, "left"))
    assert assign_hands(known) is known


@tables("name, least")
def test_music_finds_its_hands_again(name, least):
    assert share_recovered(name) >= least


SCORES = st.lists(
    st.tuples(
        st.sampled_from((0.0, 0.02, 0.1, 0.5)),
        st.integers(30, 90),
        st.sampled_from((0.1, 0.5, 2.0)),
        st.sampled_from((None, None, "right", "left")),
    ),
    min_size=1,
    max_size=25,
)


def built(drawn):
    onset, notes = 0.0, []
    for wait, pitch, length, hand in drawn:
        onset += wait
        notes.append((onset, pitch, length, hand))
    return score(*notes)


@pytest.mark.slow
@given(SCORES)
def test_every_note_has_a_hand_and_known_ones_keep_theirs(drawn):
    piece = built(drawn)
    found = assign_hands(piece)
    assert all(note.hand is not None for note in found.notes)
    known, answer = (
        Counter((n.onset, n.pitch, n.hand) for n in score.notes if n.hand)
        for score in (piece, found)
    )
    assert known <= answer
    assert assign_hands(piece) == found


@given(SCORES)
def test_hands_never_cross_within_a_chord(drawn):
    found = assign_hands(without_fingers(built(drawn), keep_hands=False))
    for onset in {note.onset for note in found.notes}:
        chord = [note for note in found.notes if note.onset == onset]
        left = [note.pitch for note in chord if note.hand == "left"]
        right = [note.pitch for note in chord if note.hand == "right"]
        assert max(left, default=0) <= min(right, default=127)


def test_a_key_is_held_once_however_many_notes_lie_on_it():
    held = []

    class Watching(_Pianist):
        def costs(self, states, chord):
            held.append(len(chord.held))
            return super().costs(states, chord)

    together = [(0.0, 60, 50.0, None)] * 9
    again = [(0.1 * i, 48 + i % 3, 50.0, None) for i in range(1, 30)]
    search(score(*together, *again).notes, Watching())
    assert max(held) == 3  # 60, and two of the three keys: the third is struck
