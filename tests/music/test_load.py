from pathlib import Path

import pytest
from short_scores import score_of

from sb3_piano.exceptions import ConfigError, ScoreError, UnknownPieceError
from sb3_piano.music import BUILT_IN, load_score, write_midi, write_score
from sb3_piano.music.catalogue import shown_title

SCORE = score_of((0, 1, 60), title="piece")


def test_the_name_of_a_piece_makes_the_piece_with_or_without_its_collection():
    score = load_score("debug-TwinkleTwinkleLittleStar")
    assert score == BUILT_IN["debug-TwinkleTwinkleLittleStar"].score()
    assert score == load_score("TwinkleTwinkleLittleStar")


@pytest.mark.parametrize("name", ["piece.mid", "piece.midi", "piece.MID"])
def test_a_midi_file_is_read(tmp_path, name):
    write_midi(SCORE, tmp_path / name)
    assert load_score(str(tmp_path / name)) == load_score(tmp_path / name) == SCORE


def test_what_is_no_piece_is_refused_with_what_is_accepted(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.mscz").write_bytes(b"PK")  # a file that is there is no unknown piece
    name = (
        r"Unknown piece 'CMajorScaleTwoHand'\. Did you mean .*TwoHands'.* Expected a name from "
        r"'sb3-piano pieces list' or the path of a file"
    )
    for source, error, message in (
        ("CMajorScaleTwoHand", UnknownPieceError, name),
        ("music/etude.wav", ScoreError, r"Cannot tell the format of '.*etude.*\.txt file"),
        (Path("etude"), ScoreError, r"Cannot tell the format of '.*etude.*\.txt file"),
        ("a.mscz", ScoreError, r"format of 'a.mscz'.*Export it as MusicXML"),
        *(
            (source, ConfigError, f"cannot be given as {type(source).__name__}")
            for source in (7, None, b"etude.mid", [SCORE])
        ),
    ):
        with pytest.raises(error, match=message):
            load_score(source)


@pytest.mark.parametrize("suffix", ["mid", "txt", "musicxml"])
def test_a_missing_file_or_a_folder_is_refused_by_name_and_not_written(suffix, tmp_path):
    (tmp_path / f"folder.{suffix}").mkdir()
    for name in ("none/etude", "etude", "x" * 300, "folder"):
        path = tmp_path / f"{name}.{suffix}"
        with pytest.raises(ScoreError, match=f"There is no .* file '{path}'"):
            load_score(path)
    with pytest.raises(ScoreError, match=rf"Cannot write '.*none/a\.{suffix}': No such file"):
        write_score(SCORE, tmp_path / "none" / f"a.{suffix}")


def test_titles_of_built_in_pieces_are_those_that_people_write_and_others_stay():
    assert shown_title(load_score("FurElise").title) == "Für Elise (beginning)"
    assert shown_title("my own piece") == "my own piece"
    assert shown_title("") == ""


@pytest.mark.parametrize("suffix", ["txt", "musicxml"])
def test_where_a_file_needs_a_hand_an_unknown_one_is_chosen_by_the_pitch(suffix, tmp_path):
    write_score(score_of((0, 1, 59), (0, 1, 60)), tmp_path / f"a.{suffix}")
    assert [n.hand for n in load_score(tmp_path / f"a.{suffix}").notes] == ["left", "right"]
