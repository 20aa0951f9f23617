"""The text of a piece becomes the notes that it means, or an error that says where."""

from __future__ import annotations

from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sb3_piano.exceptions import ScoreError
from sb3_piano.music import Pedal
from sb3_piano.music.pitch import pitch_name
from sb3_piano.music.repertoire import read_header, read_notes

# A unit is half a second, a bar four of them.
HEADER = {
    "title": "Try",
    "composer": "nobody",
    "source": "made up",
    "fingering": "ours",
    "tempo": "60",
    "meter": "2/4",
    "unit": "1/8",
}


@pytest.fixture
def path(tmp_path):
    return tmp_path / "Try.notes"


def fill(path, bars="bar 1\nR: C4/1*4\n", **header):
    lines = [f"{key}: {value}" for key, value in {**HEADER, **header}.items() if value is not None]
    path.write_text("\n".join([*lines, bars]), encoding="utf-8")
    return path


@pytest.fixture
def play(path):
    """Return what bars mean, as (onset, offset, pitch, finger) in units and pianists' numbers."""

    def read(bars, **header):
        score = read_notes(fill(path, bars, **header))
        return [
            (note.onset * 2, note.offset * 2, pitch_name(note.pitch), f"{note.hand[0]}{finger}")
            for note in score.notes
            for finger in [note.finger % 5 + 1]
        ]

    return read


def test_the_header_says_what_is_known_about_the_piece(path):
    fill(
        path,
        source="a print\n   of 1801  # the second\n\n   is free",
        simplified="no trills",
        tempo="66.5",
        meter="3/8",
        unit="1/16",
        release="left 0.1",
        velocity="right 90 left 60",
    )
    header = read_header(path)
    assert (header.title, header.composer, header.fingering) == ("Try", "nobody", "ours")
    assert header.source == "a print of 1801 is free"
    assert header.simplified == "no trills"
    assert header.tempo == Fraction(133, 2)
    assert header.meter == Fraction(3, 8)
    assert header.bar_length == 6
    assert header.release == {"right": 0, "left": Fraction(1, 10)}
    assert header.velocity == {"right": 90, "left": 60}


def test_what_the_header_may_leave_out_has_its_usual_value(path):
    header = read_header(fill(path))
    assert header.simplified == ""
    assert header.release == {"right": 0, "left": 0}
    assert header.velocity == {"right": 80, "left": 80}


def test_notes_follow_each_other_and_have_the_fingers_of_their_hand(play):
    assert play("bar 1\nR: C4/1 - F#5/4*2\nL: Bb2/5*3 Cb3/2") == [
        (0, 3, "Bb2", "l5"),
        (0, 1, "C4", "r1"),
        (2, 4, "F#5", "r4"),
        (3, 4, "B2", "l2"),
    ]


def test_the_notes_of_a_chord_have_a_finger_each(play):
    assert play("bar 1\nR: C4+E4+G#4/135*4") == [
        (0, 4, "C4", "r1"),
        (0, 4, "E4", "r3"),
        (0, 4, "Ab4", "r5"),
    ]


def test_lengths_are_whole_numbers_fractions_or_decimals(play):
    notes = play("bar 1\nR: C4/1*3/2 D4/2*0.5 E4/3*2")
    assert [(start, end) for start, end, *_ in notes] == [(0, 1.5), (1.5, 2), (2, 4)]


def test_a_third_of_a_unit_taken_thrice_is_one_unit(path):
    score = read_notes(fill(path, "bar 1\nR: C4/1*1/3 D4/2*1/3 E4/3*1/3 F4/4*3\nL: -*1 F3/1*3"))
    assert score.notes[2].offset == score.notes[3].onset == score.notes[4].onset == 0.5


def test_voices_of_one_hand_start_together(play):
    assert play("bar 1\nL: C3/5*4\nL: - E3/2 G3/1*2") == [
        (0, 4, "C3", "l5"),
        (1, 2, "E3", "l2"),
        (2, 4, "G3", "l1"),
    ]


def test_a_dotted_note_is_held_for_half_of_its_length(play):
    assert play("bar 1\nR: C4/1' D4+F4/24'*3", release="right 0.05") == [
        (0, 0.5, "C4", "r1"),
        (1, 2.5, "D4", "r2"),
        (1, 2.5, "F4", "r4"),
    ]


