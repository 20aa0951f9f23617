"""Reading MusicXML that is written here by hand; a quarter note lasts 0.5 s."""

import warnings
import zipfile

import pytest

from sb3_piano.exceptions import ScoreError, ScoreWarning
from sb3_piano.music import Pedal, load_score
from sb3_piano.music.formats import read_musicxml
from sb3_piano.music.formats.musicxml.document import MOST_BYTES

DIVISIONS = 4
"""A sixteenth note is 1 long, a quarter note 4."""

BACK = '<barline><repeat direction="backward"/></barline>'


def note(name, duration, *inside, staff=1, voice=1, chord=False, attributes="", kind=""):
    """A note such as C4 or F5, with further elements inside."""
    length = "" if "grace" in kind else f"<duration>{duration}</duration>"
    return (
        f"<note {attributes}>{kind}{'<chord/>' if chord else ''}"
        f"<pitch><step>{name[0]}</step>{'<alter>1</alter>' if '#' in name else ''}"
        f"<octave>{name[-1]}</octave></pitch>{length}<voice>{voice}</voice><staff>{staff}</staff>"
        f"{''.join(inside)}</note>"
    )


def fingering(*texts, **attributes):
    words = "".join(f' {key}="{value}"' for key, value in attributes.items())
    elements = "".join(f"<fingering{words}>{text}</fingering>" for text in texts)
    return f"<notations><technical>{elements}</technical></notations>"


def backup(duration):
    return f"<backup><duration>{duration}</duration></backup>"


def direction(kind, sound=""):
    return f"<direction><direction-type>{kind}</direction-type>{sound}</direction>"


def pedal(kind):
    return direction(f'<pedal type="{kind}"/>')


def tempo(value):
    return f'<sound tempo="{value}"/>'


def metronome(unit, value, dots=0):
    dotted = "<beat-unit-dot/>" * dots
    return direction(
        f"<metronome><beat-unit>{unit}</beat-unit>{dotted}<per-minute>{value}</per-minute>"
        "</metronome>"
    )


def metronome_relation(former, new):
    notes = [
        f"<metronome-note><metronome-type>{kind}</metronome-type></metronome-note>"
        for kind in (former, new)
    ]
    relation = "<metronome-relation>equals</metronome-relation>".join(notes)
    return direction(f"<metronome>{relation}</metronome>")


def part(*measures, staves=1, clef="G", transpose="", first=1):
    attributes = (
        f"<attributes><divisions>{DIVISIONS}</divisions><time><beats>4</beats>"
        f"<beat-type>4</beat-type></time><staves>{staves}</staves>"
        f"<clef><sign>{clef}</sign><line>2</line></clef>{transpose}</attributes>"
    )
    return "".join(
        f'<measure number="{number}">{attributes if number == first else ""}{music}</measure>'
        for number, music in enumerate(measures, start=first)
    )


def document(**parts):
    names = "".join(
        f'<score-part id="{name}"><part-name>{name.replace("_", " ")}</part-name></score-part>'
        for name in parts
    )
    music = "".join(f'<part id="{name}">{measures}</part>' for name, measures in parts.items())
    return (
        '<?xml version="1.0" encoding="UTF-8"?><!DOCTYPE score-partwise PUBLIC '
        '"-//Recordare//DTD MusicXML 3.1 Partwise//EN" "http://www.musicxml.org/dtds/partwise.dtd">'
        f"<score-partwise><part-list>{names}</part-list>{music}</score-partwise>"
    )


@pytest.fixture
def read(tmp_path):
    """Read measures of one part, or several parts by name."""

    def read(*measures, parts=None, **options):
        path = tmp_path / "piece.musicxml"
        path.write_text(document(**(parts or {"P1": part(*measures, **options)})), "utf-8")
        return read_musicxml(path)

    return read


def played(score):
    return [(note.pitch, note.onset, note.offset) for note in score.notes]


def labels(score):
    return [(note.pitch, note.hand, note.finger) for note in score.notes]


