import pytest
from hypothesis import given
from random_scores import FINGERS, HANDS, scores
from yaml_rows import Tables

from sb3_piano.exceptions import ScoreError, ScoreWarning
from sb3_piano.music import Note, Score
from sb3_piano.music.formats import write_pig
from sb3_piano.music.formats.pig import read_pig

tables = Tables(__file__)


def write(tmp_path, text):
    path = tmp_path / "etude.txt"
    path.write_text(text)
    return path


def line(**changes):
    names = ("id", "onset", "offset", "pitch", "velocity", "release", "channel", "finger")
    fields = dict(zip(names, ("0", "0.5", "1.0", "C4", "80", "64", "0", "1"), strict=True))
    return "\t".join({**fields, **changes}.values()) + "\n"


def read_line(tmp_path, **changes):
    return read_pig(write(tmp_path, line(**changes))).notes[0]


def test_a_whole_file_with_comments_blank_lines_and_spaces(tmp_path):
    text = (
        "//Version: PianoFingering_v170101\n"
        "0\t0.25\t0.75\tC4\t64\t80\t0\t1\n"
        "\n"
        "1 0.25 1.5 Bb2 70 80 1 -5\n"
        "  // the end\n"
    )
    assert read_pig(write(tmp_path, text)) == Score(
        notes=[
            Note(onset=0.25, offset=0.75, pitch=60, velocity=64, finger=0),
            Note(onset=0.25, offset=1.5, pitch=46, velocity=70, finger=9),
        ],
        title="etude",
    )


@tables("spelled, pitch")
def test_pitches_are_spelled_with_c4_as_60(tmp_path, spelled, pitch):
    assert read_line(tmp_path, pitch=spelled).pitch == pitch


@tables("text, finger")
def test_the_first_finger_counts_and_its_sign_is_the_hand(tmp_path, text, finger):
    assert read_line(tmp_path, finger=text).finger == finger


@pytest.mark.parametrize("finger", ["", "0"])
@pytest.mark.parametrize(("channel", "hand"), [("0", "right"), ("1", "left")])
def test_without_a_finger_the_channel_is_the_hand(tmp_path, channel, hand, finger):
    note = read_line(tmp_path, channel=channel, finger=finger)
    assert (note.finger, note.hand) == (-1, hand)


def test_what_no_piano_can_play_is_left_out_with_a_warning(tmp_path):
    text = line() + line(pitch="C9") + line(offset="0.5") + line(offset="0.25")
    message = (
        r"etude\.txt' left out 2 notes without length \(C4 at 0\.5 s, C4 at 0\.5 s\) and 1 note "
        r"off the keyboard \(C9 at 0\.5 s\)"
    )
    with pytest.warns(ScoreWarning, match=message):
        assert len(read_pig(write(tmp_path, text)).notes) == 1


@tables("changes, message")
def test_a_bad_field_is_named_with_file_and_line(tmp_path, changes, message):
    path = write(tmp_path, "// first\n" + line() + line(**changes))
    with pytest.raises(ScoreError, match=rf"Line 3 of '.*etude\.txt'.* ?{message}"):
        read_pig(path)


def test_what_is_no_text_is_refused_but_windows_line_ends_and_marks_are_read(tmp_path):
    path = tmp_path / "etude.txt"
    path.write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(ScoreError, match=r"Cannot read '.*etude\.txt' as a fingering file"):
        read_pig(path)
    path.write_bytes(b"\xef\xbb\xbf" + ("// first\n" + line()).replace("\n", "\r\n").encode())
    assert len(read_pig(path).notes) == 1
    with pytest.raises(ScoreError, match=r"onset velocity '1+\.\.\.1+' is not valid: expected 1"):
        read_line(tmp_path, velocity="1" * 5000)


@given(score=scores([*FINGERS, *HANDS]))
def test_a_labelled_score_comes_back_equal_but_for_the_pedal(score, tmp_path_factory):
    path = tmp_path_factory.getbasetemp() / "piece.txt"
    write_pig(score, path)
    assert read_pig(path) == Score(notes=score.notes, title="piece")


def test_the_lines_are_as_in_the_data_set(tmp_path):
    notes = [
        Note(onset=0.25, offset=0.75, pitch=70, velocity=64, finger=3),
        Note(onset=0.5, offset=1.5, pitch=54, velocity=70, finger=9),
        Note(onset=1, offset=2, pitch=21, hand="left"),
    ]
    write_pig(Score(notes=notes), tmp_path / "a.txt")
    assert (tmp_path / "a.txt").read_text() == (
        "//Version: PianoFingering_v170101\n"
        "0\t0.25\t0.75\tBb4\t64\t80\t0\t4\n"
        "1\t0.5\t1.5\tF#3\t70\t80\t1\t-5\n"
        "2\t1.0\t2.0\tA0\t80\t80\t1\t0\n"
    )
