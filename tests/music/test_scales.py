import pickle
from itertools import pairwise

import pytest

from sb3_piano.exceptions import ConfigError
from sb3_piano.music import load_score, major_scale
from sb3_piano.music.hands import finger_number
from sb3_piano.music.pitch import pitch_number
from sb3_piano.music.studies import SCALES

BLACK = {1, 3, 6, 8, 10}

# One octave up, right and left hand, as charts for one octave print them.
MAJOR = {
    "C": ("1 2 3 1 2 3 4 5", "5 4 3 2 1 3 2 1"),
    "Db": ("2 3 1 2 3 4 1 2", "3 2 1 4 3 2 1 3"),
    "D": ("1 2 3 1 2 3 4 5", "5 4 3 2 1 3 2 1"),
    "Eb": ("3 1 2 3 4 1 2 3", "3 2 1 4 3 2 1 3"),
    "E": ("1 2 3 1 2 3 4 5", "5 4 3 2 1 3 2 1"),
    "F": ("1 2 3 4 1 2 3 4", "5 4 3 2 1 3 2 1"),
    "Gb": ("2 3 4 1 2 3 1 2", "4 3 2 1 3 2 1 4"),
    "G": ("1 2 3 1 2 3 4 5", "5 4 3 2 1 3 2 1"),
    "Ab": ("3 4 1 2 3 1 2 3", "3 2 1 4 3 2 1 3"),
    "A": ("1 2 3 1 2 3 4 5", "5 4 3 2 1 3 2 1"),
    "Bb": ("2 1 2 3 1 2 3 4", "3 2 1 4 3 2 1 3"),
    "B": ("1 2 3 1 2 3 4 5", "4 3 2 1 4 3 2 1"),
}
NATURAL_MINOR = {
    "C": ("1 2 3 1 2 3 4 5", "5 4 3 2 1 3 2 1"),
    "CSharp": ("3 4 1 2 3 1 2 3", "3 2 1 4 3 2 1 3"),
    "D": ("1 2 3 1 2 3 4 5", "5 4 3 2 1 3 2 1"),
    "Eb": ("3 1 2 3 4 1 2 3", "2 1 4 3 2 1 3 2"),
    "E": ("1 2 3 1 2 3 4 5", "5 4 3 2 1 3 2 1"),
    "F": ("1 2 3 4 1 2 3 4", "5 4 3 2 1 3 2 1"),
    "FSharp": ("3 4 1 2 3 1 2 3", "4 3 2 1 3 2 1 4"),
    "G": ("1 2 3 1 2 3 4 5", "5 4 3 2 1 3 2 1"),
    "GSharp": ("3 4 1 2 3 1 2 3", "3 2 1 3 2 1 4 3"),
    "A": ("1 2 3 1 2 3 4 5", "5 4 3 2 1 3 2 1"),
    "Bb": ("2 1 2 3 1 2 3 4", "2 1 3 2 1 4 3 2"),
    "B": ("1 2 3 1 2 3 4 5", "4 3 2 1 4 3 2 1"),
}
HARMONIC_MINOR = {**NATURAL_MINOR, "GSharp": ("3 4 1 2 3 1 2 3", "3 2 1 4 3 2 1 3")}

# Two octaves up, from the chart of the Bellingham Music Teachers Association.
TWO_OCTAVES = {
    "C": ("1 2 3 1 2 3 4 1 2 3 1 2 3 4 5", "5 4 3 2 1 3 2 1 4 3 2 1 3 2 1"),
    "B": ("1 2 3 1 2 3 4 1 2 3 1 2 3 4 5", "4 3 2 1 4 3 2 1 3 2 1 4 3 2 1"),
    "Gb": ("2 3 4 1 2 3 1 2 3 4 1 2 3 1 2", "4 3 2 1 3 2 1 4 3 2 1 3 2 1 4"),
    "Db": ("2 3 1 2 3 4 1 2 3 1 2 3 4 1 2", "3 2 1 4 3 2 1 3 2 1 4 3 2 1 3"),
}

CASES = [
    *((f"{key}Major", fingers) for key, fingers in MAJOR.items()),
    *((f"{key}NaturalMinor", fingers) for key, fingers in NATURAL_MINOR.items()),
    *((f"{key}HarmonicMinor", fingers) for key, fingers in HARMONIC_MINOR.items()),
    ("Chromatic", ("1 3 1 3 1 2 3 1 3 1 3 1 2", "1 3 1 3 2 1 3 1 3 1 3 2 1")),
]


def part(name, hand, **options):
    """Return the notes of one hand of a scale."""
    notes = SCALES[f"scale-{name}"].score(**options).notes
    return [note for note in notes if note.hand == hand]


def numbers(notes):
    return [finger_number(note.finger) for note in notes]


def there_and_back(items):
    return [*items, *items[-2::-1]]


def digits(text):
    return [int(digit) for digit in text.split()]


def test_there_are_scales_in_all_keys_and_no_others():
    assert sorted(SCALES) == sorted(f"scale-{name}" for name, _ in CASES)


