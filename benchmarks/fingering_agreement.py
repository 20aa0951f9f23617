"""How far our fingering agrees with the labels of the built-in pieces, beside other methods.

    python benchmarks/fingering_agreement.py

Each method gets the notes of each hand as the labels give them, so that only fingers are compared,
and none sees a label. Beside ours stand pianoplayer (``pip install pianoplayer``) and a rule: keys
of a chord get the fingers in their order, and a hand at rest over five white keys moves only as far
as the next chord asks. Prints tables in Markdown: agreement, and the time for long pieces. With
pianoplayer all this takes about a quarter of an hour (``--methods`` and ``--pieces`` leave out
some).

``--files`` takes labelled scores from elsewhere in place of the built-in pieces. The corpus of
music21 has four with some fingers of the edition, Clara Schumann's polonaises op. 1::

    folder=$(python -c "import music21; print(music21.__path__[0])")/corpus/schumann_clara
    python benchmarks/fingering_agreement.py --files $folder/polonaise_op1n*.mxl
"""

from __future__ import annotations

import argparse
import importlib.util
import itertools
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from rich.console import Console
from rich.progress import track

from sb3_piano.music import BUILT_IN, MAX_PITCH, MIN_PITCH, Note, Score, read_score
from sb3_piano.music.constants import FINGERS_PER_HAND
from sb3_piano.music.fingering import Agreement, agreement, finger_score, without_fingers
from sb3_piano.music.hands import HANDS, Hand, finger_of

Method = Callable[[Score], Score]

MUSIC = ("repertoire", "file")
"""What is no study."""

PLAYER_NOTES = 1000
"""Notes of the long piece that pianoplayer gets; its time grows with their number."""
CHORD_STAGGER = 0.05
"""By how much pianoplayer's own readers spread the notes of a chord, in s."""
WHITE_KEY = 12 / 7  # semitones from one to the next, on average
NAMES = ("C", "C#", "D", "D#", "E", "F", "F#", "G", "G#", "A", "A#", "B")
BLACK = (1, 3, 6, 8, 10)


def chords_of(score: Score, hand: Hand) -> list[list[Note]]:
    """Return the notes that a hand strikes at the same time, each chord from its lowest up."""
    notes = [note for note in score.notes if note.hand == hand]
    return [list(chord) for _, chord in itertools.groupby(notes, key=lambda note: note.onset)]


def with_fingers(score: Score, fingers: Mapping[Hand, Iterable[int]]) -> Score:
    """Return the score with the pianists' fingers (1-5) of each hand's notes in their order."""
    left = {hand: iter(numbers) for hand, numbers in fingers.items()}
    notes = [
        note
        if note.hand is None
        else replace(note, finger=finger_of(note.hand, next(left[note.hand])))
        for note in score.notes
    ]
    return Score(notes=notes, title=score.title)


# A rule: five fingers over five white keys.


def resting_hand(score: Score) -> Score:
    """Finger by the nearest of five fingers that rest over neighbouring white keys."""
    return with_fingers(score, {hand: list(_rest(score, hand)) for hand in HANDS})


def _rest(score: Score, hand: Hand) -> Iterable[int]:
    thumb: float | None = None  # pitch below the thumb; the left hand is seen in a mirror
    for chord in chords_of(score, hand):
        pitches = [note.pitch if hand == "right" else -note.pitch for note in chord]
        pitches.sort()
        width = (FINGERS_PER_HAND - 1) * WHITE_KEY
        if thumb is None or pitches[0] < thumb - WHITE_KEY / 2:
            thumb = float(pitches[0])
        elif pitches[-1] > thumb + width + WHITE_KEY / 2:
            thumb = max(float(pitches[-1]) - width, thumb)
        found = _in_order([round((pitch - thumb) / WHITE_KEY) for pitch in pitches])
        yield from (found if hand == "right" else reversed(found))


