"""From a MIDI file to a policy that was planned, cloned and trained, in a few minutes.

    python examples/demo.py                           # the first 15 s of Debussy's Rêverie
    python examples/demo.py my.mid --seconds 20 --out demo

The planner plays the piece with disturbances; a stock SAC actor imitates it; SAC then learns a
correction of that actor. All of it is on the reference physics; each is judged beside hands that
rest. A video and a report of the last one are in ``--out``, beside the runs.
"""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import Progress

from sb3_piano.demonstrations import record
from sb3_piano.exceptions import RunError, SB3PianoError
from sb3_piano.music import load_score, write_midi
from sb3_piano.players import PlayerSpec
from sb3_piano.training import (
    clone,
    evaluate,
    load_fine_tuning,
    play_run,
    train,
    write_report,
)
from sb3_piano.training.playing.player import stage_for
from sb3_piano.training.playing.recording import player_to_record

STEPS = 80_000
EPISODES = 24
EPOCHS = 60
NOISE = (0.0, 0.03, 0.06, 0.1)
DATASET = "robopianist/demo/planned-v0"


def main() -> int:
    """Run all steps and print a row for each."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    add = parser.add_argument
    add("piece", nargs="?", default="Reverie", metavar="NAME|FILE", help="default: Reverie")
    add("--seconds", type=float, default=15, metavar="S", help="how much of it; default: 15")
    add("--steps", type=int, default=STEPS, metavar="N", help=f"of SAC, or 0; default: {STEPS}")
    add("--seed", type=int, default=0, metavar="N", help="default: 0")
    add("--out", type=Path, default=Path("runs/demo"), metavar="DIR", help="default: runs/demo")
    arguments = parser.parse_args()
    try:
        for row in demo(
            arguments.piece, arguments.seconds, arguments.out, arguments.seed, arguments.steps
        ):
            print(row, flush=True)
    except KeyboardInterrupt:
        print(f"Interrupted: what was finished is in {arguments.out}.")
        return 130
    except SB3PianoError as error:
        parser.exit(2, f"{parser.prog}: error: {error}\n")
    return 0


def demo(piece: str, seconds: float, out: Path, seed: int, steps: int) -> Iterator[str]:
    """Yield the rows of the table, and at last where to look."""
    if (out / "cloned").exists():
        raise RunError(f"'{out}' has the runs of a demo already: expected another --out.")
    out.mkdir(parents=True, exist_ok=True)
    score = load_score(piece)
    midi = out / "piece.mid"
    write_midi(score.excerpt(0, min(seconds, score.duration)), midi)

    stage = stage_for(str(midi.absolute()), observation="hands")
    found = evaluate("planned", seed=seed, score=midi)
    yield "|         |    F1 | onset F1 |\n|---------|------:|---------:|"
    yield row("resting", found.baseline)
    yield row("planned", found.mean)

    planned = player_to_record(PlayerSpec.parse("planned"), stage)
    with planned as (player, env), bar("performances", EPISODES) as tell:
        record(
            player,
            env,
            DATASET,
            episodes=EPISODES,
            noise=NOISE,
            seed=seed,
            overwrite=True,
            on_episode=tell,
        )
    with bar("imitation", EPOCHS) as tell:
        cloned = clone(DATASET, folder=out / "cloned", seed=seed, epochs=EPOCHS, on_epoch=tell)
    yield row("cloned", evaluate(cloned.folder.path).mean)
    if steps == 0:
        return

    settings = load_fine_tuning("sac", player=cloned.folder.path, seed=seed, n_timesteps=steps)
    result = train(settings, out / "trained")
    if result.interrupted:
        raise KeyboardInterrupt
    trained = result.folder.path
    yield row("trained", evaluate(trained).mean)

    with bar("pictures") as tell:
        played = play_run(trained, progress=tell)
    yield f"Heard and seen: {played.folder}\nReport:         {write_report(trained)}"


def row(name: str, metrics: Mapping[str, float] | None) -> str:
    """Return a row of the table."""
    assert metrics is not None, "hands can rest on a piano"
    return f"| {name:7} | {metrics['f1']:.3f} | {metrics['onset_f1']:8.3f} |"


@contextlib.contextmanager
def bar(what: str, total: int | None = None) -> Iterator[Callable[..., None]]:
    """Show a progress bar, and give what moves it by one, or to what it is told."""
    with Progress(console=Console(stderr=True), transient=True) as shown:
        task = shown.add_task(what, total=total)

        def tell(*given: Any) -> None:
            if len(given) == 2:
                shown.update(task, completed=given[0], total=given[1])
            else:
                shown.advance(task)

        yield tell


if __name__ == "__main__":
    raise SystemExit(main())