class TestTime:
    @pytest.mark.parametrize(
        ("mark", "length"),
        [
            (metronome("quarter", 60), 1.0),
            (metronome("half", 60), 0.5),
            (metronome("quarter", 40, dots=1), 1.0),
            (metronome("eighth", "c. 120"), 1.0),
            (metronome("quarter", "lively"), 0.5),
            (metronome("quarter", "80-88"), 0.75),
            (
                metronome("quarter", 40).replace(
                    "<per-", "<beat-unit-tied><beat-unit>eighth</beat-unit></beat-unit-tied><per-"
                ),
                1.0,
            ),
            (metronome_relation("quarter", "half"), 0.25),
            (metronome_relation("eighth", "16th") * 2, 1.0),
            (tempo("60,0"), 1.0),
            (tempo(""), 0.5),
            (direction("<words>Adagio</words>"), 0.5),
        ],
    )
    def test_a_metronome_mark_counts_without_a_sound(self, mark, length, read):
        assert read(mark + note("C4", 4)).duration == pytest.approx(length)

    def test_what_sounds_is_preferred_to_what_is_printed(self, read):
        mark = metronome("quarter", 60).replace("</direction>", tempo(90) + "</direction>")
        assert read(mark + note("C4", 4)).duration == pytest.approx(60 / 90)

    def test_of_two_tempi_at_one_place_the_last_counts(self, read):
        words = direction("<words>March</words>", tempo(120))
        assert read(words + metronome("quarter", 90) + tempo(60) + note("C4", 4)).duration == 1.0
        assert read(words + metronome("quarter", 60) + note("C4", 4)).duration == 0.5
        score = read(note("C4", 16) + tempo(60), tempo(120) + note("D4", 4))
        assert played(score) == [(60, 0, 2), (62, 2, 2.5)]

    def test_a_part_without_divisions_has_those_of_another(self, read):
        halved = "<attributes><divisions>2</divisions></attributes>"
        parts = {"A": part(note("C5", 16), halved + note("D5", 8))}
        lower = part(note("C3", 16), note("D3", 8))
        parts["B"] = lower.replace(f"<divisions>{DIVISIONS}</divisions>", "")
        spans = [event[1:] for event in played(read(parts=parts))]
        assert spans == [(0, 2), (0, 2), (2, 4), (2, 4)]

    def test_a_tie_that_ends_nowhere_ends_its_note(self, read):
        music = note("C4", 4, '<tie type="start"/>') + note("D4", 4, '<tie type="stop"/>')
        assert played(read(music)) == [(60, 0, 0.5), (62, 0.5, 1)]

    def test_a_modulation_goes_by_the_tempo_before_also_of_another_part(self, read):
        chain = [metronome_relation("quarter", "half") + note("C5", 16) for _ in range(3)]
        parts = {"A": part(*chain), "B": part(tempo(60) + note("C3", 16))}
        assert [event[1] for event in played(read(parts=parts))] == [0, 0, 4, 6]

    def test_what_is_heard_elsewhere_than_it_stands_is_read_where_it_is_heard(self, read):
        late = '<direction-type><words>x</words></direction-type><offset sound="{}">4</offset>'
        for heard, end in (("yes", 1.5), ("no", 2)):
            music = f"<direction>{late.format(heard)}{tempo(60)}</direction>" + note("C4", 8)
            assert read(music).duration == end
        early = '<sound tempo="60"><offset>-99</offset></sound>'
        assert read(note("C4", 4) + early + note("D4", 4)).duration == 2

    def test_a_tie_goes_on_with_its_last_note_unless_the_key_was_struck_again(self, read):
        start, stop = '<tie type="start"/>', '<tie type="stop"/>'
        music = note("C4", 2, start) + note("D4", 2) + note("C4", 4, stop, staff=2, voice=2)
        assert played(read(music)) == [(60, 0, 1), (62, 0.25, 0.5)]
        music = note("C4", 4, start) + note("D4", 4) + note("C4", 4) + note("C4", 4, stop)
        assert len(played(read(music))) == 4
        assert len(played(read(note("C4", 16, start), note("D4", 16), note("C4", 16, stop)))) == 3
        music = note("C4", 4, start) + note("C4", 4, voice=2) + backup(4) + note("C4", 8, stop)
        assert played(read(music)) == [(60, 0, 1.5), (60, 0.5, 1)]
        music = note("C4", 9, start) + backup(1) + note("C4", 8, stop)
        assert played(read(music)) == [(60, 0, 2)]

    def test_a_tie_from_grace_notes_to_a_chord_holds_them(self, read):
        start, stop = '<tie type="start"/>', '<tied type="stop"/>'
        graces = [note(name, 0, start, kind="<grace/>") for name in ("C4", "E4")]
        chord = note("C4", 4, stop) + note("E4", 4, stop, chord=True)
        assert played(read(note("G4", 4) + "".join(graces) + chord))[1:] == [
            (60, pytest.approx(0.3), 1),
            (64, pytest.approx(0.4), 1),
        ]

    @pytest.mark.parametrize(
        ("swing", "onsets"),
        [
            ("<swing><first>3</first><second>1</second></swing>", [0, 3, 4, 5.5, 7, 8, 28 / 3]),
            (
                "<swing><first>2</first><second>1</second><swing-type>16th</swing-type></swing>",
                [0, 2, 4, 16 / 3, 6, 8, 28 / 3],
            ),
            ("<swing><straight/></swing>", [0, 2, 4, 5, 6, 8, 28 / 3]),
        ],
    )
    def test_notes_of_one_kind_are_swung(self, swing, onsets, read):
        lengths = [2, 2, 1, 1, 2, "1.3333333333333333", "2.6666666666666667"]
        music = "".join(note("C4", length) for length in lengths)
        score = read(tempo(60).replace("/>", f">{swing}</sound>") + music)
        assert [4 * note.onset for note in score.notes] == pytest.approx(onsets)

    def test_tuplets_are_not_swung(self, read):
        swing = "<swing><first>2</first><second>1</second></swing>"
        sextuplet = "<time-modification><actual-notes>6</actual-notes></time-modification>"
        music = note("C4", 2, sextuplet) + note("D4", 2, sextuplet) + note("E4", 2) + note("F4", 2)
        score = read(tempo(60).replace("/>", f">{swing}</sound>") + music)
        assert [note.onset for note in score.notes] == pytest.approx([0, 0.5, 1, 5 / 3])

    def test_a_rest_or_note_without_duration_is_as_long_as_its_type(self, read):
        triplet = "<actual-notes>3</actual-notes><normal-notes>2</normal-notes>"
        triplet = f"<time-modification>{triplet}</time-modification>"
        music = note("C4", 0, f"<type>quarter</type><dot/>{triplet}") + note("D4", 4)
        assert played(read(music)) == [(60, 0, 0.5), (62, 0.5, 1)]
        rest = '<note><rest measure="yes"/></note>'
        assert played(read(rest + note("D4", 4))) == [(62, 2, 2.5)]

    def test_a_staccato_dot_halves_a_note_and_its_chord(self, read):
        dot = "<notations><articulations><staccato/></articulations></notations>"
        chord = note("C4", 4, dot) + note("E4", 4, chord=True) + note("D4", 4)
        assert played(read(chord)) == [(60, 0, 0.25), (64, 0, 0.25), (62, 0.5, 1)]
        assert played(read(note("C4", 4, dot) + note("D4", 4))) == [(60, 0, 0.25), (62, 0.5, 1)]


