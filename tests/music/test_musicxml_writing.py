import warnings
from pathlib import Path

import pytest
from hypothesis import given
from lxml import etree
from random_scores import FINGERS, HANDS, all_times, canonical, kept, scores
from short_scores import note_of as note
from short_scores import score_of
from yaml_rows import Tables

from sb3_piano.exceptions import ScoreError
from sb3_piano.music import BUILT_IN, Pedal, Score, load_score, read_score, write_score
from sb3_piano.music.formats import read_musicxml, write_musicxml
from sb3_piano.music.formats.musicxml.tempo import likely_tempo

tables = Tables(__file__)

HALF_A_TICK = 60 / 120 / 12000 / 2 + 1e-9
A_128TH = 0.5 / 32 + 1e-9


def round_trip(score, folder, **options):
    path = folder / "piece.musicxml"
    write_musicxml(score, path, **options)
    return read_musicxml(path)


class TestRoundTrip:
    @pytest.mark.slow
    @given(score=scores([*FINGERS, *HANDS]))
    def test_keeps_all_but_half_a_tick_and_then_all(self, score, tmp_path_factory):
        back = round_trip(score, tmp_path_factory.getbasetemp())
        ours, theirs = canonical(score), canonical(back)
        assert kept(theirs) == kept(ours)
        assert all_times(theirs) == pytest.approx(all_times(ours), abs=HALF_A_TICK)
        assert all_times(back.pedals) == pytest.approx(all_times(score.pedals), abs=HALF_A_TICK)
        if score.bars:
            lines = [0.0, *score.bars]
            assert all(min(abs(bar - line) for line in lines) <= A_128TH for bar in back.bars)
            inside = [line for line in score.bars if A_128TH < line < score.duration - A_128TH]
            assert all(min(abs(bar - line) for bar in back.bars) <= A_128TH for line in inside)
        again = round_trip(back, tmp_path_factory.getbasetemp())
        assert again == back
        assert again.bars == back.bars

    @pytest.mark.parametrize("tempo", [50, 120, 133.3])
    def test_a_tempo_changes_the_note_values_and_no_time(self, tempo, tmp_path):
        score = Score(notes=[note(0, 0.6, finger=0), note(0.6, 1.5, 64, finger=1)], bars=[0])
        back = round_trip(score, tmp_path, tempo=tempo)
        assert all_times(back.notes) == pytest.approx(
            all_times(score.notes), abs=60 / tempo / 24000
        )
        types = etree.parse(tmp_path / "piece.musicxml").xpath("//note[pitch]/type/text()")
        assert (types == ["eighth", "eighth"]) == (tempo == 50)

    def test_a_compressed_file_has_the_same_in_fewer_bytes(self, tmp_path):
        score = load_score("TwinkleTwinkleLittleStar")
        for suffix in ("mxl", "xml", "MXL"):
            write_musicxml(score, tmp_path / f"a.{suffix}")
            assert read_musicxml(tmp_path / f"a.{suffix}").notes == score.notes
        packed, plain = (tmp_path / "a.mxl").read_bytes(), (tmp_path / "a.xml").read_bytes()
        assert packed[:2] == b"PK"
        assert len(packed) < len(plain) / 4
        assert (tmp_path / "a.MXL").read_bytes() == packed

    def test_notes_on_one_key_at_one_time_stay_two(self, tmp_path):
        notes = [note(0, 1, finger=0), note(0, 1, finger=1), note(0, 3, finger=2)]
        notes += [note(1.5, 3.5, finger=2), note(0, 2, hand="left")]
        score = Score(notes=notes, title="piece", bars=[0, 1, 2])
        assert round_trip(score, tmp_path) == score

    def test_presses_closer_than_a_tick_are_one(self, tmp_path):
        pedals = [Pedal(onset=0, offset=1), Pedal(onset=1.00000001, offset=2)]
        score = Score(notes=[note(0, 2, finger=0)], pedals=pedals)
        assert round_trip(score, tmp_path).pedals == (Pedal(onset=0, offset=2),)


class TestBars:
    def test_a_first_line_after_the_start_is_behind_an_upbeat(self, tmp_path):
        score = Score(notes=[note(0, 5, finger=0)], bars=[0.5, 2.5, 4.5])
        assert round_trip(score, tmp_path).bars == (0.5, 2.5, 4.5)
        first = etree.parse(tmp_path / "piece.musicxml").find(".//measure")
        assert (first.get("number"), first.get("implicit")) == ("0", "yes")
        assert first.findtext("attributes/time/beats") == "4"

    def test_without_any_they_are_of_four_quarters(self, tmp_path):
        assert round_trip(Score(notes=[note(0, 5)]), tmp_path).bars == (0, 2, 4)

    @pytest.mark.parametrize(
        ("length", "meter"), [(2, "4/4"), (1.5, "3/4"), (0.75, "3/8"), (0.9375, "15/32")]
    )
    def test_of_equal_length_have_one_meter(self, length, meter, tmp_path):
        bars = [i * length for i in range(20) if i * length < 5]
        assert round_trip(Score(notes=[note(0, 5)], bars=bars), tmp_path).bars == tuple(bars)
        (time,) = etree.parse(tmp_path / "piece.musicxml").findall(".//time")
        assert f"{time.findtext('beats')}/{time.findtext('beat-type')}" == meter

    def test_of_any_length_are_moved_to_a_128th(self, tmp_path):
        bars = [0, 0.123, 1.7171, 1.7172, 4.9]
        back = round_trip(Score(notes=[note(0, 6)], bars=bars), tmp_path)
        assert back.bars == pytest.approx([0, 0.123, 1.7171, 4.9], abs=A_128TH)
        assert all((line * 64).is_integer() for line in back.bars)


