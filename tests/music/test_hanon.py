"""Hanon's exercises, against bars copied from the edition as the Mutopia Project gives it."""

from itertools import pairwise

import pytest

from sb3_piano.exceptions import ConfigError
from sb3_piano.music import load_score
from sb3_piano.music.hands import finger_number
from sb3_piano.music.pitch import pitch_number
from sb3_piano.music.studies import HANON

# Of some exercises the first two bars, the last bar up, the first and the last bar down: what the
# right hand plays (the left is an octave below), and the fingers of the right and the left hand.
BARS = """
1  C3 E3 F3 G3 A3 G3 F3 E3  12345432 54321234
   D3 F3 G3 A3 B3 A3 G3 F3  12345432 54321234
   B4 D5 E5 F5 G5 F5 E5 D5  12345432 54321234
   G5 E5 D5 C5 B4 C5 D5 E5  54321234 12345432
   G3 E3 D3 C3 B2 C3 D3 E3  54321234 12345432

6  C3 A3 G3 A3 F3 A3 E3 A3  15453525 51213141
   D3 B3 A3 B3 G3 B3 F3 B3  15453525 51213141
   B4 G5 F5 G5 E5 G5 D5 C5  15453521 51213145
   G5 B4 C5 B4 D5 B4 E5 B4  51213141 15453525
   A3 C3 D3 C3 E3 C3 F3 E3  51213143 15453523

12 G3 C3 E3 D3 C3 D3 E3 C3  51321231 15345435
   B3 D3 F3 E3 D3 E3 F3 D3  51321231 15345435
   G5 B4 D5 C5 B4 C5 D5 E5  51321234 15345432
   B4 G5 E5 F5 G5 F5 E5 G5  15345435 51321231
   C3 G3 E3 F3 G3 F3 E3 F3  15345434 51321232

17 C3 E3 A3 G3 B3 A3 G3 A3  12435434 54231232
   D3 F3 B3 A3 C4 B3 A3 B3  12435434 54231232
   B4 D5 G5 F5 A5 G5 F5 E5  12435432 54231234
   G5 D5 B4 C5 A4 B4 C5 A4  53231231 12435435
   B3 F3 D3 E3 C3 D3 E3 D3  53231232 12435434

20 E3 G3 C4 E4 C4 B3 C4 A3  12454342 54212324
   F3 A3 D4 F4 D4 C4 D4 B3  12454342 54212324
   E5 G5 C6 E6 C6 B5 C6 G5  12454342 54212324
   E6 C6 G5 E5 G5 F5 G5 E5  54213231 12453435
   E4 C4 G3 E3 G3 F3 G3 F3  54213232 12453434
"""

# Bars on the way up and on the way down, before the last note.
BAR_COUNTS = {
    **dict.fromkeys(range(2, 20), (14, 14)),
    1: (14, 15),
    12: (14, 15),
    17: (14, 13),
    20: (15, 15),
}


def written_bars():
    """Return the table above: notes and fingers of five bars, by number."""
    bars = {}
    for block in BARS.strip().split("\n\n"):
        number, *rest = block.split()
        rows = [rest[start : start + 10] for start in range(0, 50, 10)]
        assert len(rest) == 50
        bars[int(number)] = [
            ([pitch_number(name) for name in row[:8]], row[8], row[9]) for row in rows
        ]
    return bars


WRITTEN = written_bars()
NUMBERS = list(range(1, 21))


def hanon(number, **options):
    return HANON[f"hanon-{number:02}"].score(**options)


def bars_of(score, hand):
    """Return the bars of a hand, each as its pitches and the digits of its fingers."""
    bars = []
    for start, end in pairwise([*score.bars, float("inf")]):
        notes = [n for n in score.notes if n.hand == hand and start <= n.onset < end]
        fingers = "".join(str(finger_number(note.finger)) for note in notes)
        bars.append(([note.pitch for note in notes], fingers))
    return bars


