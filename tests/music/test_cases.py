"""Files as programs write them, from public bug reports: each is read as its writer meant it.

``cases/*.yml`` has the right values by file name: notes as [pitch, onset, offset] in s, presses of
the pedal as [onset, offset], bars, and what a warning says, where one is due; else what the error
says.
"""

from __future__ import annotations

import re
import warnings
import zipfile
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from short_scores import score_of

from sb3_piano.exceptions import ScoreError, ScoreWarning
from sb3_piano.music import MAX_PITCH, MIN_PITCH, load_score
from sb3_piano.music.formats import read_score, write_score

FOLDER = Path(__file__).parent / "cases"
CASES: dict[str, dict[str, Any]] = {
    name: case
    for table in sorted(FOLDER.glob("*.yml"))
    for name, case in (yaml.safe_load(table.read_text()) or {}).items()
}


READ = sorted(name for name, case in CASES.items() if "refused" not in case)
NEAR = 1.5e-3  # s


@pytest.mark.parametrize("name", READ)
def test_a_file_is_read_as_its_writer_meant_it(name: str) -> None:
    case = CASES[name]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        score = load_score(FOLDER / name)
    assert score.title == Path(name).stem
    read = [[note.pitch, note.onset, note.offset] for note in score.notes]
    expected = sorted(case["notes"], key=lambda note: (note[1], note[0]))
    assert [note[0] for note in read] == [note[0] for note in expected]
    for one, other in zip(read, expected, strict=True):
        assert one[1:] == pytest.approx(other[1:], abs=NEAR)
    pedals = [[pedal.onset, pedal.offset] for pedal in score.pedals]
    assert pedals == [pytest.approx(pedal, abs=NEAR) for pedal in case.get("pedals", [])]
    assert score.bars == pytest.approx(case.get("bars", score.bars), abs=NEAR)
    told = [str(w.message) for w in caught if issubclass(w.category, ScoreWarning)]
    assert len(told) == ("warns" in case), told
    assert re.search(case.get("warns", ""), "".join(told))


@pytest.mark.parametrize("name", sorted(CASES.keys() - READ))
def test_a_file_that_cannot_be_read_is_refused_by_its_path_and_reason(name: str) -> None:
    with pytest.raises(ScoreError, match=CASES[name]["refused"]) as error:
        load_score(FOLDER / name)
    assert str(FOLDER / name) in str(error.value)


def test_every_file_has_its_right_values() -> None:
    files = {path.name for path in FOLDER.iterdir() if path.suffix not in (".yml", ".md")}
    assert set(CASES) == files


# Files from elsewhere: those that come with installed packages are read, or refused with a reason.


pytest.importorskip("music21")


def package(name):
    """Return the folder of an installed package, without importing it."""
    return Path(find_spec(name).origin).parent


MUSIC21 = package("music21")
CORPUS, SUITE = MUSIC21 / "corpus", MUSIC21 / "musicxml" / "lilypondTestSuite"

MIDI_FILES = sorted(
    path for name in ("music21", "pretty_midi", "mido") for path in package(name).rglob("*.mid")
)

FILES = Path(__file__).parents[1] / "data" / "music" / "music21_files.yml"
SCORES = {MUSIC21 / file: found for file, found in yaml.safe_load(FILES.read_text()).items()}


def attempt(path):
    """Return the score or the error, and what was left out."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            result = read_score(path)
        except ScoreError as error:
            result = error
    left_out = [str(w.message) for w in caught if issubclass(w.category, ScoreWarning)]
    print(f"{path.name:45} {result!r:.100} {' '.join(left_out)[-80:]}")
    return result, left_out


@pytest.mark.slow
def test_every_midi_file_is_read():
    assert len(MIDI_FILES) >= 23
    results = {path.name: attempt(path) for path in MIDI_FILES}
    assert [name for name, (result, _) in results.items() if isinstance(result, ScoreError)] == []
    left_out = {name: notes for name, (_, notes) in results.items() if notes}
    assert sorted(left_out) == ["test04.mid", "test16.mid"]
    assert "2 notes off the keyboard (B-1 at 70.8073 s" in left_out["test04.mid"][0]
    assert "1 note without length (G4 at 0.25 s)" in left_out["test16.mid"][0]
    hands = {name for name, (score, _) in results.items() if score.notes[0].hand is not None}
    assert hands == {"test03.mid", "test09.mid"}


@pytest.mark.slow
@pytest.mark.parametrize("path", SCORES, ids=lambda path: path.name)
def test_a_musicxml_file_is_read_or_refused_with_its_reason(path):
    result, _ = attempt(path)
    expected = SCORES[path]
    if isinstance(expected, str):
        with pytest.raises(ScoreError, match=expected):
            raise result
        return
    hands = sum(note.hand is not None for note in result.notes)
    fingers = sum(note.finger >= 0 for note in result.notes)
    assert [len(result.notes), hands, fingers] == expected
    assert all(MIN_PITCH <= note.pitch <= MAX_PITCH for note in result.notes)
    assert result.bars == tuple(sorted(result.bars)) != ()


@pytest.mark.slow
@pytest.mark.parametrize(
    "path", [CORPUS / "bach/bwv846.mxl", SUITE / "45b-RepeatWithAlternatives.xml"]
)
def test_music21_finds_the_same_notes_in_the_same_order(path):
    import music21

    ours, _ = attempt(path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        theirs = music21.converter.parse(path).expandRepeats()
    struck = {}
    for event in theirs.flatten().notes:
        for one in event.notes if event.isChord else [event]:
            if not one.duration.isGrace and (one.tie is None or one.tie.type == "start"):
                struck.setdefault(float(event.offset), []).append(one.pitch.midi)
    expected = [sorted(pitches) for _, pitches in sorted(struck.items())]
    found = {}
    for note in ours.notes:
        found.setdefault(round(note.onset, 6), []).append(note.pitch)
    # Ours are finer: a grace note has a time of its own.
    ours_in_order = iter(found.values())
    assert [chord for chord in expected if chord not in ours_in_order] == []
    assert len(expected) > 4


# Damaged files of each format: they are read or refused, and nothing else happens.


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
