"""The second half of the repertoire plays what Chopin, Satie, Debussy and Joplin wrote.

What is expected is written in MIDI pitches, read off the copies that each file names.
"""

from __future__ import annotations

from fractions import Fraction
from itertools import accumulate, groupby, pairwise

import numpy as np
import pytest

from sb3_piano.music import PianoRoll
from sb3_piano.music.repertoire import REPERTOIRE

NOCTURNE = "ChopinNocturneOp9No2"
FANTAISIE = "FantaisieImpromptu"
GYMNOPEDIE = "Gymnopedie1"
CLAIR = "ClairDeLune"
REVERIE = "Reverie"
RAG = "MapleLeafRag"

UNIT = {
    NOCTURNE: 60 / 132,  # an eighth note
    FANTAISIE: 60 / 72 / 8,  # a sixteenth note
    GYMNOPEDIE: 60 / 72,  # a quarter note
    CLAIR: 60 / 46 / 3,  # an eighth note
    REVERIE: 60 / 92 / 2,  # an eighth note
    RAG: 60 / 92 / 4,  # a sixteenth note
}
"""What the tests below count in, in s."""

BARS = {
    NOCTURNE: [1, 13, 25, 37],
    FANTAISIE: range(0, 128, 16),
    GYMNOPEDIE: range(0, 63, 3),
    CLAIR: range(0, 72, 9),
    REVERIE: range(0, 80, 8),
    RAG: range(2, 130, 8),
}
"""Where the bars begin, in those units."""

PRESSES = {
    NOCTURNE: range(1, 46, 3),
    FANTAISIE: [0, 16, 32, 48, 64, 80, 88, 96, 104, 112, 120],
    GYMNOPEDIE: range(0, 63, 3),
    CLAIR: [1, 9, 12, 18, 21, 27, 30, 36, 42, 45, 51, 54, 60, 63, 69],
    REVERIE: range(0, 80, 8),
    RAG: [],
}
"""Where the pedal goes down, in those units: where the harmony changes."""


@pytest.fixture(scope="module")
def scores():
    return {name: REPERTOIRE[f"repertoire-{name}"].score() for name in UNIT}


def strikes(score, unit, hand=None):
    """Return when which pitch is struck, in units, in order."""
    return [
        (Fraction(note.onset / unit).limit_denominator(12), note.pitch)
        for note in score.notes
        if hand in (None, note.hand)
    ]


def line(text, start=0):
    """Return when which pitch of a line such as ``78 81*2 -*3`` is struck, and how long it is."""
    tokens = [token.partition("*") for token in text.split()]
    lengths = [Fraction(length or 1) for _, _, length in tokens]
    starts = accumulate(lengths, initial=Fraction(start))
    return [
        (at, int(pitch), length)
        for at, (pitch, _, _), length in zip(starts, tokens, lengths, strict=False)
        if pitch != "-"
    ]


def onsets(text, start=0):
    return [(at, pitch) for at, pitch, _ in line(text, start)]


def chords(score, unit, hand):
    """Return the pitches a hand strikes together, one set after the other."""
    struck = groupby(strikes(score, unit, hand), key=lambda strike: strike[0])
    return [{pitch for _, pitch in together} for _, together in struck]


@pytest.mark.parametrize("name", UNIT)
def test_the_bars_begin_where_the_meter_says(scores, name):
    np.testing.assert_allclose(scores[name].bars, [at * UNIT[name] for at in BARS[name]], atol=1e-9)


@pytest.mark.parametrize("name", UNIT)
def test_all_keys_have_fingers_and_the_hands_do_not_cross(scores, name):
    roll = PianoRoll.from_score(scores[name], 0.05)
    assert all(note.finger >= 0 for note in scores[name].notes)
    for fingers in roll.finger:
        right = np.flatnonzero((fingers >= 0) & (fingers <= 4))
        left = np.flatnonzero(fingers >= 5)
        assert not len(right) or not len(left) or left[-1] < right[0]


@pytest.mark.parametrize("name", UNIT)
def test_each_note_can_be_heard_as_a_strike_of_its_own(scores, name):
    roll = PianoRoll.from_score(scores[name], 0.05)
    assert np.count_nonzero(roll.onset) == len(scores[name].notes)


