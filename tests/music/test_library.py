import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from gymnasium.envs.registration import parse_env_id
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from random_scores import FINGERS, HANDS, scores

from sb3_piano.cli import main
from sb3_piano.exceptions import ConfigError, ScoreError, UnknownPieceError
from sb3_piano.music import BUILT_IN, Note, Pedal, Score, find_piece, load_score
from sb3_piano.music.difficulty import features
from sb3_piano.music.library import (
    DATA_VARIABLE,
    Library,
    imported_pieces,
    piece_features,
    pieces_folder,
)
from sb3_piano.music.library.store import check_name, is_built_in, slug

ONE_NOTE = Score(notes=[Note(onset=0, offset=1, pitch=60)], title="one")
TWO_NOTES = Score(
    notes=[
        Note(onset=0, offset=1, pitch=60, finger=0, velocity=7),
        Note(onset=0.1, offset=1 / 3, pitch=40, hand="left"),
    ],
    pedals=[Pedal(onset=0.2, offset=0.7)],
    title="two",
    bars=[0.0, 0.3],
)
FROM_NOWHERE = {"source": "nowhere", "fingering": "none"}


@pytest.fixture
def library():
    return Library()


def with_title(score, title):
    return Score(notes=score.notes, pedals=score.pedals, title=title, bars=score.bars)


def write_file(path, **arrays):
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, **arrays)


def header(**fields):
    return np.frombuffer(json.dumps(fields).encode(), dtype=np.uint8)


@pytest.mark.slow
@given(score=scores([*FINGERS, *HANDS, (-1, None)]))
def test_a_score_comes_back_bit_by_bit_with_its_name_as_title(score, tmp_path_factory):
    library = Library(tmp_path_factory.mktemp("library"))
    library.add(score, "piece", **FROM_NOWHERE)
    back = library.score("piece")
    # The text of a float is exact and tells -0.0 from 0.0.
    assert repr(back.notes) == repr(score.notes)
    assert repr((back.pedals, back.bars, back.title)) == repr((score.pedals, score.bars, "piece"))


def test_what_is_known_about_a_piece_comes_back(library):
    library.add(
        TWO_NOTES,
        "etude",
        source="etude.mid",
        fingering="ours",
        collection="imported",
        title="An étude",
        path="/music/etude.mid",
        sha256="ab",
        setting="keep",
    )
    piece = imported_pieces()["etude"]
    assert (piece.name, piece.title, piece.collection) == ("etude", "An étude", "imported")
    assert (piece.source, piece.fingering) == ("etude.mid", "ours")
    assert piece.score() == with_title(TWO_NOTES, "etude")
    info = library.info("etude")
    assert (info.path, info.sha256, info.setting) == ("/music/etude.mid", "ab", "keep")
    assert (info.n_notes, info.duration) == (2, 1.0)


def test_the_folder_is_the_variables_and_without_it_that_of_the_system(monkeypatch, data):
    assert pieces_folder() == data / "pieces"
    monkeypatch.delenv(DATA_VARIABLE)
    monkeypatch.setenv("XDG_DATA_HOME", "/home/somebody/share")
    assert pieces_folder() == Path("/home/somebody/share/sb3-piano/pieces")
    monkeypatch.setenv(DATA_VARIABLE, "")
    assert pieces_folder() == Path("/home/somebody/share/sb3-piano/pieces")


def test_nothing_imported_means_no_pieces_and_makes_no_folder(data):
    assert (len(imported_pieces()), imported_pieces().get("x")) == (0, None)
    assert not data.exists()


def test_pieces_that_another_process_imports_are_seen(library, data):
    library.add(ONE_NOTE, "first", **FROM_NOWHERE)
    assert imported_pieces()["first"].source == "nowhere"
    elsewhere = Library(data / "pieces")
    elsewhere.add(TWO_NOTES, "second", **FROM_NOWHERE)
    assert list(imported_pieces()) == ["first", "second"]
    elsewhere.add(TWO_NOTES, "first", source="another", fingering="none")
    assert imported_pieces()["first"].source == "another"
    assert imported_pieces()["first"].score() == with_title(TWO_NOTES, "first")
    elsewhere.remove("first")
    assert list(imported_pieces()) == ["second"]


def test_a_folder_that_cannot_be_read_has_no_pieces_and_fails_nobody(data, library):
    data.mkdir()
    (data / "pieces").write_text("a file, no folder")
    assert dict(imported_pieces()) == {}
    assert library.names() == ()
    assert piece_features(find_piece("FurElise")) == features(load_score("FurElise"))
    assert main(["pieces", "list", "--collection", "debug"]) == 0
    with pytest.raises(UnknownPieceError, match="has no piece 'FurElise'"):
        library.remove("FurElise")


@pytest.mark.parametrize("name", ["debug-CMajorScaleTwoHands", *list(BUILT_IN)[-1:], "FurElise"])
def test_the_name_of_a_built_in_piece_is_refused(library, name):
    with pytest.raises(ConfigError, match="a piece that comes with the package is"):
        library.add(ONE_NOTE, name, **FROM_NOWHERE)


