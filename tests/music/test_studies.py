import pickle
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import yaml
from yaml_rows import Tables

from sb3_piano.exceptions import ConfigError
from sb3_piano.music import PianoRoll, find_piece, load_score
from sb3_piano.music.hands import finger_number
from sb3_piano.music.pitch import pitch_number
from sb3_piano.music.studies.debug import DEBUG, major_scale
from sb3_piano.music.studies.hanon import HANON
from sb3_piano.music.studies.scales import ARPEGGIOS, SCALES

tables = Tables(__file__)

_HANDS = ("OneHand", "TwoHands")
REFERENCE = Path(__file__).parents[1] / "data" / "reference"


@tables("name, file")
def test_rolls_equal_those_of_robopianist(name, file):
    reference = np.load(REFERENCE / f"{file}.npz")
    buffer = float(reference.get("initial_buffer_time", 0.0))
    roll = PianoRoll.from_score(load_score(name), 0.05, initial_buffer_time=buffer)
    steps, keys = np.nonzero(roll.active)
    rows = np.column_stack([steps, keys, roll.finger[steps, keys]])
    assert np.array_equal(rows, reference["roll_notes"])
    assert np.array_equal(roll.sustain, reference["sustains"])


@pytest.mark.parametrize("name", [name.removeprefix("debug-") for name in DEBUG])
def test_titles_are_the_names_and_every_note_has_a_finger(name):
    score = load_score(name)
    assert score.title == name
    assert all(0 <= note.finger <= 9 and note.velocity == 80 for note in score.notes)


@pytest.mark.parametrize("key", ["C", "D"])
def test_one_hand_is_the_right_hand_of_two(key):
    two_hands = load_score(f"{key}MajorScaleTwoHands").notes
    right = tuple(note for note in two_hands if note.finger <= 4)
    assert load_score(f"{key}MajorScaleOneHand").notes == right


def test_twinkle_has_two_phrases_that_end_in_a_long_note():
    notes = load_score("TwinkleTwinkleLittleStar").notes
    assert [note.pitch for note in notes] == [
        *(60, 60, 67, 67, 69, 69, 67),
        *(65, 65, 64, 64, 62, 62, 60),
    ]
    assert [note.finger for note in notes] == [0, 0, 2, 2, 3, 3, 2, 3, 3, 2, 2, 1, 1, 0]
    assert [note.duration for note in notes] == ([0.5] * 6 + [1.0]) * 2
    assert [note.onset for note in notes[6:8]] == [3.0, 4.0]


@tables("name, bars")
def test_the_studies_are_in_four_four_time(name, bars):
    assert load_score(name).bars == tuple(bars)


def test_a_scale_starts_where_and_lasts_as_long_as_asked():
    scale = major_scale(left=40, note_duration=0.25, title="E")
    assert [note.pitch for note in scale.notes[:8]] == [40, 42, 44, 45, 47, 49, 51, 52]
    assert (scale.duration, scale.title) == (3.75, "E")


# Scales and arpeggios.


STUDIES = {**SCALES, **ARPEGGIOS}
FINGERS = yaml.safe_load(
    (Path(__file__).parents[1] / "data" / "music" / "scale_fingers.yml").read_text()
)
CASES = [
    (name, octaves, fingers)
    for octaves, table in enumerate(FINGERS.values(), start=1)
    for name, fingers in table.items()
]


def part(name, hand, **options):
    """Return the notes of one hand."""
    return [note for note in STUDIES[name].score(**options).notes if note.hand == hand]


def numbers(notes):
    return [finger_number(note.finger) for note in notes]


def there_and_back(items):
    return [*items, *items[-2::-1]]


def digits(text):
    return [int(digit) for digit in text.split()]


def test_there_are_scales_and_arpeggios_in_all_keys_and_no_others():
    assert sorted(STUDIES) == sorted(FINGERS["one octave"])


@pytest.mark.parametrize(("name", "octaves", "fingers"), CASES)
def test_fingers_are_the_standard_ones_up_and_back(name, octaves, fingers):
    for hand, text in zip(("right", "left"), fingers, strict=True):
        assert numbers(part(name, hand, octaves=octaves)) == there_and_back(digits(text))


