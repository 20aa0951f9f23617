"""How near the planned pianist's strikes come to the notes' velocities, flat and with dynamics.

    python benchmarks/dynamics.py --seconds 6 'repertoire-*' --out dynamics.csv
    python benchmarks/dynamics.py --seconds 6 asap/*/performance.mid --out dynamics.csv
    python benchmarks/dynamics.py --listen OdeToJoy --out docs/gallery --takes web/recordings

Each piece, or the beginning of it, is played twice: by ``planned`` and ``planned:dynamics=1``,
all joints, with fingers that suit the hands, on the reference physics. F1, onset F1, mean absolute
difference and Pearson's correlation of due and struck MIDI velocity over the notes hit in time, and
F1 of notes that are struck in time and as loud as due (``mir_eval.transcription_velocity``: due
velocities scaled to [0, 1], struck ones fitted to them by least squares, less than 0.1 apart).
``--listen`` writes ten seconds flat, with dynamics, and with dynamics and pedal as WAV files, a
picture of their levels, and the takes, which the page in the browser plays.
"""

from __future__ import annotations

import argparse
import csv
import re
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.io import wavfile
from scipy.signal import decimate

import sb3_piano
from sb3_piano.lab.web.performances import write_small
from sb3_piano.metrics import Onsets, match_onsets
from sb3_piano.music import Score, load_score, select_pieces
from sb3_piano.music.dynamics import velocity_of
from sb3_piano.music.synthesis import SAMPLE_RATE, synthesize
from sb3_piano.performance import Performance
from sb3_piano.take import Take

FloatArray = npt.NDArray[np.float64]

COLUMNS = ("piece", "passes", "f1", "onset_f1", "difference", "correlation", "velocity_f1", "cpu_s")
LISTEN_S, FACTOR, WINDOW_S = 10.0, 2, 0.1


def play(score: Score, *, passes: int, pedal: str = "score") -> Take:
    """Play a score in the environment of players of whole pieces."""
    player = f"planned:dynamics={passes}" if passes else "planned"
    return sb3_piano.play(score, player, pedal=pedal)


def velocities(played: Performance) -> tuple[FloatArray, FloatArray]:
    """Return due and struck velocities of the n notes hit in time."""
    roll = played.roll
    due = Onsets(roll.onset_time, np.nonzero(roll.onset)[1])
    pairs = np.asarray(match_onsets(due, Onsets(played.strike_time, played.presses.key)))
    speeds, keys = played.strike_speed[pairs[:, 1]], played.presses.key[pairs[:, 1]]
    struck = list(map(velocity_of, speeds.tolist(), keys.tolist()))
    return roll.onset_velocity[pairs[:, 0]].astype(float), np.array(struck, dtype=float)


def measure(score: Score, passes: int) -> dict[str, float | str]:
    """Play a score and return its numbers."""
    began = time.process_time()
    take = play(score, passes=passes)
    played = take.piano
    due, struck = velocities(played)
    everyone = played.roll.onset_velocity.astype(float)
    span = max(np.ptp(everyone), 1.0)
    scaled, ones = (due - everyone.min()) / span, np.ones(len(struck))
    fit, *_ = np.linalg.lstsq(np.stack([struck, ones], axis=1), scaled, rcond=None)
    hits = np.abs(np.stack([struck, ones], axis=1) @ fit - scaled) < 0.1
    constant = np.ptp(due) == 0 or np.ptp(struck) == 0
    return {
        "f1": take.f1,
        "onset_f1": take.onset_f1,
        "difference": float(np.abs(struck - due).mean()),
        "correlation": np.nan if constant else float(np.corrcoef(due, struck)[0, 1]),
        "velocity_f1": 2 * int(hits.sum()) / (len(everyone) + len(played.strike_time)),
        "cpu_s": time.process_time() - began,
    }


def listen(name: str, folder: Path, takes: Path | None) -> None:
    """Write the sounds of three performances, a picture of their levels, and the takes."""
    import matplotlib.pyplot as plt

    score = load_score(name).trim_silence().excerpt(0.0, LISTEN_S)
    stem = re.sub(r"(?<=[a-z])(?=[A-Z])|\W+", "_", Path(name).stem).lower()
    versions = {"flat": (0, "score"), "dynamics": (1, "score"), "pedal": (1, "auto")}
    _, (left, right) = plt.subplots(1, 2, figsize=(10, 3.4), layout="constrained")
    for colour, (version, (passes, pedal)) in enumerate(versions.items()):
        take = play(score, passes=passes, pedal=pedal)
        if takes is not None:
            write_small(take, takes / f"{stem}_{version}.npz")
        sound = synthesize(take.score).astype(float).mean(axis=1)
        heard = np.clip(decimate(sound, FACTOR), -1.0, 1.0)
        file = folder / f"{stem}_{version}.wav"
        wavfile.write(file, SAMPLE_RATE // FACTOR, np.round(32767 * heard).astype(np.int16))
        steps = len(sound) // round(WINDOW_S * SAMPLE_RATE)
        parts = np.array_split(sound[: steps * round(WINDOW_S * SAMPLE_RATE)], steps)
        level = [20 * np.log10(max(np.sqrt(np.mean(part**2)), 1e-5)) for part in parts]
        right.plot(np.arange(steps) * WINDOW_S, level, label=version, color=f"C{colour}")
        due, struck = velocities(take.piano)
        if version != "pedal":
            left.scatter(due + 0.6 * colour, struck, s=8, alpha=0.5, color=f"C{colour}")
        peak, r = np.abs(sound).max(), np.corrcoef(due, struck)[0, 1]
        print(f"{file}: F1 {take.f1:.3f}, correlation {r:.2f}, peak {peak:.2f}", flush=True)
    left.plot([40, 100], [40, 100], color="0.6", linewidth=1)
    left.set(xlabel="velocity due", ylabel="velocity struck")
    right.set(xlabel="time, s", ylabel="level, dB", ylim=(-60, 0))
    right.legend(frameon=False)
    plt.savefig(folder / f"{stem}_levels.png", dpi=110)


def main(arguments: Sequence[str] | None = None) -> None:
    """Parse arguments, measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("pieces", nargs="*", help="names of pieces, or MIDI files")
    parser.add_argument("--seconds", type=float, default=float("inf"))
    parser.add_argument("--passes", type=int, nargs="+", default=(0, 1), help="for dynamics")
    parser.add_argument("--listen", metavar="PIECE")
    parser.add_argument("--takes", type=Path, help="folder for the takes of --listen")
    parser.add_argument("--out", type=Path, required=True, help="CSV file; folder for --listen")
    given = parser.parse_args(arguments)
    if given.listen:
        listen(given.listen, given.out, given.takes)
        return
    with given.out.open("a", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        for piece in select_pieces(given.pieces):
            score = load_score(piece).trim_silence().excerpt(0.0, given.seconds)
            for passes in given.passes:
                row = {"piece": piece, "passes": passes, **measure(score, passes)}
                writer.writerow(row)
                file.flush()
                print(row, flush=True)


if __name__ == "__main__":
    main()