@pytest.mark.parametrize("factor", [1.0, 1.5, 2.0])
@pytest.mark.parametrize("name", UNIT)
def test_no_finger_is_due_on_two_keys_at_a_control_step(scores, name, factor):
    labels = PianoRoll.from_score(scores[name].stretch(factor), 0.05).finger
    for finger in range(10):
        assert (labels == finger).sum(axis=1).max() <= 1


@pytest.mark.parametrize("name", UNIT)
def test_the_pedal_goes_down_with_each_harmony_and_comes_up_before_the_next(scores, name):
    presses = scores[name].pedals
    downs = [press.onset / UNIT[name] for press in presses]
    np.testing.assert_allclose(downs, PRESSES[name], atol=1e-9)
    assert all(press.offset <= later.onset - 0.04 for press, later in pairwise(presses))
    assert not presses or presses[-1].offset <= scores[name].duration + 0.2


# Chopin, Nocturne: a beat is a bass note and two chords.
NOCTURNE_BEATS = """
39 55.63 58.63.67  51 56.62 59.62.68  39 55.63 58.63.67  38 55.63 58.63.67
36 55.64 58.64.67  48 55.64 60.64.70  41 53.61 58.61.64  41 53.60 56.60.65
46 53.62 58.62.68  47 55.65 62.65.67  48 55.63 60.63.67  45 54.63 60.63.66
46 53.63 58.63.68  34 53.62 58.68     39 55.63 58.63.67  51 55.63 58.63.67
"""
NOCTURNE_FINGERS = "1 5454 31 515243 2 1313 2154 321 2123"
NOCTURNE_MELODY = (
    "70 79*4 77 79 77*3 75*2 70 79*2 72 84*2 79 82*3 80*2 79 77*3 79*2 74 75*3 72*3 "
    "70 86 84 82*1/2 80*1/2 79*1/2 80*1/2 72*1/2 74*1/2 75*3"
)


def test_the_nocturne_has_its_melody(scores):
    right = [note for note in scores[NOCTURNE].notes if note.hand == "right"]
    assert strikes(scores[NOCTURNE], UNIT[NOCTURNE], "right") == onsets(NOCTURNE_MELODY)
    lengths = [float(length) * UNIT[NOCTURNE] - 0.05 for _, _, length in line(NOCTURNE_MELODY)]
    np.testing.assert_allclose([note.duration for note in right], lengths, atol=1e-9)
    fingers = [int(digit) - 1 for digit in NOCTURNE_FINGERS.replace(" ", "")]
    assert [note.finger for note in right] == fingers


def test_the_nocturne_has_its_accompaniment(scores):
    expected = [{int(pitch) for pitch in chord.split(".")} for chord in NOCTURNE_BEATS.split()]
    assert chords(scores[NOCTURNE], UNIT[NOCTURNE], "left") == expected
    times = {at for at, _ in strikes(scores[NOCTURNE], UNIT[NOCTURNE], "left")}
    assert times == set(range(1, 49))


def test_the_nocturne_s_bass_notes_are_short_and_its_chords_let_go_before_the_leap(scores):
    eighth = UNIT[NOCTURNE]
    for note in scores[NOCTURNE].notes:
        if note.hand == "left":
            bass = round(note.onset / eighth) % 3 == 1
            held = eighth / 2 if bass else eighth - 0.1
            assert note.duration == pytest.approx(held)


def test_the_nocturne_s_pedal_comes_up_with_the_second_chord(scores):
    presses = scores[NOCTURNE].pedals
    ups = [round(press.offset / UNIT[NOCTURNE]) for press in presses]
    assert ups == [*range(3, 45, 3), 49]


