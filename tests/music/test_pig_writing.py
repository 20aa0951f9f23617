import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sb3_piano.exceptions import ScoreError
from sb3_piano.music import MAX_PITCH, MIN_PITCH, Note, Score, load_score, read_pig
from sb3_piano.music.formats import read_pig_annotations, write_pig

LABELS = [(finger, None) for finger in range(10)] + [(-1, "right"), (-1, "left")]


@st.composite
def labelled_scores(draw):
    """Scores that know the hand of every note, with times of any precision."""
    times = st.floats(0, 1e4, allow_subnormal=False)
    notes = []
    for _ in range(draw(st.integers(1, 8))):
        onset, offset = sorted(draw(st.lists(times, min_size=2, max_size=2, unique=True)))
        finger, hand = draw(st.sampled_from(LABELS))
        pitch = draw(st.integers(MIN_PITCH, MAX_PITCH))
        velocity = draw(st.integers(1, 127))
        notes.append(
            Note(
                onset=onset, offset=offset, pitch=pitch, velocity=velocity, finger=finger, hand=hand
            )
        )
    return Score(notes=notes, title="piece")


@settings(max_examples=60, deadline=None)
@given(score=labelled_scores())
def test_a_labelled_score_comes_back_equal(score, tmp_path_factory):
    path = tmp_path_factory.getbasetemp() / "piece.txt"
    write_pig(score, path)
    assert read_pig(path) == score


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


def test_an_unknown_hand_is_chosen_by_the_pitch(tmp_path):
    notes = [Note(onset=0, offset=1, pitch=pitch) for pitch in (59, 60)]
    write_pig(Score(notes=notes), tmp_path / "a.txt")
    assert [note.hand for note in read_pig(tmp_path / "a.txt").notes] == ["left", "right"]


def test_a_missing_folder_is_refused(tmp_path):
    with pytest.raises(ScoreError, match=r"Cannot write '.*none/a\.txt': No such file"):
        write_pig(load_score("TwinkleTwinkleLittleStar"), tmp_path / "none" / "a.txt")


class TestAnnotators:
    SCORE = ((0.0, 60), (0.0, 64), (0.5, 62))

    def write(self, path, notes, fingers):
        notes = [
            Note(onset=onset, offset=onset + 1, pitch=pitch, finger=finger)
            for (onset, pitch), finger in zip(notes, fingers, strict=True)
        ]
        write_pig(Score(notes=notes), path)
        return path

    def test_are_read_in_order_each_with_its_fingers(self, tmp_path):
        paths = [
            self.write(tmp_path / f"001-{i}_fingering.txt", self.SCORE, fingers)
            for i, fingers in enumerate([(0, 2, 1), (1, 3, 2), (9, 7, 8)])
        ]
        scores = read_pig_annotations(str(path) for path in paths)
        assert [[note.finger for note in score.notes] for score in scores] == [
            [0, 2, 1],
            [1, 3, 2],
            [9, 7, 8],
        ]
        assert [score.title for score in scores] == [path.stem for path in paths]

    def test_may_differ_by_less_than_a_millisecond(self, tmp_path):
        moved = [(onset + 0.0009, pitch) for onset, pitch in self.SCORE]
        paths = [
            self.write(tmp_path / "1.txt", self.SCORE, (0, 2, 1)),
            self.write(tmp_path / "2.txt", moved, (0, 2, 1)),
        ]
        assert len(read_pig_annotations(paths)) == 2

    @pytest.mark.parametrize(
        ("notes", "message"),
        [
            (
                [(0.0, 60), (0.0, 65), (0.5, 62)],
                r"Note 1 of '.*2\.txt' is F4 at 0 s: expected E4 at 0 s as in '.*1\.txt'",
            ),
            (
                [(0.0, 60), (0.0, 64), (0.502, 62)],
                r"Note 2 of .* is D4 at 0\.502 s: expected D4 at",
            ),
            ([(0.0, 60), (0.0, 64)], r"2\.txt' has 2 notes: expected 3 as in '.*1\.txt'"),
            ([(0.0, 60), (0.0, 64), (0.5, 62), (1.0, 62)], "has 4 notes: expected 3"),
        ],
    )
    def test_of_other_notes_are_refused(self, notes, message, tmp_path):
        paths = [
            self.write(tmp_path / "1.txt", self.SCORE, (0, 2, 1)),
            self.write(tmp_path / "2.txt", notes, [0] * len(notes)),
        ]
        with pytest.raises(ScoreError, match=message):
            read_pig_annotations(paths)

    def test_one_is_enough_and_none_gives_none(self, tmp_path):
        path = self.write(tmp_path / "1.txt", self.SCORE, (0, 2, 1))
        assert len(read_pig_annotations([path])) == 1
        assert read_pig_annotations([]) == []
