from itertools import pairwise

import pytest

from sb3_piano.exceptions import ConfigError
from sb3_piano.music.hands import finger_number
from sb3_piano.music.pitch import pitch_number
from sb3_piano.music.studies import ARPEGGIOS

BLACK = {1, 3, 6, 8, 10}

# One octave up, right and left hand, from St. Olaf College's list of arpeggio fingerings.
FINGERS = {
    **dict.fromkeys(["CMajor", "FMajor", "GMajor"], ("1 2 3 5", "5 4 2 1")),
    **dict.fromkeys(["DMajor", "EMajor", "AMajor", "BMajor"], ("1 2 3 5", "5 3 2 1")),
    **dict.fromkeys(["DbMajor", "EbMajor", "AbMajor"], ("2 1 2 4", "2 1 4 2")),
    "GbMajor": ("1 2 3 5", "5 3 2 1"),
    "BbMajor": ("2 1 2 4", "3 2 1 3"),
    **dict.fromkeys([f"{key}Minor" for key in "CDEFGAB"], ("1 2 3 5", "5 4 2 1")),
    **dict.fromkeys(["CSharpMinor", "FSharpMinor", "GSharpMinor"], ("2 1 2 4", "2 1 4 2")),
    "EbMinor": ("1 2 3 5", "5 4 2 1"),
    "BbMinor": ("2 3 1 2", "3 2 1 3"),
}

# Two octaves up: C to D flat from the chart of the Bellingham Music Teachers Association (whose
# other right hand for D flat this is), the rest from St. Olaf College.
TWO_OCTAVES = {
    "CMajor": ("1 2 3 1 2 3 5", "5 4 2 1 4 2 1"),
    "DMajor": ("1 2 3 1 2 3 5", "5 3 2 1 3 2 1"),
    "GbMajor": ("1 2 3 1 2 3 5", "5 3 2 1 3 2 1"),
    "DbMajor": ("2 1 2 4 1 2 4", "2 1 4 2 1 4 2"),
    "BbMajor": ("2 1 2 4 1 2 4", "3 2 1 3 2 1 3"),
    "BbMinor": ("2 3 1 2 3 1 2", "3 2 1 3 2 1 3"),
}


def part(name, hand, **options):
    """Return the notes of one hand of an arpeggio."""
    notes = ARPEGGIOS[f"arpeggio-{name}"].score(**options).notes
    return [note for note in notes if note.hand == hand]


def numbers(notes):
    return [finger_number(note.finger) for note in notes]


def there_and_back(items):
    return [*items, *items[-2::-1]]


def digits(text):
    return [int(digit) for digit in text.split()]


def test_there_is_an_arpeggio_of_each_major_and_minor_triad():
    assert sorted(ARPEGGIOS) == sorted(f"arpeggio-{name}" for name in FINGERS)
    assert len(ARPEGGIOS) == 24


@pytest.mark.parametrize(("name", "fingers"), FINGERS.items())
def test_fingers_are_the_standard_ones_up_and_back(name, fingers):
    for hand, text in zip(("right", "left"), fingers, strict=True):
        assert numbers(part(name, hand)) == there_and_back(digits(text))


@pytest.mark.parametrize(("name", "fingers"), TWO_OCTAVES.items())
def test_fingers_of_two_octaves_are_the_standard_ones(name, fingers):
    for hand, text in zip(("right", "left"), fingers, strict=True):
        assert numbers(part(name, hand, octaves=2)) == there_and_back(digits(text))


@pytest.mark.parametrize("name", FINGERS)
def test_thumbs_are_on_black_keys_only_where_all_are_black(name):
    for hand in ("right", "left"):
        notes = part(name, hand, octaves=2)
        thumbs = [note for note in notes if finger_number(note.finger) == 1]
        black = [note.pitch % 12 in BLACK for note in thumbs]
        assert any(black) is all(black) is (name in ("GbMajor", "EbMinor"))


@pytest.mark.parametrize("name", FINGERS)
def test_no_finger_strikes_two_keys_running(name):
    for hand in ("right", "left"):
        fingers = numbers(part(name, hand, octaves=2))
        assert all(a != b for a, b in pairwise(fingers))


@pytest.mark.parametrize(
    ("name", "right", "left"),
    [
        ("CMajor", "C5 E5 G5 C6", "C3 E3 G3 C4"),
        ("CMinor", "C5 Eb5 G5 C6", "C3 Eb3 G3 C4"),
        ("AbMajor", "Ab5 C6 Eb6 Ab6", "Ab3 C4 Eb4 Ab4"),
        ("FSharpMinor", "F#5 A5 C#6 F#6", "F#3 A3 C#4 F#4"),
        ("BMajor", "B5 D#6 F#6 B6", "B3 D#4 F#4 B4"),
    ],
)
def test_pitches_of_some_arpeggios(name, right, left):
    for hand, text in (("right", right), ("left", left)):
        pitches = [pitch_number(pitch) for pitch in text.split()]
        assert [note.pitch for note in part(name, hand)] == there_and_back(pitches)


def test_two_bars_of_quarter_notes_at_80_beats_a_minute():
    score = ARPEGGIOS["arpeggio-GMinor"].score()
    assert score.bars == (0.0, 3.0)
    assert score.duration == 5.25
    assert [note.onset for note in part("GMinor", "left")] == [0.75 * beat for beat in range(7)]


def test_options_are_those_of_the_scales():
    score = ARPEGGIOS["arpeggio-DMajor"].score(tempo=60, hands="left", repeats=2, octaves=2)
    up = [50, 54, 57, 62, 66, 69, 74]
    assert [note.pitch for note in score.notes] == there_and_back(up) * 2
    assert score.bars == tuple(4.0 * bar for bar in range(8))
    assert score.notes[13].onset == 16.0


def test_a_piece_says_what_it_is():
    piece = ARPEGGIOS["arpeggio-CSharpMinor"]
    assert piece.title == "C sharp minor arpeggio"
    assert (piece.collection, piece.fingering) == ("arpeggio", "standard")
    assert set(piece.options) == {"tempo", "hands", "repeats", "octaves"}


def test_octaves_beyond_the_keyboard_are_refused():
    with pytest.raises(ConfigError, match="octaves is 3: expected a whole number from 1 to 2,"):
        ARPEGGIOS["arpeggio-BMajor"].score(octaves=3)