# Chopin, Fantaisie-Impromptu: a bar a line. The last note of bar 8 lasts into bar 9.
FANTAISIE_RIGHT = """
-  68 69 68  67 68 73 76  75 73 75 73  72 73 76 80
-  68 69 68  67 68 73 76  75 73 75 73  72 73 76 80
-  69 73 75  78 81 85 87  95 93 92 90  88 87 90 85
84 87 81 80  78 81 76 75  78 73 72 75  69 68 71 69*2
   68 69 68  67 68 73 76  75 73 75 73  72 73 76 80
-  68 70 68  67 68 73 76  75 73 75 73  72 73 76 80
75 76 75 74  75 83 82 80  79 88 87 85  83 82 80 79
82 80 83 74  76 75 80 70  73 71 75 67  70 68 67 68
"""
FANTAISIE_LEFT = """
49 56 61 64 61 56  52 56 61 64 61 56
49 56 61 64 61 56  52 56 61 64 61 56
51 57 61 66 61 57  54 61 63 69 63 61
44 51 54 60 54 51  44 51 54 60 54 51
49 56 61 64 61 56  52 56 61 64 61 56
49 56 58 64 58 56  52 56 58 61 58 56
51 56 59 63 59 56  51 58 61 67 61 58
44 51 56 59 56 51  44 51 56 59 56 51
"""


def test_the_fantaisie_sets_sixteenths_against_sextuplets(scores):
    score, unit = scores[FANTAISIE], UNIT[FANTAISIE]
    assert strikes(score, unit, "right") == onsets(FANTAISIE_RIGHT)
    pitches = [int(pitch) for pitch in FANTAISIE_LEFT.split()]
    expected = [(Fraction(4 * number, 3), pitch) for number, pitch in enumerate(pitches)]
    assert strikes(score, unit, "left") == expected


def test_the_note_that_links_the_fantaisie_s_phrases_is_held_over_the_bar(scores):
    score, unit = scores[FANTAISIE], UNIT[FANTAISIE]
    (held,) = [n for n in score.notes if n.onset == pytest.approx(63 * unit) and n.pitch == 69]
    assert held.offset == pytest.approx(65 * unit - 0.05)


# Satie, Gymnopédie no. 1, bars 5 to 21: half a phrase a line.
GYMNOPEDIE_MELODY = """
- 78 81 79 78 73 71 73 74 69*3  66*12
- 78 81 79 78 73 71 73 74 69*3  73*3 78*3 64*9
"""
G_MAJOR_7TH, D_MAJOR_7TH = {59, 62, 66}, {57, 61, 66}
GYMNOPEDIE_CHORDS = [
    *[G_MAJOR_7TH, D_MAJOR_7TH] * 8,
    *[{57, 61, 66}, {59, 62, 66}, {55, 59}, {59, 62, 67}, {53, 57, 62}],
]
GYMNOPEDIE_BASS = [*[43, 38] * 8, 42, 35, 40, 40, 38]


def test_the_gymnopedie_s_melody_begins_in_bar_5(scores):
    score, unit = scores[GYMNOPEDIE], UNIT[GYMNOPEDIE]
    right = strikes(score, unit, "right")
    right.remove((58, 67))  # the top of the chord of bar 20
    assert right == onsets(GYMNOPEDIE_MELODY, start=12)


def test_each_bar_of_the_gymnopedie_is_a_bass_note_and_a_chord(scores):
    score, unit = scores[GYMNOPEDIE], UNIT[GYMNOPEDIE]
    struck = set(strikes(score, unit))
    melody = set(onsets(GYMNOPEDIE_MELODY, start=12))
    for bar, (bass, chord) in enumerate(zip(GYMNOPEDIE_BASS, GYMNOPEDIE_CHORDS, strict=True)):
        held = {66} if bar in range(8, 12) else set()  # by the melody
        expected = {(3 * bar, bass), *((3 * bar + 1, pitch) for pitch in chord - held)}
        in_bar = {strike for strike in struck if 3 * bar <= strike[0] < 3 * bar + 3}
        assert in_bar - melody == expected, bar + 1


def test_the_gymnopedie_s_pedal_holds_each_bass_note_longer_than_the_hand(scores):
    score = scores[GYMNOPEDIE]
    for bar, press in zip(score.bars, score.pedals, strict=True):
        (bass,) = [note for note in score.notes if note.onset == bar and note.hand == "left"]
        chord = [note for note in score.notes if bar < note.onset < bar + 1 and note.hand == "left"]
        assert press.onset == bar
        assert bass.offset < chord[0].onset < press.offset
        assert press.offset > bar + 2.5 * UNIT[GYMNOPEDIE]