@pytest.mark.parametrize(
    "name", ["", "-x", "a b", "a/b", "..", "a.mid", "x" * 201, "月" * 67, "a\n"]
)
def test_a_name_that_no_id_could_have_is_refused(library, name):
    with pytest.raises(ConfigError, match="cannot be named .*expected letters, digits"):
        library.add(ONE_NOTE, name, **FROM_NOWHERE)


def test_a_removed_piece_is_gone_and_an_unknown_one_is_answered_with_near_names(library):
    library.add(ONE_NOTE, "etude", **FROM_NOWHERE)
    with pytest.raises(UnknownPieceError, match=r"no piece 'etudes'\. Did you mean 'etude'\?"):
        library.remove("etudes")
    library.remove("etude")
    assert ("etude" in library, library.names(), list(imported_pieces())) == (False, (), [])
    with pytest.raises(UnknownPieceError, match="no piece 'etude'"):
        library.score("etude")


class TestDamage:
    @pytest.fixture
    def broken(self, library, data):
        library.add(ONE_NOTE, "sound", **FROM_NOWHERE)
        path = data / "pieces" / "broken.npz"
        path.write_bytes(b"PK\x03\x04 no archive")
        return path

    def test_it_spoils_no_other_piece_and_is_named(self, library, broken):
        assert list(library.pieces()) == ["broken", "sound"]
        assert list(library.infos()) == ["sound"]
        assert str(broken) in library.pieces()["broken"].source
        assert imported_pieces()["sound"].score().title == "sound"

    def test_making_the_piece_says_which_file_and_what_to_do(self, library, broken):
        message = r"broken\.npz' is damaged \(.*'sb3-piano pieces remove broken' and import it"
        for make in (load_score, library.score, library.info):
            with pytest.raises(ScoreError, match=message):
                make("broken")
        library.remove("broken")
        assert "broken" not in library

    def test_a_newer_file_is_told_from_a_damaged_one(self, library, data):
        write_file(data / "pieces" / "new.npz", header=header(format=2, whatever=1))
        with pytest.raises(ScoreError, match=r"new\.npz' is of format 2, .*expected 1"):
            load_score("new")

    def test_pickled_objects_are_not_loaded(self, library, data):
        write_file(data / "pieces" / "evil.npz", header=np.array([{"format": 1}], dtype=object))
        with pytest.raises(ScoreError, match=r"evil\.npz' is damaged \(.*pickles are not read"):
            load_score("evil")


@pytest.mark.slow
@settings(max_examples=150, deadline=None)
@given(position=st.integers(0, 10_000), value=st.integers(1, 255), cut=st.booleans())
def test_a_changed_byte_gives_the_very_score_or_our_error(position, value, cut, tmp_path_factory):
    folder = tmp_path_factory.getbasetemp() / "fuzz"
    library = Library(folder)
    library.add(TWO_NOTES, "piece", **FROM_NOWHERE)
    path = library.path("piece")
    content = bytearray(path.read_bytes())
    position %= len(content)
    if cut:
        del content[position:]
    else:
        content[position] ^= value
    path.write_bytes(content)
    try:
        score = library.score("piece")
    except ScoreError as error:
        outcome = str(error)
    else:
        outcome = f"{path}" if score == with_title(TWO_NOTES, "piece") else "another score"
    assert str(path) in outcome


def test_two_imports_at_a_time_are_refused(library, data):
    message = "pieces': another import is under way"
    with (
        library.importing(),
        pytest.raises(ConfigError, match=message),
        Library(data / "pieces").importing(),
    ):
        raise AssertionError("not refused")
    with library.importing():
        pass


def test_what_a_killed_import_left_is_no_piece_and_goes_with_the_next_one(library, data):
    left = data / "pieces" / "half.npz.partial"
    left.parent.mkdir(parents=True)
    left.write_bytes(b"half")
    assert list(library.pieces()) == []
    with library.importing():
        assert not left.exists()


def test_features_are_taken_from_the_file_if_they_are_whole(library):
    noted = dataclasses.asdict(features(ONE_NOTE)) | {"average_polyphony": 3.5}
    library.add(ONE_NOTE, "noted", features=noted, **FROM_NOWHERE)
    found = piece_features(imported_pieces()["noted"])
    assert (found.average_polyphony, found.pitch_range) == (3.5, (60, 60))
    del noted["hand_span"]
    library.add(ONE_NOTE, "older", features=noted, **FROM_NOWHERE)
    assert piece_features(imported_pieces()["older"]).average_polyphony == 1.0


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("Für Elise (1810).2", "Fur-Elise-1810-2"),
        ("a--b__c", "a-b__c"),
        ("-_ x _-", "x"),
        ("song.mid", "song-mid"),
        ("交響曲 第9番", "交響曲-第9番"),
        ("Ça & là", "Ca-la"),
        ("한글 노래", "한글-노래"),
        ("!!!", "piece"),
        ("y" * 300, "y" * 200),
    ],
)
def test_a_name_is_the_letters_and_digits_of_a_text(text, name):
    assert slug(text) == name


@given(st.text(max_size=200))
def test_every_text_becomes_a_name_that_an_id_can_have(text):
    name = slug(text)
    assume(not is_built_in(name))  # which importing names otherwise
    check_name(name)
    assert parse_env_id(f"RoboPianist-{name}-v0") == (None, f"RoboPianist-{name}", 0)