def test_each_hand_lets_go_of_its_notes_earlier_by_its_release(play):
    assert play("bar 1\nR: C4/1*4\nL: C3/5*4", release="right 0.25 left 0.5") == [
        (0, 3, "C3", "l5"),
        (0, 3.5, "C4", "r1"),
    ]


def test_a_short_note_is_held_for_half_of_its_length_at_least(play):
    assert play("bar 1\nR: C4/1*0.5 D4/2*3.5", release="right 0.2")[0][:2] == (0, 0.25)


def test_a_tie_makes_one_note_whose_finger_is_the_first(play):
    bars = "bar 1\nR: C4/1 E4/2*3~\nL: C3+G3/51*4~\nbar 2\nR: E4/4 F4/3*3\nL: C3+G3/42*2 -*2"
    assert play(bars) == [
        (0, 6, "C3", "l5"),
        (0, 6, "G3", "l1"),
        (0, 1, "C4", "r1"),
        (1, 5, "E4", "r2"),
        (5, 8, "F4", "r3"),
    ]


def test_a_tie_goes_over_several_notes_and_stays_in_its_voice(play):
    bars = "bar 1\nR: C4/1*4~\nR: E4/3*4\nbar 2\nR: C4/1*4~\nR: C4/5*4\nbar 3\nR: C4/1*4"
    assert play(bars) == [
        (0, 12, "C4", "r1"),
        (0, 4, "E4", "r3"),
        (4, 8, "C4", "r5"),
    ]


def test_voices_are_counted_in_each_hand_for_itself(play):
    bars = "bar 1\nR: E4/3*4\nL: C3/5*4~\nbar 2\nL: C3/5*4\nbar 3\nL: C3/5*4~\nbar 4\nR: E4/3*4\n"
    assert [(start, end) for start, end, pitch, _ in play(bars + "L: C3/5*4") if pitch == "C3"] == [
        (0, 8),
        (8, 16),
    ]


def test_a_tie_lets_go_before_its_end_only(play):
    bars = "bar 1\nR: C4/1*4~\nbar 2\nR: C4/1*4"
    assert play(bars, release="right 0.5") == [(0, 7, "C4", "r1")]


def test_a_bar_can_be_played_again_under_another_name(play):
    bars = "bar 1 length=2\nR: C4/1*2\nP: 0-1\nbar 2\nR: D4/2*4\nbar 3 = 1\nbar 4=3"
    assert play(bars) == [
        (0, 2, "C4", "r1"),
        (2, 6, "D4", "r2"),
        (6, 8, "C4", "r1"),
        (8, 10, "C4", "r1"),
    ]


def test_a_bar_played_again_goes_on_in_the_tempo_of_the_bar_before(play):
    bars = "bar 1 tempo=120\nR: C4/1*4\nbar 2 tempo=60\nR: D4/1*4\nbar 3 = 1\nbar 4 = 1 tempo=30"
    assert [start for start, *_ in play(bars)] == [0, 2, 6, 10]


def test_ties_and_pedal_are_played_again_with_their_bar(path):
    bars = "bar 1\nR: C4/1*4~\nP: 0-1\nbar 2 = 1\nbar 3\nR: C4/1*4"
    score = read_notes(fill(path, bars))
    assert [(note.onset, note.offset) for note in score.notes] == [(0, 6)]
    assert [pedal.onset for pedal in score.pedals] == [0, 2]


def test_the_tempo_of_a_bar_lasts_until_the_next_one_that_says_another(play):
    bars = "bar 1\nR: C4/1*4\nbar 2 tempo=30\nR: D4/2*4~\nbar 3\nR: D4/2*2 -*2\nbar 4 tempo=120\n"
    assert play(bars + "R: E4/3*4") == [
        (0, 4, "C4", "r1"),
        (4, 16, "D4", "r2"),
        (20, 22, "E4", "r3"),
    ]


def test_a_hand_without_a_line_rests(path):
    score = read_notes(fill(path, "bar 1\nbar 2\nL: C3/1*4\nbar 3"))
    assert [(note.onset, note.hand) for note in score.notes] == [(2.0, "left")]
    assert score.bars == (0, 2, 4)