# Debussy, Clair de lune: the pitches of a line begin, and how long each lasts; a bar a line.
CLAIR_LINES = [
    *[(1, "65*8"), (1, "68*8"), (2, "77*4 73*4"), (2, "80*4 77*4")],
    *[(9, "66*9"), (9, "69*9"), (10, "72 73 72*7"), (10, "75 77 75*7")],
    *[(18, "65*9"), (18, "68*9"), (19, "70 72 70*7"), (19, "73 75 73*3/2 77*3 73*5/2")],
    *[(27, "63*9"), (27, "66*9"), (28, "68 70 68*6"), (28, "72 73 72*7")],
    *[(36, "61*6 60*3"), (36, "63*6 63*3"), (36, "66*6 66*3"), (37, "70 72 70 75 70 68 70 68*2")],
    *[(45, "58*6 57*3"), (45, "61*6 60*3"), (45, "63*6 63*3"), (46, "66 68 66*3 65*4")],
    *[(54, "56*6 54*3"), (54, "58*9"), (54, "61*9"), (55, "65 66 65 70 65 63 65 63*2")],
    *[(63, "53*6 51*3/2 44*3/2"), (63, "56*6 54*3"), (63, "58*6 56*3"), (64, "61 63 61*3 60*3")],
]


def test_clair_de_lune_has_all_its_voices(scores):
    score, unit = scores[CLAIR], UNIT[CLAIR]
    expected = sorted(
        (float(at), pitch, float(length))
        for start, text in CLAIR_LINES
        for at, pitch, length in line(text, start)
    )
    played = [(n.onset / unit, n.pitch, (n.duration + 0.05) / unit) for n in score.notes]
    np.testing.assert_allclose(sorted(played), expected, atol=1e-9)


def test_clair_de_lune_gives_the_lower_two_voices_to_the_left_hand(scores):
    right, left = (strikes(scores[CLAIR], UNIT[CLAIR], hand) for hand in ("right", "left"))
    for bar in BARS[CLAIR]:
        held = [pitch for at, pitch in left if bar <= at < bar + 2]
        assert len(held) == 2
        assert max(held) < min(pitch for at, pitch in right if bar <= at < bar + 6)


# Debussy, Rêverie.
REVERIE_MELODY = """
79*4 74*6 76 77 79*2 76 74 76*4/3 72*4/3 76*4/3 74*8 70*2 74*2 76*2 77*2 72*8 67*4 69*16
"""
REVERIE_BARS = ["58 60 62 67*2 62 60 58"] * 6 + ["57 58 60 65*2 60 58 57", "55 57 58 64*2 58 57 55"]


def test_the_reverie_s_melody_begins_in_bar_3(scores):
    right = strikes(scores[REVERIE], UNIT[REVERIE], "right")
    right.remove((71, 65))  # taken from the left hand, which leaps
    assert right == onsets(REVERIE_MELODY, start=16)
    lengths = {note.pitch: note.duration for note in scores[REVERIE].notes if note.pitch == 69}
    assert lengths[69] == pytest.approx(16 * UNIT[REVERIE] - 0.05)


def test_the_reverie_rocks_up_and_down_and_ties_its_lowest_note_over_five_bar_lines(scores):
    expected = [strike for bar, text in enumerate(REVERIE_BARS) for strike in onsets(text, 8 * bar)]
    tied = [(8 * bar, 58) for bar in range(1, 6)]
    expected = [strike for strike in expected if strike not in tied]
    left = strikes(scores[REVERIE], UNIT[REVERIE], "left")
    assert [strike for strike in left if strike[0] < 64] == expected
    ties = [n for n in scores[REVERIE].notes if n.pitch == 58 and n.duration > UNIT[REVERIE]]
    assert [round(n.onset / UNIT[REVERIE]) for n in ties] == [7, 15, 23, 31, 39]
    assert all(n.duration == pytest.approx(2 * UNIT[REVERIE] - 0.05) for n in ties)