def white_keys(pitches):
    """Return pitches as counts of white keys."""
    return [7 * (p // 12) + (0, 2, 4, 5, 7, 9, 11).index(p % 12) for p in pitches]


def test_there_are_twenty():
    assert list(HANON) == [f"hanon-{number:02}" for number in NUMBERS]


@pytest.mark.parametrize("number", WRITTEN)
def test_the_first_two_bars_and_those_at_the_turns_are_the_written_ones(number):
    score = hanon(number)
    up, down = BAR_COUNTS[number]
    places = (0, 1, up - 1, up, up + down - 1)
    for index, (pitches, right, left) in zip(places, WRITTEN[number], strict=True):
        assert bars_of(score, "right")[index] == (pitches, right)
        assert bars_of(score, "left")[index] == ([pitch - 12 for pitch in pitches], left)


@pytest.mark.parametrize("hand", ["right", "left"])
@pytest.mark.parametrize("number", NUMBERS)
def test_between_the_turns_each_bar_is_the_one_before_a_white_key_on(number, hand):
    bars = bars_of(hanon(number), hand)
    up, down = BAR_COUNTS[number]
    for first, last, step in ((1, up - 2, 1), (up, up + down - 2, -1)):
        for index in range(first, last):
            (pitches, fingers), (after, same) = bars[index : index + 2]
            assert white_keys(after) == [key + step for key in white_keys(pitches)]
            assert same == fingers


@pytest.mark.parametrize("number", NUMBERS)
def test_all_ends_with_the_first_note_held_for_a_bar(number):
    score = hanon(number)
    ends = {20: {(52, 0), (60, 4), (36, 9), (48, 5)}}.get(number, {(48, 0), (36, 9)})
    last = [note for note in score.notes if note.onset == score.bars[-1]]
    assert {(note.pitch, note.finger) for note in last} == ends
    assert {note.duration for note in last} == {2.0}
    assert len(score.bars) == sum(BAR_COUNTS[number]) + 1


def test_a_bar_is_eight_sixteenths_of_two_four_time_at_60():
    score = hanon(1)
    assert score.bars == tuple(2.0 * bar for bar in range(30))
    right = [note for note in score.notes if note.hand == "right"][:-1]
    assert [note.onset for note in right] == [0.25 * index for index in range(232)]
    assert {note.duration for note in right} == {0.25}
    assert score.duration == 60.0


def test_the_titles_and_what_is_said_about_them():
    piece = HANON["hanon-07"]
    assert piece.title == "Hanon's exercise no. 7"
    assert (piece.collection, piece.fingering) == ("hanon", "Hanon's")
    assert "Virtuoso Pianist" in piece.source
    assert set(piece.options) == {"tempo", "hands", "repeats", "octaves", "key"}
    assert hanon(7).title == hanon(7, key="D").title == "hanon-07"
    assert load_score("hanon-07") == hanon(7)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("key", "semitones"), [("C", 0), ("Db", 1), ("Eb", 3), ("Gb", 6), ("G", -5), ("B", -1)]
)
def test_a_key_shifts_the_exercise_at_most_six_semitones(key, semitones):
    assert hanon(13, key=key) == hanon(13).transpose(semitones)


def test_repeats_come_before_the_last_note():
    once, twice = hanon(17, hands="left"), hanon(17, hands="left", repeats=2)
    assert bars_of(twice, "left") == bars_of(once, "left")[:-1] + bars_of(once, "left")
    assert twice.duration == 2 * once.duration - 2.0


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("key", "bb", "key is 'bb': expected one of 'C', 'Db', 'D', .*, 'B'. Did you mean 'Bb'"),
        ("key", ["C"], r"key is \['C'\]: expected one of"),
        ("octaves", 0, "octaves is 0: expected a whole number from 1 to 4"),
        ("title", "x", "Piece 'hanon-01' has no option 'title'"),
    ],
)
def test_a_bad_option_is_refused_with_what_was_expected(option, value, message):
    with pytest.raises(ConfigError, match=message):
        hanon(1, **{option: value})
