"""Losses: what becomes of each due frame, and what each wrong one is."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from sb3_piano.metrics import Losses, losses_of
from sb3_piano.metrics.losses import DUE_KINDS, WRONG_KINDS, shares_of

C, C_SHARP, D, E, F = 3, 4, 5, 7, 8  # the lowest octave: A0 is key 0


def roll_of(**lines):
    """Return a (T, 88) bool array from a line for each key, ``x`` where it is down."""
    keys = {"C": C, "Cs": C_SHARP, "D": D, "E": E, "F": F}
    roll = np.zeros((len(next(iter(lines.values()))), 88), dtype=bool)
    for name, line in lines.items():
        roll[:, keys[name]] = [sign == "x" for sign in line]
    return roll


def losses(target, played, finger=None, pressed=None):
    nobody = np.full(target.shape, -1, dtype=np.int8)
    return losses_of(
        target, played, nobody if finger is None else finger, nobody if pressed is None else pressed
    )


def counted(counts, group="all"):
    return tuple(counts[group].values())


def test_a_due_frame_sounds_or_is_lost_in_one_of_four_ways():
    target = roll_of(C="xxxxxxxx..xxx", F=".....xxxx....")
    played = roll_of(C="..x.xx.......", F=".............")
    # The first C: two frames late, one interrupted, two let go early; the second one and F: never.
    assert counted(losses(target, played).due) == (3, 7, 2, 2, 1)


def test_a_wrong_frame_is_of_its_own_note_a_neighbour_or_neither():
    target = roll_of(C="..xxx...", F="......x.")
    played = roll_of(C=".x..xxx.", D="..x..x..", E="......x.", Cs="...x....")
    # C too early is a press of its own that meets no note, so "other"; held over it is its own
    # note's. D beside C, the next white key, then with nothing due; E beside F; C sharp beside C.
    assert counted(losses(target, played).wrong) == (2, 3, 2)


def test_a_press_that_begins_too_early_is_of_its_own_note():
    target, played = roll_of(C="..xx"), roll_of(C="xxx.")
    assert counted(losses(target, played).wrong) == (2, 0, 0)


@pytest.mark.parametrize(
    ("due", "pressed", "beside"),
    [("C", "D", True), ("E", "F", True), ("Cs", "D", True), ("C", "E", False), ("D", "F", False)],
)
def test_neighbours_are_the_next_key_and_the_next_white_one(due, pressed, beside):
    for one, other in [(due, pressed), (pressed, due)]:
        wrong = losses(roll_of(**{one: "x"}), roll_of(**{other: "x"})).wrong
        assert wrong["all"]["neighbour"] == beside


def test_due_frames_are_grouped_by_finger_colour_and_chord():
    target = roll_of(C="xx...", E="xxx..", Cs="....x", F="xx...")
    finger = np.full(target.shape, -1, dtype=np.int8)
    finger[:, [C, E, F]], finger[:, C_SHARP] = [0, 2, 9], 1  # F alone is of the left hand
    due = losses(target, roll_of(C="xx...", E=".....", Cs="....x", F="xx..."), finger).due
    frames = {group: sum(kinds.values()) for group, kinds in due.items()}
    assert frames == {
        "all": 8, "right thumb": 2, "right index": 1, "right middle": 3, "left little": 2,
        "white keys": 7, "black keys": 1, "1 note": 3, "2 notes": 5,
    }  # fmt: skip
    assert counted(due, "right middle") == (0, 3, 0, 0, 0)
    assert counted(due, "2 notes") == (2, 3, 0, 0, 0)


def test_wrong_frames_are_grouped_by_the_finger_that_presses_and_colour():
    played = roll_of(C="x.", Cs="xx")
    pressed = np.where(played, np.int8(6), np.int8(-1))
    wrong = losses(roll_of(F=".."), played, pressed=pressed).wrong
    frames = {group: sum(kinds.values()) for group, kinds in wrong.items()}
    assert frames == {"all": 3, "left index": 3, "white keys": 1, "black keys": 2}


def test_silence_has_no_groups():
    for steps in (0, 3):
        silence = np.zeros((steps, 88), dtype=bool)
        assert losses(silence, silence) == Losses(due={}, wrong={})


def test_losses_of_several_performances_are_summed():
    one = losses(roll_of(C="xx"), roll_of(C=".x"))
    other = losses(roll_of(C="xx"), roll_of(C="..", D="x."))
    together = Losses.sum_of([one, other])
    assert counted(together.due) == (1, 2, 1, 0, 0)
    assert counted(together.wrong) == (0, 1, 0)


@given(st.data())
def test_each_frame_is_of_one_kind_and_shares_add_up_to_one(data):
    shape = (data.draw(st.integers(0, 8)), 88)
    sparse = hnp.arrays(bool, shape, elements=st.booleans(), fill=st.just(False))
    fingers = hnp.arrays(np.int8, shape, elements=st.integers(-1, 9))
    target, played = data.draw(sparse), data.draw(sparse)
    found = losses(target, played, data.draw(fingers), data.draw(fingers))
    for counts, kinds, number in [
        (found.due, DUE_KINDS, target.sum()),
        (found.wrong, WRONG_KINDS, (played & ~target).sum()),
    ]:
        assert sum(sum(kind.values()) for name, kind in counts.items() if "key" in name) == number
        assert sum(counts["all"].values() if counts else ()) == number
        for of_kind in counts.values():
            assert tuple(of_kind) == kinds
            assert sum(shares_of(of_kind).values()) == pytest.approx(1.0)
    assert (found.due["all"]["sounding"] if found.due else 0) == (target & played).sum()


def test_arrays_of_different_shapes_are_refused():
    keys = np.zeros((2, 88), dtype=bool)
    with pytest.raises(ValueError, match=r"one shape, got \(2, 88\) and \(3, 88\)"):
        losses_of(keys, np.zeros((3, 88)), keys, keys)
    with pytest.raises(ValueError, match=r"shape of the keys, \(2, 88\), got \(1, 88\)"):
        losses_of(keys, keys, np.zeros((1, 88)), keys)
