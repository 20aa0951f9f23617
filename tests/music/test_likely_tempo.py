"""In which tempo a score is written so that it can be read."""

import music21
import pytest

from sb3_piano.music import BUILT_IN, Note, Score, read_score, write_score
from sb3_piano.music.formats.musicxml.tempo import likely_tempo


def beats(*onsets, bars):
    return Score(notes=[Note(onset=o, offset=o + 0.1, pitch=60) for o in onsets], bars=bars)


@pytest.mark.parametrize(
    ("name", "tempo"),
    [
        ("BachMinuetG", 112),
        ("BachPreludeC", 72),
        ("ChopinNocturneOp9No2", 66),
        ("FantaisieImpromptu", 144),
        ("Gymnopedie1", 72),
        ("MapleLeafRag", 92),
        ("OdeToJoy", 112),
        ("PathetiqueRondo", 84),  # alla breve: half as many beats as it is noted in
        ("Reverie", 92),
        ("TwinkleTwinkle", 100),
    ],
)
def test_pieces_of_the_repertoire_are_written_in_a_tempo_that_suits_them(name, tempo):
    assert likely_tempo(BUILT_IN[f"repertoire-{name}"].score()) == pytest.approx(tempo)


def test_a_bar_of_sixteenths_is_not_taken_for_one_of_sextuplets():
    # Eight notes in 1.2 s: 2/4 at 100. As 3/4 at 150 they would begin at 3/8 of a quarter note.
    onsets = [0.15 * i for i in range(24)]
    assert likely_tempo(beats(*onsets, bars=(0.0, 1.2, 2.4))) == pytest.approx(100)


@pytest.mark.parametrize(
    "score",
    [
        beats(0.0, 0.5, bars=()),
        beats(0.0, 0.5, bars=(0.0,)),
        beats(*(0.15 * i for i in range(24)), bars=(0.0, 0.9, 2.4)),
        beats(0.0, bars=(0.0, 0.1, 0.2)),
    ],
    ids=["no bars", "one bar", "uneven bars", "bars too short"],
)
def test_what_tells_no_tempo_is_written_at_120(score):
    assert likely_tempo(score) == 120


@pytest.mark.slow
def test_a_notation_program_reads_the_meter_and_the_note_values(tmp_path):
    score = BUILT_IN["repertoire-MapleLeafRag"].score()
    write_score(score, tmp_path / "rag.musicxml")
    theirs = music21.converter.parse(tmp_path / "rag.musicxml").parts[0].recurse()
    assert theirs.getElementsByClass(music21.meter.TimeSignature)[0].ratioString == "2/4"
    values = [note.duration.type for note in theirs.notes[:5]]
    assert values == ["16th", "16th", "16th", "16th", "eighth"]
    back = read_score(tmp_path / "rag.musicxml")
    assert [note.onset for note in back.notes] == pytest.approx(
        [note.onset for note in score.notes], abs=60 / 92 / 24000
    )
