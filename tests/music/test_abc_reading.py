"""Notes written in ABC are read as the standard says, and mistakes are told."""

from __future__ import annotations

import pytest

from sb3_piano.exceptions import ConfigError, ScoreError
from sb3_piano.music.corpus import Corpus
from sb3_piano.music.encore.abc_reading import LIFT, read_abc, read_header

# An eighth lasts half a second.
HEADER = "X:1\nT:A study\nM:{meter}\nL:1/8\nQ:1/4=60\nK:{key}\n"


@pytest.fixture
def read(tmp_path):
    """Read lines below a header."""

    def read(*lines, meter="4/4", key="C"):
        path = tmp_path / "study.abc"
        path.write_text(HEADER.format(meter=meter, key=key) + "\n".join(lines) + "\n")
        return read_abc(path, "study")

    return read


def pitches(score):
    return [note.pitch for note in score.notes]


def onsets(score):
    return [round(note.onset, 6) for note in score.notes]


def test_octaves_are_those_of_the_standard(read):
    assert pitches(read("[V:R] C,CBc b c'z2 |]")) == [48, 60, 71, 72, 83, 84]


@pytest.mark.parametrize(
    ("key", "expected"),
    [
        ("C", [65, 67, 69, 71]),
        ("D", [66, 67, 69, 71]),
        ("Em", [66, 67, 69, 71]),
        ("Bb", [65, 67, 69, 70]),
        ("Cm", [65, 67, 68, 70]),
        ("C#m", [66, 68, 69, 71]),
        ("Ab", [65, 67, 68, 70]),
    ],
)
def test_a_key_alters_the_notes_of_all_octaves(read, key, expected):
    assert pitches(read("[V:R] FGAB f4 |]", key=key)) == [*expected, expected[0] + 12]


def test_an_accidental_holds_in_its_octave_up_to_the_bar_line(read):
    score = read("[V:R] ^FFf=F _B_B__B^^C | B8 |]")
    assert pitches(score) == [66, 66, 77, 65, 70, 70, 69, 62, 71]


def test_lengths_count_in_the_unit_and_rests_are_silent(read):
    score = read("[V:R] C2z3/2D/E3x |]")
    assert onsets(score) == [0, 1.75, 2]
    assert score.notes[2].offset == pytest.approx(3.5 - LIFT)


def test_the_notes_of_a_triplet_take_the_time_of_two(read):
    assert onsets(read("[V:R] (3CDE (3C2D2[EG]2 z2 |]")) == pytest.approx(
        [0, 1 / 3, 2 / 3, 1, 5 / 3, 7 / 3, 7 / 3], abs=1e-6
    )


def test_ties_join_notes_also_of_chords_and_over_bar_lines(read):
    score = read("[V:R] z4[CE-]2[EGB]2- | [EGB-]2 B2 z4 |]")
    held = {note.pitch: (note.onset, note.offset) for note in score.notes}
    expected = {60: (2, 3), 64: (2, 5), 67: (3, 5), 71: (3, 6)}
    assert held == {pitch: pytest.approx((on, off - LIFT)) for pitch, (on, off) in expected.items()}


def test_hands_are_those_of_the_voices_which_sound_together(read):
    score = read(
        "[V:R] c8 |", "[V:L] C,8 |", "[V:R2] zE7 |", "[V:R] d8 |]", "[V:L] x8 |]", "[V:R2] x8 |]"
    )
    assert [(note.pitch, note.hand) for note in score.notes] == [
        (48, "left"),
        (72, "right"),
        (64, "right"),
        (74, "right"),
    ]


def test_a_key_is_let_go_in_time_to_be_struck_again_by_another_voice(read):
    score = read("[V:R] E8 |]", "[V:R2] z4E2z2 |]", "[V:L] E2z6 |]")
    assert [(note.onset, note.hand) for note in score.notes] == [(0, "right"), (2, "right")]
    assert score.notes[0].offset == pytest.approx(2 - LIFT)


def test_short_notes_are_held_for_half_of_their_length(read):
    score = read("[V:R] C/8D/8z7/4E4z2 |]")
    assert [note.duration for note in score.notes[:2]] == pytest.approx([1 / 32, 1 / 32])


def test_the_pedal_comes_up_before_it_goes_down_again_and_at_the_end(read):
    score = read("[V:L] !ped!C2!ped!C2z2!ped-up!C2 | z4!ped!C4 |]")
    assert [(p.onset, p.offset) for p in score.pedals] == [
        pytest.approx(press) for press in [(0, 1 - LIFT), (1, 3 - LIFT), (6, 8 - LIFT)]
    ]


def test_bars_begin_after_the_upbeat_and_the_last_may_be_short(read):
    assert read("[V:R] C2 | D8 | E4 |]").bars == (1, 5)
    assert read("[V:R] C6 | D6 |]", meter="3/4").bars == (0, 3)


def test_fields_of_several_lines_are_one_text(tmp_path):
    path = tmp_path / "study.abc"
    path.write_text("X:1\nT:A study\nS:the first line\nS:and the second\nK:C\n[V:R] C8 |]\n")
    assert read_header(path)["S"] == "the first line and the second"
    assert set(read_header(path)) == {"X", "T", "S", "K"}


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (["[V:R] C8 |", "[V:R] D7 |", "[V:R] E8 |]"], "expected each 1"),
        (["[V:R] C8 | D8 |]", "[V:L] C8 | D7 |]"], "bar line 2 of voice L is at 15/8"),
        (["[V:R] C8 | D8 |]", "[V:L] C8 |]"], "bar line 2 of voice L is at None"),
        (["[V:R] C4 D4- |]"], "voice R does not end with a whole bar and no tie"),
        (["[V:R] C8 | D2"], "voice R does not end with a whole bar"),
        (["[V:R] C4 {g}D4 |]"], r"'\{g\}D4 \|\]' is not read: expected notes"),
        (["[V:R] [CE]4- [CF]4 |]"], r"a tie before ' \|\]' has no note to go on with"),
        (["C8 |]"], "line 'C8 |]' has no voice"),
    ],
)
def test_what_does_not_add_up_or_is_not_read_is_told(read, lines, message):
    with pytest.raises(ScoreError, match=message):
        read(*lines)


def test_a_key_that_is_none_is_told(read):
    with pytest.raises(ScoreError, match="Key 'Hmaj' is not valid: expected one such as C, F#m"):
        read("[V:R] C8 |]", key="Hmaj")


def test_no_corpus_is_made_of_the_encores():
    with pytest.raises(ConfigError, match="Unknown source 'encore'"):
        Corpus(sources={"encore": 1})