def pitches(score):
    return [note.pitch - 60 for note in score.notes]


class TestRepeats:
    def test_of_an_upbeat_no_bar_line_is_before_it(self, read):
        measures = part(note("G4", 4), note("C5", 16), note("D5", 12) + BACK)
        upbeat = measures.replace('number="1"', 'number="0" implicit="yes"')
        assert read(parts={"P1": upbeat}).bars == (0.5, 2.5, 4.5, 6.5)

    def test_signs_in_one_part_lead_both(self, read):
        signs = bars("C (segno=a) D <tocoda=b> E F <dalsegno=a> (coda=b) G")
        parts = {"A": part(*signs), "B": part(*(note(f"{name}3", 16) for name in "CDEFG"))}
        score = read(parts=parts)
        for octave in (48, 60):
            played = [n.pitch - octave for n in score.notes if 0 <= n.pitch - octave < 12]
            assert played == [0, 2, 4, 5, 2, 7]
        assert score.duration == 12

    def test_the_tempo_is_that_of_the_place(self, read):
        score = read(note("C4", 8) + tempo(60) + note("D4", 8) + BACK)
        assert played(score) == [(60, 0, 1), (62, 1, 3), (60, 3, 4), (62, 4, 6)]


def bars(text):
    """Return measures of "C |: D [1. E :| [2. F] |": whole notes between signs and words."""
    made = []
    for word in text.split():
        if word[0] in "[(|":
            left = "" if word != "|:" else '<repeat direction="forward"/>'
            number = word[1:].rstrip(".")
            left = f'<ending number="{number}" type="start"/>' if word[0] == "[" else left
            sound = word[1:-1] if word[0] == "(" else ""
            made.append([left, "", sound, ""])
        elif word[0] in ":]":
            made[-1][3] += '<ending number="1" type="stop"/>' if "]" in word else ""
            times = word.strip(":|]")
            back = f'<repeat direction="backward" times="{times or 2}"/>'
            made[-1][3] += back if ":" in word else ""
        elif word[0] == "<":
            made[-1][2] = f"{made[-1][2]}>{word[1:-1]}"
        elif made and not made[-1][1]:
            made[-1][1] = word
        else:
            made.append(["", word, "", ""])
    return [_bar(*each) for each in made]


