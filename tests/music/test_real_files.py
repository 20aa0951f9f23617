"""Files from elsewhere: those that come with installed packages are read, or refused with a reason.

Run with ``-s`` to see the table.
"""

import warnings
from importlib.util import find_spec
from pathlib import Path

import pytest
import yaml

from sb3_piano.exceptions import ScoreError, ScoreWarning
from sb3_piano.music import MAX_PITCH, MIN_PITCH
from sb3_piano.music.formats import read_score

if find_spec("music21") is None:  # which takes long to be imported
    pytest.skip("needs music21", allow_module_level=True)


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