@pytest.mark.parametrize(("name", "fingers"), CASES)
def test_fingers_are_the_standard_ones_up_and_back(name, fingers):
    assert numbers(part(name, "right")) == there_and_back(digits(fingers[0]))
    assert numbers(part(name, "left")) == there_and_back(digits(fingers[1]))


@pytest.mark.parametrize(("key", "fingers"), TWO_OCTAVES.items())
def test_fingers_of_two_octaves_are_the_standard_ones(key, fingers):
    for hand, text in zip(("right", "left"), fingers, strict=True):
        assert numbers(part(f"{key}Major", hand, octaves=2)) == there_and_back(digits(text))


def test_the_chromatic_scale_has_2_on_every_c_but_the_first_in_two_octaves():
    notes = part("Chromatic", "right", octaves=2)[:25]
    assert numbers(notes)[::12] == [1, 2, 2]
    assert numbers(notes)[1:13] == numbers(notes)[13:]
    assert numbers(part("Chromatic", "left", octaves=2)[:25])[::12] == [1, 1, 1]


def test_a_third_octave_has_the_fingers_of_the_second():
    fingers = numbers(part("CMajor", "right", octaves=3)[:22])
    assert fingers == digits("1 2 3 1 2 3 4 1 2 3 1 2 3 4 1 2 3 1 2 3 4 5")


# The exceptions that the rule of the next test has: too many black keys in a row, and the third
# finger on the A of B flat harmonic minor.
OFF_THE_RULE = {
    ("BbHarmonicMinor", "right"),
    ("BbHarmonicMinor", "left"),
    ("EbHarmonicMinor", "left"),
}


@pytest.mark.parametrize("hand", ["right", "left"])
@pytest.mark.parametrize(
    "name", [f"{key}Major" for key in ("Db", "Eb", "Gb", "Ab", "Bb")]
    + [f"{key}{kind}Minor" for key in ("CSharp", "Eb", "FSharp", "GSharp", "Bb")
       for kind in ("Natural", "Harmonic")],
)  # fmt: skip
def test_from_black_keys_thumbs_take_the_first_or_last_white_key_of_a_group(name, hand):
    notes = part(name, hand, octaves=2)[:15]
    white = [note.pitch % 12 not in BLACK for note in notes]
    thumbs = [finger_number(note.finger) == 1 for note in notes]
    step = -1 if hand == "right" else 1
    edges = [
        white[index] and not white[index + step] if 0 < index < 14 else False for index in range(15)
    ]
    assert (thumbs == edges) is ((name, hand) not in OFF_THE_RULE)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name, _ in CASES])
@pytest.mark.parametrize("octaves", [1, 2])
def test_thumbs_stay_off_black_keys_and_no_finger_strikes_two_keys_running(name, octaves):
    for hand in ("right", "left"):
        notes = part(name, hand, octaves=octaves)
        for note, after in pairwise(notes):
            assert not (note.pitch % 12 in BLACK and finger_number(note.finger) == 1)
            assert note.finger != after.finger


@pytest.mark.parametrize(
    ("name", "right", "left"),
    [
        ("CMajor", "C5 D5 E5 F5 G5 A5 B5 C6", "C3 D3 E3 F3 G3 A3 B3 C4"),
        ("BbMajor", "Bb5 C6 D6 Eb6 F6 G6 A6 Bb6", "Bb3 C4 D4 Eb4 F4 G4 A4 Bb4"),
        ("GbMajor", "Gb5 Ab5 Bb5 Cb6 Db6 Eb6 F6 Gb6", "Gb3 Ab3 Bb3 Cb4 Db4 Eb4 F4 Gb4"),
        ("ANaturalMinor", "A5 B5 C6 D6 E6 F6 G6 A6", "A3 B3 C4 D4 E4 F4 G4 A4"),
        ("AHarmonicMinor", "A5 B5 C6 D6 E6 F6 G#6 A6", "A3 B3 C4 D4 E4 F4 G#4 A4"),
        (
            "GSharpHarmonicMinor",
            "G#5 A#5 B5 C#6 D#6 E6 F##6 G#6",
            "G#3 A#3 B3 C#4 D#4 E4 F##4 G#4",
        ),
        (
            "Chromatic",
            "C5 C#5 D5 D#5 E5 F5 F#5 G5 G#5 A5 A#5 B5 C6",
            "C3 C#3 D3 D#3 E3 F3 F#3 G3 G#3 A3 A#3 B3 C4",
        ),
    ],
)
def test_pitches_of_some_scales(name, right, left):
    for hand, text in (("right", right), ("left", left)):
        pitches = [pitch_number(pitch) for pitch in text.split()]
        assert [note.pitch for note in part(name, hand)] == there_and_back(pitches)


@pytest.mark.parametrize("key", ["C", "D"])
def test_c_and_d_major_are_the_scales_of_the_debug_set_at_80_beats_a_minute(key):
    debug = load_score(f"debug-{key}MajorScaleTwoHands")
    assert load_score(f"scale-{key}Major") == major_scale(
        right=72 + 2 * (key == "D"),
        left=48 + 2 * (key == "D"),
        note_duration=0.75,
        title=f"scale-{key}Major",
    )
    assert load_score(f"scale-{key}Major").notes == debug.stretch(1.5).notes