def _bar(left, name, signs, right):
    before, _, after = signs.partition(">")
    music = _sign(before) + note(f"{name}4", 16) + _sign(after)
    music = f'<barline location="left">{left}</barline>' * bool(left) + music
    return music + f'<barline location="right">{right}</barline>' * bool(right)


def _sign(text):
    """Return the sign of "coda=x", which is declared, or of "To_Coda", which is printed."""
    kind, equals, name = text.partition("=")
    words = f"<words>{text.replace('_', ' ')}</words>"
    return direction(words if not equals else "<words/>", equals and f'<sound {kind}="{name}"/>')


class TestOrder:
    @pytest.mark.parametrize(
        ("written", "order"),
        [
            ("C :| D :|", "CCDD"),
            ("|: C |: D :| E :|", "CDDECDDE"),
            ("|: C D :3| E", "CDCDCDE"),
            ("C :999999999| D", "C" * 20 + "D"),
            ("C [1. D ]:| E", "CDCE"),
            ("C [1. D ]:| [2. E ]:| [3. F ] A", "CDCECFA"),
            ("C [1,3. D ]:| [2. E ]:| F", "CDCECDF"),
            ("C [1,2. D ]:| E", "CDCDCE"),
            ("C [1-2. D ]:| [2-3. E ]:| [9. F ]", "CDCDCECECF"),
            ("C [2. D ]:| [1. E ]", "CDCE"),
            ("C [1. D E :| [2. F A", "CDECFA"),
            ("C [1. D ] E :| [2. F ]", "CDECF"),
            ("A |: C [1. D ]:| [2. E |: F ]:| B", "ACDCEFFB"),
            ("|: A |: C [1. D ]:| E :| F", "ACDCEACDCEF"),
            ("C D :| E <D.C.> F", "CDCDECDEF"),
            ("C (Coda) D <D.S.>", "CD"),
            ("C (Segno) D <D.S._al_Coda> (Coda) E", "CDDE"),
            ("C (\U0001d10b) D <To_\U0001d10c> E <D.S._al_\U0001d10c> (\U0001d10c) F", "CDEDF"),
            ("C <Fine> D (D.C._al_Fine) E", "CDEC"),
            ("(Fine) C D <Da_capo> E", "CDC"),
            ("C <fine=yes> :| D <dacapo=yes>", "CCDC"),
            ("C <tocoda=x> D <dacapo=yes> (coda=y) E :| F", "CDCEEF"),
            ("(segno=a) C <dalsegno=a> (segno=b) D <dalsegno=b> E", "CCDDE"),
        ],
    )
    def test_of_bars_is_by_their_signs(self, written, order, read):
        with warnings.catch_warnings(record=True):
            score = read(*bars(written))
        assert "".join("C D EF G A B"[pitch] for pitch in pitches(score)) == order

    def test_a_bar_that_no_sign_leads_to_is_told(self, read):
        # So many repeats within each other are ended early, before the second ending's turn.
        with pytest.warns(ScoreWarning, match="left out bar 7: no sign leads there"):
            read(*bars("|: C |: D |: E :20| F :20| G :20| [1. A ]:| [2. B ]"))

    def test_a_jump_to_a_sign_that_is_missing_is_told(self, read):
        with pytest.warns(ScoreWarning, match="did not jump in bar 2"):
            read(*bars("C D <D.S._al_Fine> E"))


