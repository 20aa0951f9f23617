"""Reading MusicXML that is written here by hand; a quarter note lasts 0.5 s."""

import re
import warnings
import zipfile

import pytest
from notation import Notation
from yaml_rows import Tables

from sb3_piano.exceptions import ScoreError, ScoreWarning
from sb3_piano.music import load_score
from sb3_piano.music.formats import read_musicxml
from sb3_piano.music.formats.musicxml.document import MOST_BYTES

tables = Tables(__file__)
notation = Notation(tables["elements"])
CASES = [(rule, case) for rule, cases in tables["rules"].items() for case in cases]

FACTS = {
    "notes": lambda score: [[n.pitch, n.onset, n.offset] for n in score.notes],
    "labels": lambda score: [[n.pitch, n.hand, n.finger] for n in score.notes],
    "onsets": lambda score: [n.onset for n in score.notes],
    "pitches": lambda score: [n.pitch for n in score.notes],
    "velocities": lambda score: [n.velocity for n in score.notes],
    "pedals": lambda score: [[pedal.onset, pedal.offset] for pedal in score.pedals],
    "bars": lambda score: list(score.bars),
    "duration": lambda score: score.duration,
}


@pytest.fixture
def read(tmp_path):
    """Read measures of one part, or several parts by name, in the notation."""

    def read(music="", parts=None, **options):
        path = tmp_path / "piece.musicxml"
        path.write_text(notation.document(parts or {"P1": music}, **options), "utf-8")
        return read_musicxml(path)

    return read


def approximate(value):
    """Return what compares times but for rounding, in lists of lists, too."""
    if isinstance(value, list):
        return [approximate(each) for each in value]
    return pytest.approx(value) if isinstance(value, float) else value


@pytest.mark.parametrize(("rule", "case"), CASES, ids=[rule for rule, _ in CASES])
def test_music_is_read_as_it_is_meant(rule, case, read):
    options = {name: case[name] for name in case if name not in (*FACTS, "warns", "refused")}
    if "refused" in case:
        with pytest.raises(ScoreError, match=case["refused"]):
            read(**options)
        return
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        score = read(**options)
    for name in FACTS.keys() & case.keys():
        assert FACTS[name](score) == approximate(case[name])
    told = [(str(warning.message), warning.filename) for warning in caught]
    if "warns" not in case:
        assert told == []
    else:
        ((text, file),) = told
        assert re.search(case["warns"], text)
        assert file == __file__


_BAR = re.compile(r"((?:[\[(|]\S+ )*)([A-G])((?: (?:<\S+|[\]:]\S*))*)")


def bars(text):
    """Return the notation of "C |: D [1. E :| [2. F] |": whole notes between signs and words."""
    return " | ".join(
        " ".join([*map(sign, before.split()), f"{name}4:16", *map(sign, after.split())])
        for before, name, after in _BAR.findall(text)
    )


def sign(text):
    """Return the element of "(coda=x)", which is declared, "<To_Coda>", printed, "[1." or ":|"."""
    kind, equals, name = text.strip("()<>").partition("=")
    if equals:
        return f"declared({kind};{name})"
    if text[0] in "(<":
        return f"words({kind.replace('_', ' ')})"
    if text == "|:":
        return "forward"
    if text[0] == "[":
        return f"begin({text[1:].rstrip('.')})"
    times = text.strip(":|]") or 2
    return "stop" if text == "]" else f"{'stop-' * (text[0] == ']')}repeat({times})"


@tables("written, order")
def test_of_bars_is_by_their_signs(written, order, read):
    with warnings.catch_warnings(record=True):
        score = read(bars(written))
    assert "".join("C D EF G A B"[note.pitch - 60] for note in score.notes) == order


def test_signs_in_one_part_lead_both(read):
    signs = bars("C (segno=a) D <tocoda=b> E F <dalsegno=a> (coda=b) G")
    plain = " | ".join(f"{name}3:16" for name in "CDEFG")
    score = read(parts={"A": signs, "B": plain})
    assert FACTS["pitches"](score) == [p for d in (0, 2, 4, 5, 2, 7) for p in (48 + d, 60 + d)]
    assert score.duration == 12


@tables("written, told")
def test_a_bar_that_no_sign_leads_to_and_a_jump_to_no_sign_are_told(written, told, read):
    with pytest.warns(ScoreWarning, match=told):
        read(bars(written))


def test_a_part_without_divisions_has_those_of_another(tmp_path):
    upper = notation.part("C5:16 | divisions(2) D5:8")
    lower = notation.part("C3:16 | D3:8", divisions="")
    text = notation.document({"A": "", "B": ""})
    for name, measures in (("A", upper), ("B", lower)):
        text = re.sub(rf'(<part id="{name}">).*?(</part>)', rf"\g<1>{measures}\g<2>", text)
    (tmp_path / "a.xml").write_text(text, "utf-8")
    spans = [note[1:] for note in FACTS["notes"](read_musicxml(tmp_path / "a.xml"))]
    assert spans == [[0, 2], [0, 2], [2, 4], [2, 4]]


