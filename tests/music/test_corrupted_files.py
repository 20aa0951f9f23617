"""Damaged files of each format: they are read or refused, and nothing else happens."""

import warnings
import zipfile

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from short_scores import score_of

from sb3_piano.exceptions import ScoreError, ScoreWarning
from sb3_piano.music.formats import read_score, write_score

FORMATS = ["mid", "txt", "musicxml", "mxl"]
EXAMPLES = 100

NOTES = *((t / 2, t / 2 + 1, 60 + t, t) for t in range(8)), (1, 3, 40, "left")
SCORE = score_of(*NOTES, pedals=[(0, 3)], bars=[0, 1, 2.5])


@pytest.fixture(scope="module", params=FORMATS)
def whole(request, tmp_path_factory):
    """A whole file."""
    path = tmp_path_factory.mktemp("whole") / f"whole.{request.param}"
    write_score(SCORE, path)
    return path


def outcome(path, content):
    """Write bytes and try to read them as a score: return the score, or the error."""
    path.write_bytes(content)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # other warnings would be somebody's bug
        warnings.simplefilter("ignore", ScoreWarning)
        try:
            result = read_score(path)
        except ScoreError as error:
            result = error
    if isinstance(result, ScoreError):
        assert path.name in str(result)
    else:
        assert all(0 <= note.onset < note.offset for note in result.notes)
    return result


def changed(data, whole):
    """Draw the bytes of a file with some of them replaced, removed, doubled, and cut off."""
    content = bytearray(whole)
    for _ in range(data.draw(st.integers(0, 4))):
        at = data.draw(st.integers(0, len(content) - 1))
        length = data.draw(st.integers(0, 8))
        content[at : at + length] = data.draw(
            st.binary(max_size=8) | st.just(bytes(content[at : at + length]) * 2)
        )
    end = data.draw(st.just(len(content)) | st.integers(0, len(content)))
    return bytes(content[:end])


@pytest.mark.slow
@settings(max_examples=EXAMPLES, deadline=None)
@given(data=st.data())
def test_a_changed_file_is_read_or_refused(whole, data):
    content = changed(data, whole.read_bytes())
    outcome(whole.with_name(f"changed{whole.suffix}"), content)


@pytest.mark.slow
@settings(max_examples=EXAMPLES // 2, deadline=None)
@given(data=st.data())
def test_a_changed_document_in_a_whole_container_is_read_or_refused(data, tmp_path_factory):
    folder = tmp_path_factory.getbasetemp()
    write_score(SCORE, folder / "whole.mxl")
    with zipfile.ZipFile(folder / "whole.mxl") as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    name = data.draw(st.sampled_from(sorted(files)))
    files[name] = changed(data, files[name])
    with zipfile.ZipFile(folder / "packed.mxl", "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    outcome(folder / "changed.mxl", (folder / "packed.mxl").read_bytes())


NUMBERS = ["0", "-1", "1", "7", "99999999999", "1" * 400, "0.5", "1e308", "nan", "inf", "", "x"]


@pytest.mark.slow
@settings(max_examples=EXAMPLES, deadline=None)
@given(data=st.data())
def test_a_musicxml_file_with_other_numbers_is_read_or_refused(data, tmp_path_factory):
    folder = tmp_path_factory.getbasetemp()
    write_score(SCORE, folder / "whole.musicxml")
    text = (folder / "whole.musicxml").read_text("utf-8")
    tags = ["duration", "divisions", "octave", "alter", "staff", "voice", "beats", "beat-type"]
    tags += ["staves", "fingering", "step", "per-minute", "line"]
    tag = data.draw(st.sampled_from(tags))
    pieces = text.split(f"<{tag}>")
    place = data.draw(st.integers(1, len(pieces) - 1)) if len(pieces) > 1 else 0
    number = data.draw(st.sampled_from(NUMBERS))
    rest = pieces[place].partition("</")[2]
    pieces[place] = f"{number}</{rest}" if place else pieces[place]
    sound = data.draw(st.sampled_from(["120", *NUMBERS]))
    text = f"<{tag}>".join(pieces).replace('sound tempo="120"', f'sound tempo="{sound}"')
    outcome(folder / "changed.musicxml", text.encode())


def test_a_whole_file_is_read_and_half_of_it_is_not_the_same(whole):
    content = whole.read_bytes()
    assert len(outcome(whole.with_name(f"a{whole.suffix}"), content).notes) == len(SCORE.notes)
    half = outcome(whole.with_name(f"b{whole.suffix}"), content[: len(content) // 2])
    assert isinstance(half, ScoreError) or len(half.notes) < len(SCORE.notes)


def test_any_number_of_repeats_is_played(tmp_path):
    write_score(SCORE, tmp_path / "a.musicxml")
    text = (tmp_path / "a.musicxml").read_text("utf-8")
    repeated = (
        "<measure><note><pitch><step>C</step><octave>4</octave></pitch><duration>9</duration>"
        '</note><barline><repeat direction="backward"/></barline></measure>'
    )
    result = outcome(
        tmp_path / "b.musicxml", text.replace("</part>", repeated * 60 + "</part>").encode()
    )
    assert len(result.notes) == 2 * (len(SCORE.notes) + 60)  # the first one goes back to the start