def _in_order(places: Sequence[int]) -> list[int]:
    """Return a finger (1-5) for each place (0-4), rising, the nearest possible."""
    choices = itertools.combinations(range(FINGERS_PER_HAND), min(len(places), FINGERS_PER_HAND))
    best = min(choices, key=lambda c: sum(abs(f - p) for f, p in zip(c, places, strict=False)))
    rest = [FINGERS_PER_HAND] * (len(places) - len(best))
    return [finger + 1 for finger in best] + rest


# pianoplayer.


def pianoplayer(score: Score) -> Score:
    """Finger by pianoplayer, a hand at a time, its settings as they come."""
    return with_fingers(score, {hand: _player_fingers(score, hand) for hand in HANDS})


def _player_fingers(score: Score, hand: Hand) -> list[int]:
    from pianoplayer.hand import Hand as PlayerHand
    from pianoplayer.models import INote, keypos

    sequence = []
    for number, chord in enumerate(chords_of(score, hand)):
        for place, note in enumerate(chord):
            last = len(chord) - 1
            given = INote(
                name=NAMES[note.pitch % 12],
                octave=note.pitch // 12 - 1,
                pitch=note.pitch,
                isBlack=note.pitch % 12 in BLACK,
                # As its reader of MusicXML gives chords.
                isChord=last > 0,
                chordID=number,
                chordnr=place,
                NinChord=len(chord),
                time=note.onset - CHORD_STAGGER * (last - place),
                duration=note.duration + CHORD_STAGGER * last,
                noteID=len(sequence),
            )
            given.x = keypos(given)
            sequence.append(given)
    if not sequence:
        return []
    player = PlayerHand(noteseq=sequence, side=hand)
    player.verbose = False
    player.generate()
    # It leaves out notes of chords that it finds no finger for: these are wrong, whatever they get.
    return [int(note.fingering) or 1 for note in sequence]


METHODS: Mapping[str, Method] = {
    "ours": lambda score: finger_score(score),
    "pianoplayer": pianoplayer,
    "resting hand": resting_hand,
}


# Measuring.


def labelled_pieces() -> dict[str, Score]:
    """Return the built-in pieces all of whose notes have labels."""
    scores = {name: piece.score() for name, piece in BUILT_IN.items()}
    return {n: s for n, s in scores.items() if all(note.finger >= 0 for note in s.notes)}


def compare(
    methods: Mapping[str, Method], pieces: Mapping[str, Score]
) -> tuple[dict[str, dict[str, Agreement]], dict[str, float]]:
    """Return each method's agreement on each piece, and its time for all of them, in s."""
    found: dict[str, dict[str, Agreement]] = {}
    seconds: dict[str, float] = {}
    for name, method in methods.items():
        found[name], seconds[name] = {}, 0.0
        for title, labelled in track(
            pieces.items(), name, len(pieces), console=Console(stderr=True), transient=True
        ):
            bare = without_fingers(labelled, keep_hands=True)
            start = time.perf_counter()
            fingered = method(bare)
            seconds[name] += time.perf_counter() - start
            found[name][title] = agreement(labelled, fingered)
    return found, seconds


def collection_of(name: str) -> str:
    """Return the collection of a piece, ``"file"`` for one of a file."""
    return BUILT_IN[name].collection if name in BUILT_IN else "file"


def long_piece(pieces: Mapping[str, Score], n_notes: int) -> Score:
    """Return pieces one after the other, again and again, until there are enough notes.

    Studies, which repeat themselves, are left out if there is anything else; and each time round is
    in another key, so that little of what was worked out before can be used again.
    """
    music = [score for name, score in pieces.items() if collection_of(name) in MUSIC]
    notes: list[Note] = []
    start = 0.0
    for number, score in enumerate(itertools.cycle(music or list(pieces.values()))):
        low, high = score.pitch_range
        shift = number // len(music or pieces) % 12 - 5
        score = score.transpose(min(max(shift, MIN_PITCH - low), MAX_PITCH - high))
        notes += [replace(n, onset=n.onset + start, offset=n.offset + start) for n in score.notes]
        start += score.duration + 0.5
        if len(notes) >= n_notes:
            return Score(notes=notes[:n_notes], title="all pieces")
    raise AssertionError("there are pieces")