def test_microtones_are_rounded(tmp_path):
    text = notation.document({"P1": "C#4:4"}).replace("<alter>1<", "<alter>0.9<")
    (tmp_path / "a.xml").write_text(text, "utf-8")
    assert read_musicxml(tmp_path / "a.xml").notes[0].pitch == 61


@tables("chosen, expected")
def test_parts_are_chosen_by_name_or_number(chosen, expected, tmp_path):
    parts = {"Soprano": "C5:4", "Alto": "C4:4", "Tenor": "G3:4", "Bass": "C3:4"}
    (tmp_path / "choir.xml").write_text(notation.document(parts), "utf-8")
    with pytest.warns(ScoreWarning, match="only what was chosen is read"):
        score = load_score(tmp_path / "choir.xml", parts=chosen)
    assert FACTS["pitches"](score) == expected
    with pytest.raises(ScoreError, match="no part 'Drum': expected some of 1 'Soprano', 2"):
        load_score(tmp_path / "choir.xml", parts=["Drum"])


CONTAINER = '<container><rootfiles><rootfile full-path="music/a.xml"/></rootfiles></container>'


def packed(path, **files):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return path


ONE_NOTE = [[60, 0, 0.5]]
ENTITIES = "".join(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10}">' for i in range(1, 12))
BOMB = f'<!DOCTYPE a [<!ENTITY e0 "{"lol" * 9}">{ENTITIES}]><a>&e11;</a>'.encode()


class TestFiles:
    def test_a_compressed_file_is_read_whatever_it_is_called(self, tmp_path):
        files = {
            "META-INF/container.xml": CONTAINER,
            "music/a.xml": notation.document({"A": "C4:4"}),
        }
        score = read_musicxml(packed(tmp_path / "piece.xml", **files))
        assert (score.title, FACTS["notes"](score)) == ("piece", ONE_NOTE)

    def test_what_is_no_partwise_musicxml_is_refused_with_the_reason(self, tmp_path):
        packed(tmp_path / "a.mxl", **{"META-INF/container.xml": CONTAINER})
        for content, reason in (
            (b"", "no element found"),
            (b"not XML at all", "syntax error"),
            (BOMB, "limit on input amplification factor"),
            (b"<svg/>", r"its root is <svg>, not <score-partwise>"),
            (b"PK\x03\x04", "zip"),
            ((tmp_path / "a.mxl").read_bytes(), r"it has no 'music/a\.xml', .*and 0 XML files"),
        ):
            (tmp_path / "a.xml").write_bytes(content)
            told = rf"Cannot read '.*a\.xml' as a MusicXML file \(.*({reason})"
            with pytest.raises(ScoreError, match=told):
                read_musicxml(tmp_path / "a.xml")

    @tables("encoding, declared")
    def test_text_is_decoded_by_its_bytes_before_what_it_declares(
        self, encoding, declared, tmp_path
    ):
        text = notation.document({"Flöte": "C6:4", "Piano": "C4:4"})
        text = f" \n<!-- {declared} -->" + text.replace("UTF-8", declared)
        (tmp_path / "a.xml").write_bytes(text.encode(encoding))
        with pytest.warns(ScoreWarning, match="left out 'Flöte'"):
            assert FACTS["notes"](read_musicxml(tmp_path / "a.xml")) == ONE_NOTE

    def test_parts_that_pause_in_a_document_by_measures_keep_their_place(self, tmp_path):
        one, other = (notation.part(music)[len('<measure number="1">') : -len("</measure>")]
                      for music in ("C5:16", "C3:16"))  # fmt: skip
        text = (
            '<score-timewise><part-list><score-part id="A"/><score-part id="B"/></part-list>'
            f'<measure number="1"><part id="A">{one}</part></measure>'
            f'<measure number="2"><part id="B">{other}</part></measure></score-timewise>'
        )
        (tmp_path / "a.xml").write_text(text)
        notes = FACTS["notes"](read_musicxml(tmp_path / "a.xml"))
        assert notes == [[72, 0, 2], [48, 2, 4]]

    def test_an_archive_without_container_may_have_copies_and_pictures(self, tmp_path):
        document = notation.document({"A": "C4:4"})
        files = {"A.XML": document, "__MACOSX/._A.XML": "", "a.png": ""}
        path = packed(tmp_path / "a.mxl", **files)
        assert FACTS["notes"](read_musicxml(path)) == ONE_NOTE
        with zipfile.ZipFile(path, "a") as archive:
            archive.writestr("b.xml", "<svg/>")
        with pytest.raises(ScoreError, match="it has no container and 2 XML files"):
            read_musicxml(path)

    @pytest.mark.slow
    def test_a_file_that_unpacks_to_too_much_is_refused(self, tmp_path):
        bomb = b" " * (MOST_BYTES + 1)
        files = {"META-INF/container.xml": CONTAINER, "music/a.xml": bomb}
        path = packed(tmp_path / "a.mxl", **files)
        assert path.stat().st_size < 100_000
        with pytest.raises(ScoreError, match="its music/a.xml holds more than 67108864 bytes"):
            read_musicxml(path)