class TestGraceNotes:
    def grace(self, name, **options):
        return note(name, 0, kind="<grace/>", **options)

    def test_are_played_before_the_beat(self, read):
        music = note("C4", 4) + self.grace("D4") + self.grace("E4") + note("F4", 4)
        assert played(read(music)) == [
            (60, 0, 0.5),
            (62, pytest.approx(0.3), pytest.approx(0.4)),
            (64, pytest.approx(0.4), 0.5),
            (65, 0.5, 1.0),
        ]

    def test_one_before_a_rest_is_played_before_it(self, read):
        rest = "<note><rest/><duration>4</duration><voice>1</voice></note>"
        music = note("C4", 4) + self.grace("D4") + rest + self.grace("E4") + note("F4", 4)
        assert played(read(music))[1:3] == [
            (62, pytest.approx(0.4), 0.5),
            (64, pytest.approx(0.9), 1.0),
        ]

    def test_take_at_most_half_of_the_time_since_the_last_note(self, read):
        music = note("C4", 1) + self.grace("D4") + self.grace("E4") + note("F4", 4)
        assert played(read(music))[1:3] == [(62, 0.0625, 0.09375), (64, 0.09375, 0.125)]

    def test_of_a_run_may_be_chords(self, read):
        music = note("C4", 4) + self.grace("D4") + self.grace("G4", chord=True)
        music += self.grace("E4") + self.grace("A4", chord=True) + note("F4", 4)
        spans = [event[1:] for event in played(read(music))[1:5]]
        early, late = (pytest.approx(0.3), pytest.approx(0.4)), (pytest.approx(0.4), 0.5)
        assert spans == [early, early, late, late]

    def test_at_the_start_let_everything_wait(self, read):
        music = pedal("start") + self.grace("D4") + note("C4", 8) + pedal("stop")
        score = read(music, note("C4", 16))
        assert played(score) == [(62, 0, 0.1), (60, 0.1, 1.1), (60, 1.1, 3.1)]
        assert score.bars == (0.1, 1.1)
        assert score.pedals == (Pedal(onset=0.1, offset=1.1),)

    def test_of_another_voice_are_another_run(self, read):
        music = note("C5", 4) + self.grace("D5") + note("C5", 4) + backup(8)
        music += note("C4", 4, voice=2) + self.grace("D4", voice=2) + note("C4", 4, voice=2)
        graces = [event[1:] for event in played(read(music)) if event[0] in (62, 74)]
        assert graces == [(0.4, 0.5)] * 2

    def test_at_the_end_of_a_repeated_measure_are_played_each_time(self, read):
        back = BACK
        music = note("C4", 16) + self.grace("D4") + back
        assert pitches(read(music, note("E4", 16))) == [0, 2, 0, 2, 4]
        first = '<barline location="left"><ending number="1" type="start"/></barline>'
        stop = back.replace("<repeat", '<ending number="1" type="stop"/><repeat')
        ending = first + note("D4", 16) + self.grace("F4") + stop
        score = read(note("C4", 16), ending, note("E4", 16))
        assert pitches(score) == [0, 2, 5, 0, 4]
        assert [note.onset for note in score.notes if note.pitch == 65] == [pytest.approx(3.9)]


class TestFingering:
    @pytest.mark.parametrize(
        ("text", "finger"),
        [
            ("1", 0),
            (" 5 ", 4),
            ("4-1", 3),
            ("4_1", 3),
            ("4\u20131", 3),
            ("6", -1),
            ("p", -1),
            ("", -1),
        ],
    )
    def test_of_a_change_the_first_counts(self, text, finger, read):
        assert read(note("C4", 4, fingering(text))).notes[0].finger == finger

    @pytest.mark.parametrize("mark", ["substitution", "alternate"])
    def test_substitutes_and_alternatives_are_not_played(self, mark, read):
        both = fingering(4) + fingering(1, **{mark: "yes"})
        assert read(note("C4", 4, both)).notes[0].finger == 3

    @pytest.mark.parametrize(("staff", "fingers"), [(1, [0, 2, 4]), (2, [9, 7, 5])])
    def test_those_of_a_chord_at_one_note_are_shared_out(self, staff, fingers, read):
        music = note("E4", 4, fingering(5, 1, 3), staff=staff)
        music += note("C4", 4, staff=staff, chord=True) + note("G4", 4, staff=staff, chord=True)
        score = read(music, staves=2)
        assert [note.finger for note in score.notes] == fingers


class TestHands:
    @pytest.mark.parametrize(
        ("keys", "low", "high"),
        [
            ({"A": "C4", "B": "C3"}, "left", "right"),
            ({"A": "C3", "B": "C4"}, None, None),  # the lower one above
            ({"Treble": "C4", "Bass": "C3"}, "left", "right"),
            ({"LH": "C4", "RH": "C3"}, "right", "left"),
        ],
    )
    def test_two_parts_are_the_two_hands_by_name_or_place(self, keys, low, high, read):
        score = read(parts={name: part(note(key, 4)) for name, key in keys.items()})
        assert labels(score) == [(48, low, -1), (60, high, -1)]

    @pytest.mark.parametrize(
        ("name", "clef", "extra", "label"),
        [
            ("Piano", "G", "", (None, -1)),
            ("Piano", "G", fingering(2), ("right", 1)),
            ("Piano", "F", fingering(2), ("left", 6)),
            ("Right_Hand", "F", fingering(2), ("right", 1)),
            ("Left_Hand", "G", "", ("left", -1)),
        ],
    )
    def test_a_lone_staff_is_a_hand_by_name_or_fingering(self, name, clef, extra, label, read):
        score = read(parts={name: part(note("C4", 4, extra), clef=clef)})
        assert labels(score) == [(60, *label)]


