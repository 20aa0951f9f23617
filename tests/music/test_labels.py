"""Finger labels from a file find their notes."""

import contextlib
import dataclasses

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from short_scores import score_of
from yaml_rows import Tables

from sb3_piano.exceptions import ScoreError
from sb3_piano.music import Score, write_midi
from sb3_piano.music.fingering.labels import read_labels
from sb3_piano.music.formats import write_pig

tables = Tables(__file__)

PLAIN = score_of(
    *((0.5 * i, 0.5 * i + 0.4, 60 + i) for i in range(4)),
    pedals=[(0.2, 0.9)],
    title="plain",
    bars=[0.0, 1.0],
)


@pytest.fixture
def table(tmp_path):
    """Return a function that writes a CSV file and returns its path."""

    def write(*lines, name="labels.csv"):
        path = tmp_path / name
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return path

    return write


def fingers(score):
    return [note.finger for note in score.notes]


def test_a_table_gives_fingers_as_ours_or_by_hand(table):
    ours = table("onset,pitch,finger", "0,60,0", "0.5,61,1", "1.0,62,5", "1.5,63,9")
    by_hand = table(
        "finger, Pitch, Onset, hand, certainty",
        "1,C4,0.0,right,0.9",
        "2,Db4,0.5,Right,0.8",
        "1,D4,1.0,left,0.7",
        "5,D#4,1.5,left,0.6",
        name="by_hand.csv",
    )
    for path in (ours, by_hand):
        found = read_labels(path, PLAIN)
        assert fingers(found) == [0, 1, 5, 9]
        bare = [dataclasses.replace(n, finger=-1, hand=None) for n in found.notes]
        assert Score(notes=bare, pedals=found.pedals, title="plain") == PLAIN
        assert found.bars == PLAIN.bars


@tables("lines, expected")
def test_tables_of_other_programs_are_read(table, lines, expected):
    assert fingers(read_labels(table(*lines), PLAIN)) == expected


def test_the_nearest_onset_within_the_tolerance_is_taken_and_each_note_once(table):
    repeated = score_of(*((t, t + 0.05, 60) for t in (0.0, 0.1, 0.2, 5.0)), title="repeated")
    # 0.16 is nearest to 0.2, which 0.19 is nearer to; 0.1 is then the next best.
    path = table("onset,pitch,finger", "0.01,60,0", "0.16,60,1", "0.19,60,2", "4.94,60,3")
    assert fingers(read_labels(path, repeated)) == [0, -1, 2, -1]
    assert fingers(read_labels(path, repeated, tolerance=0.06)) == [0, 1, 2, 3]
    assert fingers(read_labels(path, repeated, tolerance=0.059)) == [0, -1, 2, -1]


def test_notes_without_a_label_or_finger_keep_what_they_had_of_that_hand(table):
    known = score_of((0, 0.4, 60, 3), (0.5, 0.9, 61, 2), (1, 1.4, 62, "left"))
    found = read_labels(table("onset,pitch,finger", "0.5,61,1", "1.0,62,"), known)
    assert fingers(found) == [3, 1, -1]
    assert found.notes[2].hand == "left"
    path = table("onset,pitch,hand,finger", "0,60,right,", "0.5,61,left,", "1.0,62,left,")
    found = [(note.finger, note.hand) for note in read_labels(path, known).notes]
    assert found == [(3, "right"), (-1, "left"), (-1, "left")]


def test_labels_come_from_midi_and_pig_files_too(tmp_path):
    labelled = score_of(*((n.onset, n.offset, n.pitch, i) for i, n in enumerate(PLAIN.notes)))
    write_midi(labelled, tmp_path / "labels.mid")
    late = ((n.onset + 0.02, n.offset, n.pitch, n.finger + 5) for n in labelled.notes)
    write_pig(score_of(*late), tmp_path / "labels.txt")
    assert fingers(read_labels(tmp_path / "labels.mid", PLAIN)) == [0, 1, 2, 3]
    assert fingers(read_labels(tmp_path / "labels.txt", PLAIN)) == [5, 6, 7, 8]


def test_fewer_than_half_of_the_labels_finding_a_note_is_an_error(table):
    half = table("onset,pitch,finger", "0,60,0", "9,60,0")
    assert fingers(read_labels(half, PLAIN)) == [0, -1, -1, -1]
    less = table("onset,pitch,finger", "0,60,0", "9.25,60,0", "10,61,0")
    with pytest.raises(ScoreError) as error:
        read_labels(less, PLAIN)
    assert str(error.value) == (
        f"Only 1 of 3 labels of '{less}' find a note of 'plain' within 0.05 s; the first that does "
        "not is that of note 1 (C4 at 9.25 s). Expected labels of the same piece at the same tempo."
    )


@tables("lines, message")
def test_a_damaged_table_is_refused_with_its_line(table, lines, message):
    with pytest.raises(ScoreError, match=message):
        read_labels(table(*lines), PLAIN)


def test_a_file_without_labels_and_what_is_no_table_are_refused(tmp_path, table):
    write_midi(PLAIN, tmp_path / "plain.mid")
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "head.csv").write_text("onset" + 200_000 * "x")
    (tmp_path / "row.csv").write_text("onset,pitch,finger\n" + 200_000 * "0")
    table("onset,pitch,finger", "0,60,-1", name="none.csv")
    for name, message in (
        ("plain.mid", r"None of the 4 notes of '.*plain.mid' has a finger"),
        ("none.csv", "None of the 1 notes"),
        ("missing.csv", r"There is no table of labels '.*missing.csv'"),
        ("binary.csv", "Cannot read .* as a table of labels"),
        ("labels.pdf", "Cannot tell the format of '.*labels.pdf'"),
        ("head.csv", r"Line \d of '.*head.csv' is no row of a table"),
        ("row.csv", r"Line \d of '.*row.csv' is no row of a table"),
    ):
        with pytest.raises(ScoreError, match=message):
            read_labels(tmp_path / name, PLAIN)
    for tolerance in (-0.01, float("nan"), float("inf")):
        with pytest.raises(ScoreError, match="A tolerance of .* s is out of range: expected 0 or"):
            read_labels(table("onset,pitch,finger", "0,60,0"), PLAIN, tolerance=tolerance)


@pytest.mark.slow
@pytest.mark.parametrize("first", ["onset,pitch,finger", "onset,pitch,hand,finger,onset"])
@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    rows=st.lists(
        st.lists(st.one_of(st.floats(), st.integers(-2, 120), st.text(max_size=3)), max_size=5),
        max_size=3,
    )
)
def test_no_table_fails_with_anything_but_our_error(tmp_path, first, rows):
    path = tmp_path / "any.csv"
    text = "\n".join([first, *(",".join(map(str, row)) for row in rows)])
    path.write_text(text, encoding="utf-8", errors="surrogatepass")
    with contextlib.suppress(ScoreError):
        assert len(read_labels(path, PLAIN).notes) == 4
