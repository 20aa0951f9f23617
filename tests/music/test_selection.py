"""Entries that stand for pieces: names, patterns, collections, files and lists of these."""

from pathlib import Path

import pytest
from short_scores import score_of
from yaml_rows import Tables

from sb3_piano import exceptions
from sb3_piano.exceptions import ConfigError, ScoreError, UnknownPieceError
from sb3_piano.music import BUILT_IN, load_score, select_pieces, write_midi, write_score
from sb3_piano.music.catalogue import shown_title
from sb3_piano.music.formats.pig import write_pig

tables = Tables(__file__)
SCORE = score_of((0.0, 0.5, 60), title="piece")


@pytest.fixture
def corpus(tmp_path):
    """A folder with files a.mid, b.mid and deep/c.mid."""
    for name in ("b.mid", "a.mid", "deep/c.mid"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        write_midi(SCORE, tmp_path / name)
    return tmp_path


def test_names_are_completed_and_kept_in_order():
    *found, last = select_pieces(["FurElise", "scale-CMajor", "TwinkleTwinkleLittleStar"])
    assert found == ["repertoire-FurElise", "scale-CMajor"]
    assert load_score(last).title == "TwinkleTwinkleLittleStar"


def test_patterns_and_collections_stand_for_all_their_pieces():
    majors = [name for name in BUILT_IN if name.startswith("scale-") and name.endswith("Major")]
    assert select_pieces("scale-*Major") == sorted(majors)
    assert len(majors) == 12
    repertoire = [name for name, piece in BUILT_IN.items() if piece.collection == "repertoire"]
    assert select_pieces(["repertoire"]) == repertoire


def test_a_piece_that_several_entries_stand_for_is_there_once():
    found = select_pieces(["scale-DMajor", SCORE, "scale-?Major", SCORE, "scale-CMajor"])
    assert found[:2] == ["scale-DMajor", SCORE]
    assert len(found) == 8
    assert len(set(map(str, found))) == 8


def test_files_are_found_by_path_and_by_pattern(corpus, monkeypatch):
    monkeypatch.chdir(corpus)
    assert select_pieces("b.mid") == [str(corpus / "b.mid")]
    assert select_pieces([corpus / "b.mid", "./*.mid"]) == [
        str(corpus / "b.mid"),
        str(corpus / "a.mid"),
    ]
    deep = [str(corpus / name) for name in ("a.mid", "b.mid", "deep/c.mid")]
    assert select_pieces(str(corpus / "**/*.mid")) == deep


def test_a_file_whose_name_has_brackets_is_a_file(corpus):
    (corpus / "a.mid").rename(corpus / "a[1].mid")
    assert select_pieces([str(corpus / "a[1].mid")]) == [str(corpus / "a[1].mid")]


def test_a_list_has_an_entry_in_each_line_and_paths_from_its_folder(corpus, monkeypatch):
    (corpus / "b.mid").rename(corpus / "01 Bach - Prelude No. 1 in C.mid")
    lines = ["01 Bach - Prelude No. 1 in C.mid", "deep/*.mid  # one", "scale-CMajor", "./a.mid"]
    lines = ["# all there is", "", *lines]
    (corpus / "corpus.txt").write_text("\n".join(lines))
    expected = [str(corpus / lines[2]), str(corpus / "deep/c.mid"), "scale-CMajor"]
    expected.append(str(corpus / "a.mid"))
    assert select_pieces(str(corpus / "corpus.txt")) == expected
    assert select_pieces([corpus / "corpus.txt", "scale-CMajor"]) == expected
    monkeypatch.setenv("HOME", str(corpus))
    assert select_pieces("~/corpus.txt") == expected


def test_a_list_may_begin_with_a_byte_order_mark_and_name_files_with_sharps(corpus):
    (corpus / "a.mid").rename(corpus / "Prelude in C# minor.mid")
    text = "scale-CMajor # first\nPrelude in C# minor.mid\n"
    (corpus / "corpus.txt").write_text(text, encoding="utf-8-sig")
    expected = ["scale-CMajor", str(corpus / "Prelude in C# minor.mid")]
    assert select_pieces(str(corpus / "corpus.txt")) == expected


def test_a_file_of_the_pig_data_set_is_a_piece_however_it_was_found(corpus):
    write_pig(load_score("scale-CMajor"), corpus / "1_fingering.txt")
    found = select_pieces(str(corpus / "*_fingering.txt"))
    assert found == select_pieces(found) == [str(corpus / "1_fingering.txt")]


def test_a_thousand_are_selected_without_reading_one(tmp_path):
    for number in range(1000):
        (tmp_path / f"{number:04}.mid").write_bytes(b"")
    (tmp_path / "all.txt").write_text("\n".join(f"./{n:04}.mid" for n in range(1000)))
    assert len(select_pieces(tmp_path / "all.txt")) == 1000
    assert len(select_pieces(str(tmp_path / "*.mid"))) == 1000


@tables("entries, error, message")
def test_what_stands_for_nothing_is_refused(entries, error, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(getattr(exceptions, error), match=message):
        select_pieces(entries)


def test_a_list_in_a_list_is_refused_with_its_line(tmp_path):
    (tmp_path / "a.txt").write_text("scale-CMajor\nb.txt\n")
    with pytest.raises(ConfigError, match=r"a.txt', line 2: 'b.txt' is another list"):
        select_pieces(tmp_path / "a.txt")


# What one entry stands for is loaded, or refused by name.


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
    for there in ("a.mscz", "a.zip"):  # a file that is there is no unknown piece
        (tmp_path / there).write_bytes(b"PK")
    name = (
        r"Unknown piece 'CMajorScaleTwoHand'\. Did you mean .*TwoHands'.* Expected a name from "
        r"'sb3-piano pieces list' or the path of a file"
    )
    for source, error, message in (
        ("CMajorScaleTwoHand", UnknownPieceError, name),
        ("music/etude.wav", ScoreError, r"Cannot tell the format of '.*etude.*\.txt file"),
        (Path("etude"), ScoreError, r"Cannot tell the format of '.*etude.*\.txt file"),
        ("a.mscz", ScoreError, r"format of 'a.mscz'.*Export it as MusicXML"),
        ("a.zip", ScoreError, r"format of 'a.zip'.*named by the folder of its run"),
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


def test_thousands_are_selected_without_reading_one(tmp_path):
    for number in range(3000):
        (tmp_path / f"{number:04}.mid").write_bytes(b"")
    (tmp_path / "all.txt").write_text("\n".join(f"./{n:04}.mid" for n in range(3000)))
    assert len(select_pieces(tmp_path / "all.txt")) == 3000
    assert len(select_pieces(str(tmp_path / "*.mid"))) == 3000