class TestMeasures:
    def test_of_several_parts_begin_together_however_much_of_them_is_written(self, read):
        upper = part(*(note(name, 16) for name in ("C5", "D5", "E5")))
        lower = part("", note("C3", 4), note("D3", 16))
        score = read(parts={"A": upper, "B": lower})
        assert [(n.pitch, n.onset) for n in score.notes if n.hand == "left"] == [(48, 2), (50, 4)]
        assert [(n.pitch, n.onset) for n in score.notes if n.hand == "right"] == [
            (72, 0),
            (74, 2),
            (76, 4),
        ]

    def test_a_repeat_ends_where_the_longest_part_does(self, read):
        back = BACK
        parts = {"A": part(note("C3", 4) + back), "B": part(note("C5", 16) + back)}
        score = read(parts=parts)
        assert [(n.pitch, n.onset) for n in score.notes] == [(48, 0), (72, 0), (48, 2), (72, 2)]

    def test_without_notes_and_rests_are_as_long_as_the_meter(self, read):
        assert played(read(note("C4", 16), "", note("D4", 16))) == [(60, 0, 2), (62, 4, 6)]
        # A short measure stays short where another part leaves it empty.
        parts = {"A": part(note("C5", 4), note("D5", 16)), "B": part("", note("D4", 16))}
        assert [n.onset for n in read(parts=parts).notes] == [0, 0.5, 0.5]
        meter = "<time><beats>3</beats><beat-type>8</beat-type>"
        meter += "<beats>1</beats><beat-type> 2 </beat-type></time>"
        music = part("", note("C4", 4)).replace(
            "<time><beats>4</beats><beat-type>4</beat-type></time>", meter
        )
        assert played(read(parts={"A": music})) == [(60, 1.75, 2.25)]


class TestPedal:
    def test_stays_down_until_the_end_if_nothing_lifts_it(self, read):
        music = pedal("start") + note("C4", 8)
        assert read(music, note("D4", 16)).pedals == (Pedal(onset=0, offset=3),)

    def test_held_over_a_repeat_sign_it_is_changed_where_it_is_pressed_again(self, read):
        music = pedal("start") + note("C4", 16) + BACK, note("D4", 16) + pedal("stop")
        assert read(*music).pedals == (Pedal(onset=0, offset=2), Pedal(onset=2.1, offset=6))

    @pytest.mark.parametrize("change", [pedal("change"), pedal("stop") + pedal("start")])
    def test_is_up_for_a_moment_where_it_is_changed(self, change, read):
        music = pedal("start") + note("C4", 8) + change + note("D4", 8) + pedal("stop")
        assert read(music).pedals == (Pedal(onset=0, offset=1), Pedal(onset=1.1, offset=2))

    def test_a_press_may_be_written_before_the_end_of_the_former(self, read):
        early = pedal("stop").replace("</direction>", '<offset sound="yes">-4</offset></direction>')
        music = pedal("start") + note("C4", 8) + pedal("start") + note("D4", 12) + early
        music = music + early.replace("-4", "-12") + pedal("stop")
        assert read(music).pedals == (Pedal(onset=0, offset=1), Pedal(onset=1.1, offset=2))

    def test_of_what_sounds_and_what_is_printed_what_sounds_counts(self, read):
        def damper(kind, value, offset=0):
            sound = f'<sound damper-pedal="{value}"><offset>{offset}</offset></sound>'
            return direction(f'<pedal type="{kind}"/>', sound)

        music = damper("start", 90, 4) + note("C4", 8) + damper("change", "yes") + note("D4", 8)
        assert read(music + damper("stop", 10)).pedals == (
            Pedal(onset=0.5, offset=1),
            Pedal(onset=1.1, offset=2),
        )


class TestPitchAndVelocity:
    @pytest.mark.parametrize(
        ("transpose", "pitch"),
        [
            ("<transpose><diatonic>-1</diatonic><chromatic>-2</chromatic></transpose>", 58),
            (
                "<transpose><chromatic>2</chromatic><octave-change>-1</octave-change></transpose>",
                50,
            ),
            ("<transpose><chromatic>0</chromatic><octave-change>1</octave-change></transpose>", 72),
        ],
    )
    def test_a_transposing_part_is_read_as_it_sounds(self, transpose, pitch, read):
        assert pitches(read(note("C4", 4), transpose=transpose)) == [pitch - 60]

    def test_microtones_are_rounded(self, read):
        music = note("C#4", 4).replace("<alter>1<", "<alter>0.9<")
        assert pitches(read(music)) == [1]

    def test_velocity_is_a_percentage_of_90_or_80(self, read):
        music = note("C4", 4, attributes='dynamics="100"') + note("D4", 4)
        music += note("E4", 4, attributes='dynamics="900"') + note(
            "F4", 4, attributes='dynamics="0"'
        )
        assert [note.velocity for note in read(music).notes] == [90, 80, 127, 1]