@pytest.mark.parametrize("key", MAJOR)
def test_a_major_scale_is_robovirtuosos_15_quarter_notes_a_hand(key):
    score = SCALES[f"scale-{key}Major"].score()
    assert score.bars == (0.0, 3.0, 6.0, 9.0)
    assert score.duration == 11.25
    for hand in ("right", "left"):
        notes = part(f"{key}Major", hand)
        assert [note.onset for note in notes] == [0.75 * index for index in range(15)]
        assert {note.duration for note in notes} == {0.75}


def test_the_keys_follow_one_another_by_semitones():
    lowest = [SCALES[f"scale-{key}Major"].score().pitch_range[0] for key in MAJOR]
    assert lowest == list(range(48, 60))
    lowest = [SCALES[f"scale-{key}HarmonicMinor"].score().pitch_range[0] for key in NATURAL_MINOR]
    assert lowest == list(range(48, 60))


def test_a_piece_says_what_it_is():
    piece = SCALES["scale-BbMajor"]
    assert piece.title == "B flat major scale"
    assert (piece.collection, piece.fingering) == ("scale", "standard")
    assert piece.source == "generated, as in RoboVirtuoso"
    assert set(piece.options) == {"tempo", "hands", "repeats", "octaves"}
    assert SCALES["scale-FSharpHarmonicMinor"].title == "F sharp harmonic minor scale"
    assert SCALES["scale-Chromatic"].title == "Chromatic scale"


def test_the_tempo_is_quarter_notes_a_minute():
    score = SCALES["scale-CMajor"].score(tempo=120)
    assert (score.notes[2].onset, score.duration, score.bars) == (0.5, 7.5, (0.0, 2.0, 4.0, 6.0))


@pytest.mark.parametrize("hand", ["right", "left"])
def test_one_hand_plays_what_it_plays_in_both(hand):
    piece = SCALES["scale-EbMajor"]
    both = [note for note in piece.score().notes if note.hand == hand]
    assert list(piece.score(hands=hand).notes) == both


def test_each_repeat_begins_with_a_bar_of_its_own():
    once = SCALES["scale-CMajor"].score(hands="left")
    twice = SCALES["scale-CMajor"].score(hands="left", repeats=2)
    assert twice.bars == tuple(3.0 * bar for bar in range(8))
    assert twice.excerpt(0.0, 12.0).notes == once.notes
    assert twice.excerpt(12.0, 24.0).notes == once.notes
    assert twice.duration == 23.25


def test_more_octaves_go_on_where_the_first_ends():
    pitches = [note.pitch for note in part("CMajor", "left", octaves=2, hands="left")]
    assert pitches == there_and_back([48, 50, 52, 53, 55, 57, 59, 60, 62, 64, 65, 67, 69, 71, 72])


@pytest.mark.parametrize(
    ("name", "options", "most"),
    [
        ("CMajor", {}, 3),
        ("DbMajor", {}, 2),
        ("CMajor", {"hands": "left"}, 5),
        ("BMajor", {"hands": "left"}, 4),
    ],
)
def test_octaves_go_as_far_as_the_keyboard(name, options, most):
    piece = SCALES[f"scale-{name}"]
    assert piece.score(octaves=most, **options).pitch_range[1] in range(97, 109)
    with pytest.raises(ConfigError, match=f"octaves is {most + 1}: expected a whole .* to {most},"):
        piece.score(octaves=most + 1, **options)


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        *(
            (
                "tempo",
                value,
                rf"tempo is {value!r}: expected quarter notes a minute, a number from ",
            )
            for value in (0, 0.99, 1001, -80, "80", float("nan"), float("inf"), True, None)
        ),
        ("hands", "all", "hands is 'all'. Expected one of 'both', 'right', 'left'. Leave it out"),
        ("hands", "rihgt", "hands is 'rihgt'. Did you mean 'right'"),
        ("hands", None, "hands is None."),
        ("hands", ["right"], r"hands is \['right'\]."),
        *(
            ("repeats", value, f"repeats is {value!r}: expected a whole number, 1 or more.")
            for value in (0, -1, 1.0, "2", True)
        ),
        *(
            ("octaves", value, f"octaves is {value!r}: expected a whole number from 1 to 3")
            for value in (0, 1.5, "1", True)
        ),
        ("key", "D", "Piece 'scale-CMajor' has no option 'key'"),
    ],
)
def test_a_bad_option_is_refused_with_what_was_expected(option, value, message):
    with pytest.raises(ConfigError, match=message):
        SCALES["scale-CMajor"].score(**{option: value})


@pytest.mark.parametrize("tempo", [1, 1000])
def test_the_slowest_and_the_fastest_tempo_are_played(tempo):
    assert SCALES["scale-CMajor"].score(tempo=tempo).notes[0].duration == pytest.approx(60 / tempo)


def test_pieces_survive_pickling():
    piece = SCALES["scale-FMajor"]
    assert pickle.loads(pickle.dumps(piece.build))(tempo=90) == piece.score(tempo=90)