def test_the_reverie_arrives_on_f_major(scores):
    struck = [strike for strike in strikes(scores[REVERIE], UNIT[REVERIE]) if strike[0] >= 64]
    bars = onsets("41 48 57 65 62 57 60 65 41 48 57 65 62 57 60 62", start=64)
    assert struck == sorted([*bars, (64, 69)])


# Joplin, Maple Leaf Rag.
MISPRINT = (16, 0.0, 55)
"""Bar, quarter note and pitch of what music21's copy has for the A flat of its second ending."""


@pytest.fixture(scope="module")
def rag_of_music21():
    """Return what is struck from the upbeat, bar 0, to bar 16, and how long, None if tied.

    The keys are the bar, the quarter note in it and the pitch, the values quarter notes.
    """
    pytest.importorskip("music21")
    from music21 import corpus

    struck = {}
    for staff in corpus.parse("joplin/maple_leaf_rag").parts:
        for bar in list(staff.getElementsByClass("Measure"))[:17]:
            for item in bar.flatten().notes:
                length = float(item.quarterLength) if item.tie is None else None
                if length is not None or item.tie.type == "start":
                    for pitch in item.pitches:
                        struck[bar.number, float(item.offset), pitch.midi] = length
    return struck


def rag_by_bars(score):
    """Return the lengths of the rag's notes, in quarter notes, by bar, quarter note and pitch."""
    quarter = 4 * UNIT[RAG]
    release = {"right": 0.05, "left": 0.1}
    played = {}
    for note in score.notes:
        at = round(note.onset / UNIT[RAG]) - 2
        bar, sixteenth = (at // 8 + 1, at % 8) if at >= 0 else (0, 0)
        length = (note.duration + release[note.hand]) / quarter
        played[bar, sixteenth / 4, note.pitch] = round(length, 6)
    return played


def test_the_maple_leaf_rag_is_that_of_music21_but_for_a_misprint(scores, rag_of_music21):
    played = rag_by_bars(scores[RAG])
    assert len(played) == len(scores[RAG].notes)
    upbeat_of_the_repeat = {(16, 1.5, 39), (16, 1.5, 51)}
    assert rag_of_music21.keys() - played.keys() == {MISPRINT, *upbeat_of_the_repeat}
    assert played.keys() - rag_of_music21.keys() == {(16, 0.0, 56)}


def test_the_maple_leaf_rag_s_notes_are_as_long_as_in_music21(scores, rag_of_music21):
    played = rag_by_bars(scores[RAG])
    for strike, length in rag_of_music21.items():
        if length is not None and strike in played:
            assert played[strike] == length, strike


def test_the_maple_leaf_rag_s_ties_go_over_the_beat_and_the_bar(scores):
    played = rag_by_bars(scores[RAG])
    off_beat = {(bar, at): length for (bar, at, pitch), length in played.items() if at % 1 == 0.75}
    long = {strike: length for strike, length in off_beat.items() if length > 0.25}
    assert long == {
        **{(2, 0.75): 1.25, (4, 0.75): 0.75, (12, 1.75): 0.75},
        **dict.fromkeys([(9, 1.75), (10, 1.75), (13, 1.75), (14, 1.75)], 0.5),
    }


def test_the_maple_leaf_rag_s_left_hand_ends_as_it_did_before_an_octave_lower(scores):
    left = strikes(scores[RAG], UNIT[RAG], "left")
    higher = [(at, pitch) for at, pitch in left if 66 <= at < 98]
    assert [(at + 32, pitch - 12) for at, pitch in higher] == [s for s in left if s[0] >= 98]


def test_the_maple_leaf_rag_goes_from_hand_to_hand_in_bars_7_and_8(scores):
    left = strikes(scores[RAG], UNIT[RAG], "left")
    right = strikes(scores[RAG], UNIT[RAG], "right")
    assert [strike for strike in left if 50 <= strike[0] < 66] == onsets("32*4 44*4 56*4 68*4", 50)
    climb = "- 44 47 56 - 56 59 68 - 68 71 80 - 80 83 92"
    assert [strike for strike in right if 50 <= strike[0] < 66] == onsets(climb, 50)