# Printing.


def rows_of_groups(
    found: Mapping[str, Mapping[str, Agreement]], pieces: Mapping[str, Score]
) -> Iterable[tuple[str, ...]]:
    """Yield a row for each repertoire piece, and for each collection and all the means."""
    groups: dict[str, list[str]] = {}
    for title in pieces:
        if collection_of(title) in MUSIC:
            groups[title] = [title]
    for title in pieces:
        groups.setdefault(f"all of {collection_of(title)}", []).append(title)
    groups["all pieces"] = list(pieces)
    for group, titles in groups.items():
        notes = sum(note.finger >= 0 for title in titles for note in pieces[title].notes)
        cells = []
        for agreements in found.values():
            mean = sum(agreements[title].both for title in titles) / len(titles)
            same = sum(sum(agreements[title].same_finger) for title in titles)
            cells.append(
                f"{100 * mean:.1f}" + (f" ({100 * same / notes:.1f})" if len(titles) > 1 else "")
            )
        yield group, str(len(titles)), str(notes), *cells


def print_table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a table in Markdown, all but the first column aligned to the right."""
    print(f"| {' | '.join(headings)} |")
    print(f"| --- |{' ---: |' * (len(headings) - 1)}")
    for row in rows:
        print(f"| {' | '.join(row)} |")


def print_times(methods: Mapping[str, Method], pieces: Mapping[str, Score], n_notes: int) -> None:
    """Print how long a piece of many notes takes."""
    rows = []
    timed = [(name, method, True) for name, method in methods.items()]
    if "ours" in methods:
        timed.append(("ours, hands too", methods["ours"], False))
    for name, method, keep_hands in timed:
        given = min(n_notes, PLAYER_NOTES) if name == "pianoplayer" else n_notes
        score = without_fingers(long_piece(pieces, given), keep_hands=keep_hands)
        start = time.perf_counter()
        method(score)
        seconds = time.perf_counter() - start
        whole = f"{seconds * n_notes / given:.1f}" + ("" if given == n_notes else " (extrapolated)")
        rows.append((name, str(given), f"{seconds:.2f}", whole))
    print_table(("method", "notes", "s", f"s for {n_notes} notes"), rows)


def main() -> None:
    """Read the command line, measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--notes", type=int, default=10_000, help="of the long piece")
    parser.add_argument("--pieces", nargs="+", metavar="NAME", help="default: all that have labels")
    parser.add_argument("--files", nargs="+", type=Path, metavar="FILE", help="labelled scores")
    parser.add_argument("--methods", nargs="+", choices=list(METHODS), default=list(METHODS))
    arguments = parser.parse_args()
    methods = {name: METHODS[name] for name in arguments.methods}
    if "pianoplayer" in methods and importlib.util.find_spec("pianoplayer") is None:
        del methods["pianoplayer"]
        print("pianoplayer is left out: pip install pianoplayer", file=sys.stderr)
    if arguments.files:
        pieces = {path.stem: read_score(path) for path in arguments.files}
    else:
        pieces = labelled_pieces()
    if arguments.pieces:
        pieces = {name: pieces[name] for name in arguments.pieces}
    found, seconds = compare(methods, pieces)
    print("Notes with the labels' finger, %; of several pieces the mean, and that over notes.\n")
    print_table(("piece", "pieces", "notes", *found), rows_of_groups(found, pieces))
    print(
        "\nTime for all of them: " + ", ".join(f"{n} {s:.1f} s" for n, s in seconds.items()) + "\n"
    )
    print_times(methods, pieces, arguments.notes)


if __name__ == "__main__":
    main()
