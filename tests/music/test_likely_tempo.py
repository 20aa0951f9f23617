"""In which tempo a score is written so that it can be read."""

import pytest
from short_scores import score_of
from yaml_rows import Tables

from sb3_piano.music import BUILT_IN, read_score, write_score
from sb3_piano.music.formats.musicxml.tempo import likely_tempo

tables = Tables(__file__)


def beats(*onsets, bars):
    return score_of(*((onset, onset + 0.1, 60) for onset in onsets), bars=bars)


@tables("name, tempo")
def test_pieces_of_the_repertoire_are_written_in_a_tempo_that_suits_them(name, tempo):
    assert likely_tempo(BUILT_IN[f"repertoire-{name}"].score()) == pytest.approx(tempo)


def test_a_bar_of_sixteenths_is_not_taken_for_one_of_sextuplets():
    # Eight notes in 1.2 s: 2/4 at 100. As 3/4 at 150 they would begin at 3/8 of a quarter note.
    onsets = [0.15 * i for i in range(24)]
    assert likely_tempo(beats(*onsets, bars=(0.0, 1.2, 2.4))) == pytest.approx(100)


@tables("onsets, bars, why")
def test_what_tells_no_tempo_is_written_at_120(onsets, bars, why):
    assert likely_tempo(beats(*onsets, bars=bars)) == 120, why


@pytest.mark.slow
def test_a_notation_program_reads_the_meter_and_the_note_values(tmp_path):
    music21 = pytest.importorskip("music21")
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
