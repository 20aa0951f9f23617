import dataclasses
from pathlib import Path

import numpy as np
import pytest
from gymnasium.envs.registration import parse_env_id
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from random_scores import FINGERS, HANDS, scores
from short_scores import score_of
from yaml_rows import Tables

from sb3_piano.cli import main
from sb3_piano.exceptions import ConfigError, ScoreError, UnknownPieceError
from sb3_piano.music import find_piece, load_score
from sb3_piano.music.difficulty import features
from sb3_piano.music.library import Library, imported_pieces
from sb3_piano.music.library.store import check_name, is_built_in, piece_features, slug
from sb3_piano.user_data import DATA_VARIABLE, pieces_folder

tables = Tables(__file__)

ONE_NOTE = score_of((0, 1, 60), title="one")
TWO_NOTES = score_of(
    (0, 1, 60, 0), (0.1, 1 / 3, 40, "left"), pedals=[(0.2, 0.7)], title="two", bars=[0.0, 0.3]
)
FROM_NOWHERE = {"source": "nowhere", "fingering": "none"}


def with_title(score, title):
    return dataclasses.replace(score, title=title)


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
    told = {"title": "An étude", "source": "etude.mid", "fingering": "ours"}
    noted = {"path": "/music/etude.mid", "sha256": "ab", "setting": "keep"}
    library.add(TWO_NOTES, "etude", **told, **noted)
    piece, info = imported_pieces()["etude"], library.info("etude")
    told |= {"name": "etude", "collection": "imported"}
    assert {name: getattr(piece, name) for name in told} == told
    noted |= {"n_notes": 2, "duration": 1.0}
    assert {name: getattr(info, name) for name in noted} == noted
    assert piece.score() == with_title(TWO_NOTES, "etude")


def test_the_folder_is_the_variables_and_without_it_that_of_the_system(monkeypatch, data):
    assert pieces_folder() == data / "pieces"
    assert (len(imported_pieces()), imported_pieces().get("x")) == (0, None)
    assert not data.exists()  # nothing is imported
    monkeypatch.delenv(DATA_VARIABLE)
    monkeypatch.setenv("XDG_DATA_HOME", "/home/somebody/share")
    for _ in range(2):
        assert pieces_folder() == Path("/home/somebody/share/sb3-piano/pieces")
        monkeypatch.setenv(DATA_VARIABLE, "")


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


@tables("names, message")
def test_a_name_of_a_built_in_piece_and_one_that_no_id_could_have_are_refused(
    library, names, message
):
    for name in names:
        with pytest.raises(ConfigError, match=f"cannot be named .*{message}"):
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

    @pytest.mark.parametrize(
        ("header", "message"),
        [
            (np.frombuffer(b'{"format": 2, "more": 1}', np.uint8), "is of format 2, .*expected 1"),
            (np.array([{"format": 1}], dtype=object), r"is damaged \(.*pickles are not read"),
        ],
    )
    def test_a_newer_file_is_told_and_pickled_objects_are_not_loaded(self, data, header, message):
        (data / "pieces").mkdir(parents=True)
        np.savez(data / "pieces" / "odd.npz", header=header)
        with pytest.raises(ScoreError, match=rf"odd\.npz' {message}"):
            load_score("odd")


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


def test_two_imports_at_a_time_are_refused_and_what_a_killed_one_left_goes(library, data):
    left = data / "pieces" / "half.npz.partial"
    left.parent.mkdir(parents=True)
    left.write_bytes(b"half")
    assert list(library.pieces()) == []
    message = "pieces': another import is under way"
    with (
        library.importing(),
        pytest.raises(ConfigError, match=message),
        Library(data / "pieces").importing(),
    ):
        raise AssertionError("not refused")
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


@tables("text, name")
def test_a_name_is_the_letters_and_digits_of_a_text(text, name):
    assert slug(text) == name


def test_a_long_text_is_cut_to_a_name_of_200_bytes_and_longer_ones_are_refused(library):
    assert slug("y" * 300) == "y" * 200
    for name in ("x" * 201, "月" * 67):
        with pytest.raises(ConfigError, match="cannot be named .*expected letters"):
            library.add(ONE_NOTE, name, **FROM_NOWHERE)


@given(st.text(max_size=200))
def test_every_text_becomes_a_name_that_an_id_can_have(text):
    name = slug(text)
    assume(not is_built_in(name))  # which importing names otherwise
    check_name(name)
    assert parse_env_id(f"RoboPianist-{name}-v0") == (None, f"RoboPianist-{name}", 0)