def test_the_pedal_is_down_from_unit_to_unit(path):
    bars = "bar 1\nR: C4/1*4\nP: 0-1/2 1.5-4\nbar 2 tempo=120\nR: C4/1*4\nP: 0-2\n   2.5-4"
    assert read_notes(fill(path, bars)).pedals == (
        Pedal(onset=0, offset=0.25),
        Pedal(onset=0.75, offset=2.5),
        Pedal(onset=2.625, offset=3),
    )


def test_each_hand_has_its_velocity(path):
    score = read_notes(fill(path, "bar 1\nR: C4/1*4\nL: C3/1*4", velocity="left 50"))
    assert [(note.hand, note.velocity) for note in score.notes] == [("left", 50), ("right", 80)]


def test_an_upbeat_has_no_bar_line_and_the_other_bars_have(path):
    bars = "bar 0 length=1\nR: C4/1\nbar 1\nR: C4/1*4\nbar 2 length=3\nR: C4/1*3\nbar 3"
    assert read_notes(fill(path, bars)).bars == (0.5, 2.5, 4)
    bars = "bar 1\nR: C4/1*4\nbar 2 length=1\nR: C4/1"
    assert read_notes(fill(path, bars)).bars == (0, 2)


def test_a_first_bar_longer_than_the_meter_is_no_upbeat(path):
    assert read_notes(fill(path, "bar 1 length=6\nR: C4/1*6")).bars == (0,)


def test_the_title_is_the_name_of_the_piece(path):
    assert read_notes(fill(path)).title == "Try"


def test_comments_blank_lines_and_line_breaks_mean_nothing(play):
    plain = play("bar 1\nR: C4/1 F#4/2 G4/3*2\nL: C3/5*4")
    assert plain == play(
        "# a tune\n\n  # in two bars\nbar 1  # the first\n\nR: C4/1  #F\n\n  F#4/2\t# sharp\n"
        "\tG4/3*2\n# left\nL:C3/5*4  \n"
    )


@st.composite
def pieces(draw):
    """Bars as text, and the notes that they mean: (onset, offset, pitch, finger), in whole notes.

    Each voice is drawn as notes of some lengths, which are then cut at the bar lines and tied.
    """
    lengths = draw(st.lists(st.integers(1, 9), min_size=1, max_size=4))
    bars = [[f"bar {number} length={length}"] for number, length in enumerate(lengths)]
    expected = []
    for hand in draw(st.lists(st.sampled_from("RL"), min_size=1, max_size=3)):
        rows = [[] for _ in lengths]
        at, end = Fraction(0), sum(lengths)
        while at < end:
            length = min(draw(st.fractions(Fraction(1, 6), 7, max_denominator=6)), end - at)
            chord = draw(
                st.dictionaries(st.integers(21, 108), st.integers(1, 5), min_size=0, max_size=3)
            )
            expected += [
                (at, at + length, pitch, finger - 1 + (5 if hand == "L" else 0))
                for pitch, finger in chord.items()
            ]
            add_cut(rows, lengths, at, length, chord)
            at += length
        for lines, row in zip(bars, rows, strict=True):
            lines.append(f"{hand}: {' '.join(row)}")
    return "\n".join(line for lines in bars for line in lines), expected


def add_cut(rows, lengths, at, length, chord):
    """Write a note into the rows of its bars, a part in each."""
    start = 0
    names = "+".join(pitch_name(pitch) for pitch in chord)
    for row, bar in zip(rows, lengths, strict=True):
        first, last = max(at, start), min(at + length, start + bar)
        start += bar
        if first < last:
            touches = f"{names}/{''.join(map(str, chord.values()))}" if chord else "-"
            tie = "~" if chord and last < at + length else ""
            row.append(f"{touches}*{last - first}{tie}")


