"""Files from elsewhere: those that come with installed packages are read, or refused with a reason.

Run with ``-s`` to see the table.
"""

import warnings
from importlib.util import find_spec
from pathlib import Path

import pytest

from sb3_piano.exceptions import ScoreError, ScoreWarning
from sb3_piano.music import MAX_PITCH, MIN_PITCH
from sb3_piano.music.formats import read_score

pytest.importorskip("music21")


def package(name):
    """Return the folder of an installed package, without importing it."""
    return Path(find_spec(name).origin).parent


MUSIC21 = package("music21")
CORPUS, SUITE = MUSIC21 / "corpus", MUSIC21 / "musicxml" / "lilypondTestSuite"

MIDI_FILES = sorted(
    path for name in ("music21", "pretty_midi", "mido") for path in package(name).rglob("*.mid")
)

PARTS = r"has {} parts \({}.*: expected one or two"
NO_NOTES = "has no notes with a pitch"

# A file with what is to be read of it, (notes, how many of them have a hand, how many a finger),
# or the reason why it is refused.
SCORES = {
    CORPUS / "bach/bwv846.mxl": (533, 533, 0),
    CORPUS / "bach/bwv66.6.mxl": PARTS.format(4, "'Soprano', 'Alto'"),
    CORPUS / "beethoven/opus18no1/movement1.mxl": PARTS.format(4, "'Violin I'"),
    CORPUS / "cpebach/h186.mxl": (809, 809, 0),
    CORPUS / "handel/rinaldo/Lascia_chio_pianga.mxl": (734, 734, 0),
    CORPUS / "joplin/maple_leaf_rag.mxl": (2568, 2568, 0),
    CORPUS / "liliuokalani/aloha_oe.mxl": (265, 265, 0),
    CORPUS / "leadSheet/fosterBrownHair.mxl": (180, 0, 0),
    CORPUS / "mozart/k545/movement1_exposition.mxl": (191, 191, 0),
    CORPUS / "schoenberg/opus19/movement2.mxl": (92, 92, 0),
    CORPUS / "schoenberg/opus19/movement6.mxl": (53, 53, 0),
    CORPUS / "schubert/Lindenbaum.xml": (1437, 1437, 0),
    CORPUS / "schumann_clara/polonaise_op1n3.mxl": (1827, 1827, 70),
    CORPUS / "schumann_robert/opus48no2.mxl": (169, 169, 0),
    CORPUS / "verdi/laDonnaEMobile.mxl": (740, 740, 0),
    CORPUS / "demos/drum_sample.xml": NO_NOTES,
    CORPUS / "demos/two-voices.xml": (25, 0, 0),
    CORPUS / "demos/nested_tuplet_finale_test.xml": (10, 0, 0),
    SUITE / "02a-Rests-Durations.xml": NO_NOTES,
    SUITE / "01d-Pitches-Microtones.xml": (8, 0, 0),
    SUITE / "03c-Rhythm-DivisionChange.xml": (6, 0, 0),
    SUITE / "21d-Chords-SchubertStabatMater.xml": (9, 0, 0),
    SUITE / "24a-GraceNotes.xml": (28, 0, 0),
    SUITE / "33i-Ties-NotEnded.xml": (4, 0, 0),
    SUITE / "43d-MultiStaff-StaffChange.xml": (23, 23, 0),
    SUITE / "45b-RepeatWithAlternatives.xml": (5, 0, 0),
    SUITE / "72a-TransposingInstruments.xml": (8, 0, 0),
    SUITE / "90a-Compressed-MusicXML.mxl": (4, 0, 0),
}


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
    assert (len(result.notes), hands, fingers) == expected
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
