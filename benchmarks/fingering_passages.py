"""Where other fingerings differ from labels, by kind of passage: docs/reproductions/curriculum.md.

    python benchmarks/fingering_passages.py
    python benchmarks/fingering_passages.py --collections crossed
    python benchmarks/fingering_passages.py --files PIG/FingeringFiles/*.txt
    python benchmarks/fingering_passages.py --write FOLDER --pieces arpeggio-CMajor

The share of labelled notes that another fingering gives another finger, with a 95 % interval over
pieces (bootstrap). Optimal transport has no finger before somebody plays: it is the assignment with
the least total distance of fingertips and due keys at the first control step of each note, while
the planned pianist plays the piece with its own fingers. The two searches get the notes of each
hand as the labels give them, and no finger. With --write, each is a table for `fingering=`.
"""

from __future__ import annotations

import argparse
import csv
import itertools
import warnings
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track
from scipy.optimize import linear_sum_assignment
from scipy.stats import bootstrap

from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import PlanWarning
from sb3_piano.lab.music.passages import KINDS, passages
from sb3_piano.music import BUILT_IN, MIN_PITCH, Note, Score, read_score
from sb3_piano.music.fingering import apply_fingering, without_fingers
from sb3_piano.music.hands import HANDS
from sb3_piano.music.pitch import pitch_name
from sb3_piano.players import PlannedPianist
from sb3_piano.training.playing.player import PLANNED_IN

PAPER = {"scale": "3.8", "hands crossed": "41.2", "all": "22.8"}
"""Notes with another finger under optimal transport, % (Farah, Lin and Walrath, section 6.4)."""


def transported(score: Score) -> list[int]:
    """Return each note's finger by optimal transport while the planned pianist plays."""
    env = PianoEnv(score, **PLANNED_IN)
    player = PlannedPianist(env)
    observation, _ = env.reset(seed=0)
    roll, chosen = env.roll, {}
    for step in range(len(roll)):
        keys = np.flatnonzero(roll.active[step])
        scene = env.simulation.scene
        tips = env.simulation.fingertips[scene.fingers]
        points = np.array([env.simulation.press_point(key) for key in keys]).reshape(-1, 3)
        distance = np.linalg.norm(tips[:, None] - points[None], axis=-1)
        for finger, key in zip(*linear_sum_assignment(distance), strict=True):
            chosen[step, int(keys[key])] = int(scene.fingers[finger])
        observation, *_ = env.step(player.predict(observation)[0])
    started = [np.flatnonzero(roll.onset[:, key]) for key in range(roll.active.shape[1])]
    turn = [0] * len(started)
    fingers = []
    for note in score.notes:  # by onset, so that the k-th note of a key is its k-th onset
        key = note.pitch - MIN_PITCH
        steps = started[key]
        step = int(steps[min(turn[key], len(steps) - 1)])
        turn[key] += 1
        fingers.append(chosen[step, key])
    return fingers


def searched(score: Score, fingering: str) -> list[int]:
    """Return each note's finger by a search that knows the hands."""
    bare = without_fingers(score, keep_hands=True)
    return [note.finger for note in apply_fingering(bare, fingering, change_hands=False).notes]


METHODS = {
    "optimal transport": transported,
    "ergonomic": lambda score: searched(score, "ergonomic"),
    "robot": lambda score: searched(score, "robot"),
}


def crossings() -> dict[str, Score]:
    """Return studies of ours in which one hand plays a broken triad and the other crosses over it.

    The crossing hand plays a low note and a high one in turn, the farther one with the index
    finger, as is usual.
    """
    studies = {}
    for root, crossing in itertools.product((60, 62, 65, 67), HANDS):
        still = "left" if crossing == "right" else "right"
        broken = {"right": (0, 2, 4, 2), "left": (9, 7, 5, 7)}[still]
        low, high = {"left": (9, 6), "right": (1, 4)}[crossing]
        rows: list[tuple[float, float, int, int]] = []
        for bar in range(8):
            for k, (finger, step) in enumerate(zip(broken, (0, 4, 7, 4), strict=True)):
                rows.append((bar + 0.25 * k, 0.23, root + step, finger))
            rows += [(bar, 0.4, root - 12, low), (bar + 0.5, 0.4, root + 16, high)]
        notes = [
            Note(onset=onset, offset=onset + duration, pitch=pitch, finger=finger)
            for onset, duration, pitch, finger in rows
        ]
        title = f"crossed-{pitch_name(root)}-{crossing}"
        studies[title] = Score(notes=notes, title=title)
    return studies