@pytest.mark.slow
@given(pieces())
@settings(max_examples=150, deadline=None)
def test_whatever_is_written_is_played(tmp_path_factory, piece):
    bars, expected = piece
    path = fill(tmp_path_factory.mktemp("random") / "Try.notes", bars)
    if not expected:
        with pytest.raises(ScoreError, match="no notes"):
            read_notes(path)
        return
    found = [(note.onset, note.offset, note.pitch, note.finger) for note in read_notes(path).notes]
    in_seconds = [(float(a / 2), float(b / 2), *touch) for a, b, *touch in expected]
    assert sorted(found) == sorted(in_seconds)


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ({"title": None}, r"'Try.notes' does not say its title: expected a line such as 'title: "),
        ({"tempo": None, "unit": None}, r"does not say its tempo, unit: expected"),
        ({"titel": "x"}, r"begins with 'titel: x'\. Did you mean 'title'\? Expected 'key: value'"),
        ({"title": ""}, r"'Try.notes' has no text after 'title:': expected a value"),
        ({"title": "x\ntitle: y"}, r"'Try.notes' says 'title' twice: expected it once"),
        ({"title": "x\nR: C4/1"}, r"begins with 'R: C4/1'.* or 'bar' and its name"),
        ({"tempo": "fast"}, r"'Try.notes', tempo: 'fast' is not valid: expected quarter notes"),
        ({"tempo": "0"}, r"tempo: '0' is not valid: expected quarter notes per minute"),
        ({"meter": "3/0"}, r"meter: '3/0' is not valid: expected a meter, such as 3/4"),
        ({"unit": "-1/8"}, r"unit: '-1/8' is not valid: expected a part of a whole note"),
        ({"unit": "1e-3"}, r"unit: '1e-3' is not valid"),
        ({"release": "0.1"}, r"release: '0.1' is not valid: expected 'right 0.05 left 0.1'"),
        ({"release": "both 0.1"}, r"release: 'both 0.1' is not valid"),
        ({"release": "right 1 right 2"}, r"release: 'right 1 right 2' is not valid"),
        ({"release": "left -0.1"}, r"release: '-0.1' is not valid"),
        ({"velocity": "left 128"}, r"velocity: 'left 128' is not valid: .* from 1 to 127"),
        ({"velocity": "left 0"}, r"velocity: 'left 0' is not valid: .* from 1 to 127"),
        ({"velocity": "left 80.5"}, r"velocity: 'left 80.5' is not valid: .* from 1 to 127"),
    ],
)
def test_a_bad_header_is_refused(path, header, message):
    fill(path, **header)
    with pytest.raises(ScoreError, match=message):
        read_header(path)


