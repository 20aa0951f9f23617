"""Fingers for whole scores, both hands."""

from dataclasses import replace

from short_scores import note_of, score_of

from sb3_piano.music import BUILT_IN, Pedal, Score
from sb3_piano.music.fingering import agreement, finger_score, without_fingers

KEYS = ("C", "Db", "D", "Eb", "E", "F", "Gb", "G", "Ab", "A", "Bb", "B")


def shares(pieces, **options):
    """The share of fingers found again, over all of some pieces: (right hand, left hand)."""
    found = [
        agreement(score, finger_score(without_fingers(score, keep_hands=True)))
        for score in (BUILT_IN[name].score(**options) for name in pieces)
    ]
    return tuple(
        sum(a.same_finger[hand] for a in found) / sum(a.notes[hand] for a in found)
        for hand in (0, 1)
    )


def numbers(score, hand):
    """The fingers of a hand, numbered as pianists do."""
    return "".join(str(note.finger % 5 + 1) for note in score.notes if note.hand == hand)


def tune(*pitches, hand=None, step=0.25):
    return score_of(*((step * i, step * (i + 1), p, hand) for i, p in enumerate(pitches)))


def test_a_score_without_any_hint_gets_hands_and_fingers():
    pitches = (60, 62, 64, 65, 67)
    both = score_of(
        *((0.25 * i, 0.25 * (i + 1), p + away) for i, p in enumerate(pitches) for away in (-24, 12))
    )
    found = finger_score(both)
    assert numbers(found, "right") == "12345"
    assert numbers(found, "left") == "54321"
    assert {note.finger for note in found.notes if note.hand == "left"} == {5, 6, 7, 8, 9}


def test_everything_but_hand_and_finger_stays():
    note = note_of(0.0, 1.0, velocity=33)
    piece = Score(notes=[note], pedals=[Pedal(onset=0, offset=1)], title="piece", bars=[0, 1])
    found = finger_score(piece)
    (note,) = found.notes
    assert note.finger >= 0
    assert replace(note, finger=-1, hand=None) == piece.notes[0]
    assert (found.pedals, found.title, found.bars) == (piece.pedals, piece.title, piece.bars)


def test_a_known_hand_is_kept_even_in_the_others_register():
    assert {note.hand for note in finger_score(tune(72, 74, 76, hand="left")).notes} == {"left"}
    assert {note.hand for note in finger_score(tune(40, 41, 43, hand="right")).notes} == {"right"}


def test_the_mirrored_piece_has_the_mirrored_fingers():
    piece = without_fingers(BUILT_IN["repertoire-MapleLeafRag"].score(), keep_hands=True)

    def mirrored(score):
        # About D4 and with hands changed; fingers 0-4 are the right hand's, 5-9 the left's.
        swap = {"right": "left", "left": "right"}
        notes = [
            replace(
                note,
                pitch=124 - note.pitch,
                hand=swap[note.hand],
                finger=(note.finger + 5) % 10 if note.finger >= 0 else -1,
            )
            for note in score.notes
        ]
        return Score(notes=notes)

    assert finger_score(mirrored(piece)) == mirrored(finger_score(piece))


def test_notes_held_for_ever_do_not_use_the_fingers_up():
    # As from a file whose pedal is written out: nothing is let go before the end.
    piece = score_of(*((0.2 * i, 60.0, 36 + 7 * i % 50) for i in range(60)))
    assert all(note.finger >= 0 for note in finger_score(piece).notes)


def test_a_key_beyond_ten_has_a_hand_but_no_finger():
    found = finger_score(score_of(*((0.0, 1.0, pitch) for pitch in range(50, 62))))
    assert sorted(note.finger for note in found.notes) == [-1, -1, *range(10)]
    assert all(note.hand is not None for note in found.notes)


def test_major_scales_get_the_standard_fingers():
    # Those of one octave from a black key excepted, at their ends and their top: there the
    # standard has the fingers with which a longer scale would go on.
    for key in KEYS:
        piece = BUILT_IN[f"scale-{key}Major"].score()
        found = finger_score(without_fingers(piece, keep_hands=True))
        for hand in ("right", "left"):
            pairs = zip(numbers(piece, hand), numbers(found, hand), strict=True)
            other = {place for place, (standard, digit) in enumerate(pairs) if standard != digit}
            assert other <= {0, 1, 7, 13, 14}, (key, hand, other)
            if key in ("C", "D", "E", "F", "G", "A"):
                assert not other, (key, hand, other)


def test_most_fingers_of_the_studies_are_found_again():
    studies = {
        kind: [name for name, piece in BUILT_IN.items() if piece.collection == kind]
        for kind in ("scale", "arpeggio", "hanon")
    }
    assert min(shares(studies["scale"])) > 0.85
    assert min(shares(studies["arpeggio"])) > 0.7
    assert min(shares(studies["hanon"][::4])) > 0.8


def test_most_fingers_of_music_are_found_again():
    repertoire = [name for name, piece in BUILT_IN.items() if piece.collection == "repertoire"]
    right, left = shares(repertoire)
    assert right > 0.8
    assert left > 0.73