def write(name: str, folder: Path) -> None:
    """Write each method's fingers for a built-in piece: FOLDER/METHOD/PIECE.csv."""
    score = BUILT_IN[name].score()
    for method, find in METHODS.items():
        file = folder / method / f"{name}.csv"
        file.parent.mkdir(parents=True, exist_ok=True)
        with file.open("w", encoding="utf-8", newline="") as text:
            table = csv.writer(text, lineterminator="\n")
            table.writerow(["onset", "pitch", "finger"])
            for note, finger in zip(score.notes, find(score), strict=True):
                table.writerow([f"{note.onset:.4f}", pitch_name(note.pitch), finger])


def counts(score: Score, fingers: Sequence[int]) -> dict[str, tuple[int, int]]:
    """Return the labelled notes and those with another finger, by kind of passage."""
    found = dict.fromkeys((*KINDS, "all"), (0, 0))
    for note, kinds, finger in zip(score.notes, passages(score), fingers, strict=True):
        for kind in (*kinds, "all") if note.finger >= 0 else ():
            notes, others = found[kind]
            found[kind] = notes + 1, others + (finger != note.finger)
    return found


def cell(pieces: Iterable[tuple[int, int]]) -> str:
    """Return the share of notes with another finger, %, and its interval over pieces."""
    notes, others = np.array([piece for piece in pieces if piece[0] > 0]).reshape(-1, 2).T
    if len(notes) == 0:
        return ""
    share = f"{100 * others.sum() / notes.sum():.1f}"
    if len(notes) < 3:
        return share
    interval = bootstrap(
        (others, notes),
        lambda o, n, axis: o.sum(axis=axis) / n.sum(axis=axis),
        paired=True,
        vectorized=True,
        method="percentile",
        rng=0,
    ).confidence_interval
    return f"{share} [{100 * interval.low:.0f}, {100 * interval.high:.0f}]"


def table(scores: Mapping[str, Score]) -> Iterable[tuple[str, ...]]:
    """Yield the rows: kind, pieces, notes, the paper's figure, each method's share."""
    console = Console(stderr=True)
    found = [
        [counts(score, method(score)) for score in track(scores.values(), name, console=console)]
        for name, method in METHODS.items()
    ]
    for kind in (*KINDS, "all"):
        notes = [piece[kind][0] for piece in found[0]]
        cells = (cell(piece[kind] for piece in each) for each in found)
        pieces = sum(n > 0 for n in notes)
        yield kind, str(pieces), str(sum(notes)), PAPER.get(kind, ""), *cells


def main(argv: Sequence[str] | None = None) -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--files", nargs="+", type=Path, metavar="FILE", help="labelled scores")
    parser.add_argument(
        "--collections", nargs="+", default=["repertoire", "scale", "arpeggio"], metavar="NAME"
    )
    parser.add_argument("--write", type=Path, metavar="FOLDER", help="write tables of fingers")
    parser.add_argument("--pieces", nargs="+", default=[], metavar="NAME", help="built-in pieces")
    options = parser.parse_args(argv)
    warnings.simplefilter("ignore", PlanWarning)
    if options.write:
        for name in options.pieces:
            write(name, options.write)
        return
    if options.files:
        scores = {path.stem: read_score(path) for path in options.files}
    else:
        chosen = [n for n, piece in BUILT_IN.items() if piece.collection in options.collections]
        scores = {name: BUILT_IN[name].score() for name in chosen}
        scores |= crossings() if "crossed" in options.collections else {}
    heads = ("passage", "pieces", "notes", "paper, transport", *METHODS)
    print(f"| {' | '.join(heads)} |")
    print(f"| --- |{' ---: |' * (len(heads) - 1)}")
    for row in table(scores):
        print(f"| {' | '.join(row)} |", flush=True)


if __name__ == "__main__":
    main()