class TestLeftOut:
    def test_cue_notes_and_notes_without_a_pitch_are_silent(self, read):
        cue = note("D4", 4, kind="<cue/>")
        drum = "<note><unpitched/><duration>4</duration></note>"
        assert played(read(note("C4", 4) + cue + drum + note("E4", 4)))[1] == (64, 1.5, 2.0)

    def test_notes_that_no_piano_can_play_are_named_in_a_warning(self, read):
        music = note("C4", 4) + note("C9", 4) + note("D4", 0)
        message = (
            r"piece\.musicxml' left out 1 note without length \(D4 at 1 s\) and 1 note off the "
            r"keyboard \(C9 at 0\.5 s\)"
        )
        with pytest.warns(ScoreWarning, match=message) as warned:
            assert pitches(read(music)) == [0]
        assert [warning.filename for warning in warned] == [__file__]

    def test_a_file_of_which_nothing_remains_is_refused(self, read):
        with pytest.raises(ScoreError, match=r"has no notes to play, only 1 note off the keyboard"):
            read(note("C9", 4))


class TestParts:
    CHOIR = ("Soprano", "Alto", "Tenor", "Bass")

    @pytest.mark.parametrize(
        ("chosen", "expected"),
        [(["Alto", "bass"], [48, 60]), ([1], [72]), (["4", "Tenor"], [48, 55])],
    )
    def test_are_chosen_by_name_or_number(self, chosen, expected, read, tmp_path):
        keys = dict(zip(self.CHOIR, ("C5", "C4", "G3", "C3"), strict=True))
        parts = {name: part(note(key, 4)) for name, key in keys.items()}
        (tmp_path / "choir.xml").write_text(document(**parts), "utf-8")
        with pytest.warns(ScoreWarning, match="only what was chosen is read"):
            score = load_score(tmp_path / "choir.xml", parts=chosen)
        assert [note.pitch for note in score.notes] == expected
        with pytest.raises(ScoreError, match="no part 'Drum': expected some of 1 'Soprano', 2"):
            load_score(tmp_path / "choir.xml", parts=["Drum"])

    @pytest.mark.parametrize(
        ("names", "staves", "read_ones"),
        [
            (["Piano", "Grand_Piano"], 2, [0, 1]),
            (["PianoVoorslagen", "Piano"], 2, [0, 1]),
            (["Voice", "Piano"], 1, [1]),
            (["Voice", "m.d.", "m.g."], 1, [1, 2]),
            (["Sopraan", "rechte_Hand", "linke_Hand"], 1, [1, 2]),
            (["Violin", "Cello", "Cembalo"], 1, [2]),
            (["Flute", "Piano_RH", "Pno._LH", "B"], 1, [1, 2]),
            (["Piano_1", "Piano_2"], 2, None),
            (["Primo", "Secondo"], 2, None),
        ],
    )
    def test_of_one_pianist_are_told_by_their_names(self, names, staves, read_ones, read):
        parts = {name: part(note(f"C{3 + n}", 4), staves=staves) for n, name in enumerate(names)}
        with warnings.catch_warnings(record=True):
            if read_ones is None:
                with pytest.raises(ScoreError, match="import --parts NAME"):
                    read(parts=parts)
            else:
                assert pitches(read(parts=parts)) == [12 * n - 12 for n in read_ones]

    def test_of_a_singer_with_a_piano_the_piano_is_read(self, read):
        piano = note("C4", 4) + backup(4) + note("C3", 4, staff=2)
        parts = {"Voice": part(tempo(60) + note("A4", 4)), "P": part(piano, staves=2)}
        message = r"piece\.musicxml' left out 'Voice': only the piano is read"
        with pytest.warns(ScoreWarning, match=message):
            score = read(parts=parts)
        assert played(score) == [(48, 0, 1), (60, 0, 1)]

    def test_more_than_two_are_refused_by_name(self, read):
        parts = {name: part(note("C4", 4)) for name in ("Soprano", "Alto", "Bass")}
        message = r"has 3 parts \('Soprano', 'Alto', 'Bass'\): expected one or two"
        with pytest.raises(ScoreError, match=message):
            read(parts=parts)


CONTAINER = '<container><rootfiles><rootfile full-path="music/a.xml"/></rootfiles></container>'


def packed(path, **files):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name.replace("__", "/"), content)
    return path


ENTITIES = "".join(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10}">' for i in range(1, 12))
BOMB = f'<!DOCTYPE a [<!ENTITY e0 "{"lol" * 9}">{ENTITIES}]><a>&e11;</a>'.encode()