@tables("name, pitches")
def test_the_left_hand_plays_two_octaves_below_the_right(name, pitches):
    up = [pitch_number(pitch) for pitch in pitches.split()]
    assert [note.pitch for note in part(name, "right")] == there_and_back(up)
    assert [note.pitch + 24 for note in part(name, "left")] == there_and_back(up)


@pytest.mark.parametrize("name", [name for name in SCALES if name.endswith("Major")])
def test_a_major_scale_is_robovirtuosos_15_quarter_notes_a_hand(name):
    score = SCALES[name].score()
    assert score.bars == (0.0, 3.0, 6.0, 9.0)
    assert score.duration == 11.25
    for hand in ("right", "left"):
        notes = part(name, hand)
        assert [note.onset for note in notes] == [0.75 * index for index in range(15)]
        assert {note.duration for note in notes} == {0.75}


def test_a_piece_says_what_it_is_and_survives_pickling():
    piece = SCALES["scale-BbMajor"]
    assert piece.title == "B flat major scale"
    assert (piece.collection, piece.fingering) == ("scale", "standard")
    assert piece.source == "generated, as in RoboVirtuoso"
    assert set(piece.options) == {"tempo", "hands", "repeats", "octaves"}
    assert SCALES["scale-FSharpHarmonicMinor"].title == "F sharp harmonic minor scale"
    assert SCALES["scale-Chromatic"].title == "Chromatic scale"
    assert pickle.loads(pickle.dumps(piece.build))(tempo=90) == piece.score(tempo=90)


def test_tempo_hand_octaves_and_repeats_are_as_asked_for():
    piece = SCALES["scale-CMajor"]
    score = piece.score(tempo=120)  # quarter notes a minute
    assert (score.notes[2].onset, score.duration, score.bars) == (0.5, 7.5, (0.0, 2.0, 4.0, 6.0))
    for hand in ("right", "left"):
        assert list(piece.score(hands=hand).notes) == part("scale-CMajor", hand)
    pitches = [note.pitch for note in part("scale-CMajor", "left", octaves=2, hands="left")]
    assert pitches == there_and_back([48, 50, 52, 53, 55, 57, 59, 60, 62, 64, 65, 67, 69, 71, 72])
    once, twice = piece.score(hands="left"), piece.score(hands="left", repeats=2)
    assert twice.bars == tuple(3.0 * bar for bar in range(8))
    assert twice.excerpt(0.0, 12.0).notes == once.notes
    assert twice.excerpt(12.0, 24.0).notes == once.notes
    assert twice.duration == 23.25


@tables("name, options, most")
def test_octaves_go_as_far_as_the_keyboard(name, options, most):
    piece = SCALES[f"scale-{name}"]
    assert piece.score(octaves=most, **options).pitch_range[1] in range(97, 109)
    with pytest.raises(ConfigError, match=f"octaves is {most + 1}: expected a whole .* to {most},"):
        piece.score(octaves=most + 1, **options)


@tables("study, option, value, message")
def test_a_bad_option_is_refused_with_what_was_expected(study, option, value, message):
    with pytest.raises(ConfigError, match=message):
        find_piece(study).score(**{option: value})


def test_an_arpeggio_is_two_bars_of_quarter_notes_at_80_with_the_options_of_a_scale():
    piece = ARPEGGIOS["arpeggio-CSharpMinor"]
    assert (piece.title, piece.collection) == ("C sharp minor arpeggio", "arpeggio")
    assert set(piece.options) == {"tempo", "hands", "repeats", "octaves"}
    assert (piece.score().bars, piece.score().duration) == ((0.0, 3.0), 5.25)
    score = ARPEGGIOS["arpeggio-DMajor"].score(tempo=60, hands="left", repeats=2, octaves=2)
    assert [note.pitch for note in score.notes] == there_and_back([50, 54, 57, 62, 66, 69, 74]) * 2
    assert score.bars == tuple(4.0 * bar for bar in range(8))
    with pytest.raises(ConfigError, match="octaves is 3: expected a whole number from 1 to 2,"):
        ARPEGGIOS["arpeggio-BMajor"].score(octaves=3)


# Hanon's exercises, against bars copied from the edition as the Mutopia Project gives it.


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
