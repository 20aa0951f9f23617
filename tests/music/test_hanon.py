"""Hanon's exercises, against bars copied from the edition as the Mutopia Project gives it."""

from itertools import pairwise
from pathlib import Path

import pytest
from yaml_rows import Tables

from sb3_piano.exceptions import ConfigError
from sb3_piano.music import load_score
from sb3_piano.music.hands import finger_number
from sb3_piano.music.pitch import pitch_number
from sb3_piano.music.studies.hanon import HANON

tables = Tables(__file__)

BARS = Path(__file__).parents[1] / "data" / "music" / "hanon_bars.txt"

# Bars on the way up and on the way down, before the last note.
BAR_COUNTS = {
    **dict.fromkeys(range(2, 20), (14, 14)),
    1: (14, 15),
    12: (14, 15),
    17: (14, 13),
    20: (15, 15),
}


def written_bars():
    """Return notes and fingers of five bars, by number."""
    bars = {}
    for block in BARS.read_text().strip().split("\n\n")[1:]:
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


def test_there_are_twenty_with_their_titles_and_what_is_said_about_them():
    assert list(HANON) == [f"hanon-{number:02}" for number in NUMBERS]
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


@tables("option, value, message")
def test_a_bad_option_is_refused_with_what_was_expected(option, value, message):
    with pytest.raises(ConfigError, match=message):
        hanon(1, **{option: value})