class TestFiles:
    def test_a_compressed_file_is_read_whatever_it_is_called(self, tmp_path):
        files = {
            "META-INF/container.xml": CONTAINER,
            "music/a.xml": document(A=part(note("C4", 4))),
        }
        score = read_musicxml(packed(tmp_path / "piece.xml", **files))
        assert (score.title, played(score)) == ("piece", [(60, 0, 0.5)])

    @pytest.mark.parametrize(
        ("content", "reason"),
        [
            (b"", "no element found"),
            (b"not XML at all", "syntax error"),
            (BOMB, "limit on input amplification factor"),
            (b"<svg/>", r"its root is <svg>, not <score-partwise>"),
            (b"PK\x03\x04", "zip"),
            (document(A=part(note("C4", "-1"))).encode(), "a duration is -1, less than 0"),
            (document(A=part(note("C4", "inf"))).encode(), "Invalid literal.*inf"),
            (document(A=part(note("H4", 1))).encode(), "a pitch has the step 'H'"),
        ],
    )
    def test_what_is_no_partwise_musicxml_is_refused_with_the_reason(
        self, content, reason, tmp_path
    ):
        (tmp_path / "a.xml").write_bytes(content)
        with pytest.raises(
            ScoreError, match=rf"Cannot read '.*a\.xml' as a MusicXML file \(.*({reason})"
        ):
            read_musicxml(tmp_path / "a.xml")

    @pytest.mark.parametrize(
        ("encoding", "declared"),
        [
            ("utf-16", "UTF-16"),
            ("utf-16-be", "UTF-8"),
            ("utf-32", "UTF-8"),
            ("iso-8859-2", "ISO-8859-2"),
            ("cp1252", "UTF-8"),
            ("cp1252", "latin-0"),
            ("mac-roman", "macintosh"),
        ],
    )
    def test_text_is_decoded_by_its_bytes_before_what_it_declares(
        self, encoding, declared, tmp_path
    ):
        text = document(Flöte=part(note("C6", 4)), Piano=part(note("C4", 4)))
        text = f" \n<!-- {declared} -->" + text.replace("UTF-8", declared)
        (tmp_path / "a.xml").write_bytes(text.encode(encoding))
        with pytest.warns(ScoreWarning, match="left out 'Flöte'"):
            assert played(read_musicxml(tmp_path / "a.xml")) == [(60, 0, 0.5)]

    def test_parts_that_pause_in_a_document_by_measures_keep_their_place(self, tmp_path):
        attributes = "<attributes><divisions>4</divisions></attributes>"
        measures = (
            f'<measure number="1"><part id="A">{attributes}{note("C5", 16)}</part></measure>'
            f'<measure number="2"><part id="B">{attributes}{note("C3", 16)}</part></measure>'
        )
        names = "".join(f'<score-part id="{name}"/>' for name in "AB")
        text = f"<score-timewise><part-list>{names}</part-list>{measures}</score-timewise>"
        (tmp_path / "a.xml").write_text(text)
        assert played(read_musicxml(tmp_path / "a.xml")) == [(72, 0, 2), (48, 2, 4)]

    def test_an_archive_without_container_may_have_copies_and_pictures(self, tmp_path):
        files = {"A.XML": document(A=part(note("C4", 4))), "__MACOSX/._A.XML": "", "a.png": ""}
        path = tmp_path / "a.mxl"
        with zipfile.ZipFile(path, "w") as archive:
            for name, content in files.items():
                archive.writestr(name, content)
        assert played(read_musicxml(path)) == [(60, 0, 0.5)]
        with zipfile.ZipFile(path, "a") as archive:
            archive.writestr("b.xml", "<svg/>")
        with pytest.raises(ScoreError, match="it has no container and 2 XML files"):
            read_musicxml(path)

    def test_a_container_without_its_file_is_refused(self, tmp_path):
        path = packed(tmp_path / "a.mxl", **{"META-INF/container.xml": CONTAINER})
        with pytest.raises(ScoreError, match=r"it has no 'music/a\.xml', .*and 0 XML files"):
            read_musicxml(path)

    @pytest.mark.slow
    def test_a_file_that_unpacks_to_too_much_is_refused(self, tmp_path):
        bomb = b" " * (MOST_BYTES + 1)
        files = {"META-INF/container.xml": CONTAINER, "music/a.xml": bomb}
        path = packed(tmp_path / "a.mxl", **files)
        assert path.stat().st_size < 100_000
        with pytest.raises(ScoreError, match="its music/a.xml holds more than 67108864 bytes"):
            read_musicxml(path)