AWKWARD = Score(
    notes=[
        note(0.0, 3.1, 60, finger=0, velocity=33),
        note(0.0, 3.1, 64, finger=2),
        note(0.1, 0.7, 67, finger=4),
        note(0.3333, 5.0, 40, finger=9),
        note(0.5, 1.0, 44, hand="left"),
        note(2.0, 2.25, 61),
        note(6.5, 7.0, 70, finger=1),
    ],
    pedals=[Pedal(onset=0.5, offset=4.0), Pedal(onset=4.5, offset=9)],
    title="Awkward & <odd> \x00piece",
    bars=[0.5, 2.0, 4.0, 6.123],
)


def test_rests_fill_the_first_voice_of_each_staff_and_hide_in_the_others(tmp_path):
    notes = [note(0, 2), note(0.5, 1, 64), note(2.5, 3, 67)]
    write_musicxml(Score(notes=notes, bars=[0, 2]), tmp_path / "a.musicxml")
    measures = etree.parse(tmp_path / "a.musicxml").findall(".//measure")
    rests = [
        [
            (one.findtext("voice"), int(one.findtext("duration")) / 12000, one.get("print-object"))
            for one in measure.iterfind("note[rest]")
        ]
        for measure in measures
    ]
    assert rests == [
        [("2", 1, "no"), ("5", 4, None)],
        [("1", 1, None), ("1", 2, None), ("5", 4, None)],
    ]


@pytest.fixture
def schema(tmp_path):
    """The schema of MusicXML, which comes with music21, but for two that it imports."""
    music21 = pytest.importorskip("music21")
    path = Path(music21.__file__).parent / "musicxml" / "musicxml.xsd"
    web = "http://www.musicxml.org/xsd/"
    (tmp_path / path.name).write_text(path.read_text("utf-8").replace(web, ""), "utf-8")
    names = ("type", "href", "role", "title", "show", "actuate", "lang", "space")
    attributes = "".join(f'<xs:attribute name="{name}" type="xs:string"/>' for name in names)
    for file, space in (("xlink", "1999/xlink"), ("xml", "XML/1998/namespace")):
        (tmp_path / f"{file}.xsd").write_text(
            '<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema" '
            f'targetNamespace="http://www.w3.org/{space}">{attributes}</xs:schema>'
        )
    return etree.XMLSchema(etree.parse(tmp_path / path.name))


class TestOtherReaders:
    @pytest.mark.slow
    @pytest.mark.parametrize("score", [AWKWARD, load_score("TwinkleTwinkleLittleStar")])
    def test_the_file_follows_the_schema(self, score, schema, tmp_path):
        write_musicxml(score, tmp_path / "a.musicxml")
        schema.assertValid(etree.parse(tmp_path / "a.musicxml"))

    @pytest.mark.parametrize("suffix", ["musicxml", "mxl"])
    def test_music21_finds_the_same_notes(self, suffix, tmp_path):
        music21 = pytest.importorskip("music21")
        write_musicxml(AWKWARD, tmp_path / f"a.{suffix}")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            theirs = music21.converter.parse(tmp_path / f"a.{suffix}")
        found = sorted(
            (0.5 * float(event.getOffsetInHierarchy(theirs)), one.pitch.midi)
            for event in theirs.recurse().notes
            for one in (event.notes if event.isChord else [event])
            if one.tie is None or one.tie.type == "start"
        )
        expected = [(n.onset, n.pitch) for n in AWKWARD.notes]
        assert [pitch for _, pitch in found] == [pitch for _, pitch in expected]
        assert [time for time, _ in found] == pytest.approx([t for t, _ in expected], abs=1e-4)
        assert theirs.metadata.title == "Awkward & <odd> \N{REPLACEMENT CHARACTER}piece"
        fingers = theirs.recurse().notes.first().articulations
        assert [finger.fingerNumber for finger in fingers] == [1, 3]
        (tempo, *_) = theirs.recurse().getElementsByClass(music21.tempo.MetronomeMark)
        assert tempo.number == 120


@pytest.mark.parametrize("tempo", [0, -1, float("nan"), float("inf")])
def test_a_tempo_that_is_none_is_refused(tempo, tmp_path):
    with pytest.raises(ScoreError, match=f"Tempo {tempo} is out of range: expected a finite"):
        round_trip(AWKWARD, tmp_path, tempo=tempo)


# In which tempo a score is written so that it can be read.


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