@pytest.mark.parametrize(
    ("bars", "message"),
    [
        ("bar 1\nR: C4/1*3", r"Bar 1 of 'Try.notes', right hand, line 1: .* 3 units: expected 4"),
        ("bar 1\nL: C4/1*4\nL: C3/5*13/3", r"left hand, line 2: .* to 13/3 units: expected 4"),
        ("bar 1\nR:", r"right hand, line 1: .* add up to 0 units: expected 4"),
        ("bar 1 length=2\nR: C4/1*4", r"add up to 4 units: expected 2"),
        ("bar 1\nR: H4/1*4", r"Bar 1 of 'Try.notes', right hand: 'H4/1\*4' is no note: expected"),
        ("bar 1\nL: C4/6*4", r"left hand: 'C4/6\*4' is no note: .* fingers are 1 to 5"),
        ("bar 1\nL: C4*4", r"left hand: 'C4\*4' is no note"),
        ("bar 1\nR: -~ C4/1*3", r"right hand: '-~' is no note: .* neither rests nor notes with"),
        ("bar 1\nR: -' C4/1*3", r"right hand: \"-'\" is no note"),
        ("bar 1\nR: C4/1'~ C4/1*3", r"right hand: \"C4/1'~\" is no note"),
        ("bar 1\nR: C4/1~*4", r"right hand: 'C4/1~\*4' is no note"),
        ("bar 1\nR: C4+E4/1*4", r"'C4\+E4/1\*4' has 1 fingers: expected one for each of its 2"),
        ("bar 1\nR: C4/13*4", r"'C4/13\*4' has 2 fingers: expected one for each of its 1 notes"),
        ("bar 1\nR: C4/1*0 D4/2*4", r"'C4/1\*0': '0' is not valid: expected a length in units"),
        ("bar 1\nR: C4/1*x", r"'C4/1\*x': 'x' is not valid: expected a length in units above 0"),
        ("bar 1\nR: C4/1*-1", r"'-1' is not valid: expected a length"),
        ("bar 1\nR: C0/1*4", r"Bar 1 .*right hand, 'C0/1\*4': pitch 12 is out of range"),
        ("bar 1\nR: C4/1*4\nX: 1", r"Bar 1 of 'Try.notes' has the line 'X: 1': expected 'R:'"),
        ("bar 1\nR C4/1*4", r"has the line 'R C4/1\*4': expected 'R:' \(right hand\)"),
        ("bar 1\nR: C4/1*4\ntempo: 5", r"has the line 'tempo: 5'"),
        ("bar 1\nP: 2-1", r"Bar 1 of 'Try.notes', pedal: '2-1' is not valid: expected when it"),
        ("bar 1\nP: 1-1", r"pedal: '1-1' is not valid"),
        ("bar 1\nP: 1", r"pedal: '' is not valid: expected when it goes down and when up"),
        ("bar 1\nP: 0-5", r"pedal: it is down from 0 to 5: expected .* up to 4"),
        ("bar 1\nP: 2-3 1-2", r"pedal: it is down from 1 to 2: expected one press after the other"),
        ("bar", r"'bar' in 'Try.notes' begins no bar: expected 'bar 5', 'bar 5 = 1', and maybe"),
        ("bar 1 lenght=2", r"'bar 1 lenght=2' in 'Try.notes' begins no bar"),
        ("bar 1 length=0", r"Bar 1 .*, length: '0' is not valid: expected a length in units"),
        ("bar 1 tempo=slow", r"Bar 1 .*, tempo: 'slow' is not valid: expected quarter notes"),
        ("bar 1 tempo=5 tempo=6", r"Bar 1 of 'Try.notes' says 'tempo' twice: expected it once"),
        ("bar 1\nbar 1", r"Bar 1 of 'Try.notes' is there twice: expected another name"),
        ("bar 1 = 2\nbar 2", r"Bar 1 .* plays bar '2': expected the name of an earlier bar"),
        ("bar 1\nbar 2 = 1\nR: C4/1*4", r"Bar 2 .* plays bar '1', and has lines of its own"),
        ("bar 1\nR: C4/1*4\nbar 2 = 1 length=3", r"Bar 2 .* add up to 4 units: expected 3"),
        ("bar 1\nR: C4/1*2~ D4/2*2", r"right hand: 'D4/2\*2' follows the tie of 'C4/1\*2~': "),
        (
            "bar 1\nR: C4/1*2~ -*2",
            r"right hand: '-\*2' follows the tie of 'C4/1\*2~': expected the",
        ),
        ("bar 1\nR: C4/1*2~ C4/1'*2", r"\"C4/1'\*2\" follows the tie .*, without a dot"),
        ("bar 1\nL: C4/1*4~\nbar 2", r"Bar 2 .*, left hand, line 1: nothing follows the tie of"),
        ("bar 1\nR: -*4\nR: C4/1*4~\nbar 2\nR: C4/1*4", r"Bar 2 .*, line 2: nothing follows"),
        ("bar 1\nR: C4/1*4~", r"The end of 'Try.notes', right hand, line 1: nothing follows"),
        ("bar 1", r"'Try' has no notes"),
        ("", r"'Try' has no notes"),
    ],
)
def test_bad_bars_are_refused_with_their_place(path, bars, message):
    with pytest.raises(ScoreError, match=message):
        read_notes(fill(path, bars))


@pytest.mark.parametrize("read", [read_header, read_notes])
def test_what_is_no_text_file_is_refused(tmp_path, read):
    with pytest.raises(ScoreError, match=r"There is no file of music as text '.*none.notes'"):
        read(tmp_path / "none.notes")
    damaged = tmp_path / "Try.notes"
    damaged.write_bytes(b"title: \xff\xfe")
    with pytest.raises(ScoreError, match=r"Cannot read .*expected UTF-8 text"):
        read(damaged)


def test_reading_the_header_does_not_read_the_bars(path):
    assert read_header(fill(path, "bar 1\nR: what?")).title == "Try"
