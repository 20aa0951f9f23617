"""F1 on unseen pieces by the number of excerpts that a network learnt from: a table and a plot.

    python benchmarks/sight_reader_scaling.py --out scaling
    python benchmarks/sight_reader_scaling.py --out scaling --excerpts 12 150 --seed 1

Imitation alone, the first round of ``sb3-piano distill``: the planner plays so many excerpts of
12 s, a network is trained with the same number of updates for each of them, and plays the eight
pieces of ``distill.yml`` alone (first 30 s, reference physics), none of which is in the corpus.
Each distillation has its folder in ``--out``: stop it and call it again to go on. The plot is
``scaling.png`` there.

Beside it are OmniPianist's figures on 100 unseen pieces (arXiv 2511.02504), by number of songs; its
pieces, fingers and observations are others, so that only the shapes compare.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
from rich.console import Console

from sb3_piano.lab.distillation import DEFAULT_FILE, DistillConfig, distill
from sb3_piano.lab.distillation.rounds import RoundResult

PUBLISHED = {12: 0.09, 300: 0.40, 900: 0.55}
"""F1 by number of songs."""

_EPOCHS_AND_EXCERPTS = 5400  # as distill.yml has: 18 epochs of 300 excerpts


def measure(folder: Path, excerpts: int, seed: int) -> RoundResult:
    """Return the result of imitating so many excerpts."""
    console = Console(stderr=True)
    config = DistillConfig.from_yaml(
        DEFAULT_FILE,
        **{
            "seed": seed,
            "corpus.seed": seed,
            "evaluation.excerpts": 0,
            "improvements": [],
            "rounds": [{"excerpts": excerpts, "epochs": round(_EPOCHS_AND_EXCERPTS / excerpts)}],
        },
    )
    with console.status("") as status:

        def tell(text: str, done: int, total: int) -> None:
            status.update(f"{excerpts} excerpts: {text} {done}/{total}")

        result = distill(config, folder / f"{excerpts}-{seed}", on_progress=tell)
    if result.interrupted:
        raise KeyboardInterrupt
    return result.rounds[0]


def draw(results: Sequence[tuple[int, RoundResult]], file: Path) -> None:
    """Plot F1 and onset F1 by the number of excerpts."""
    counts = [count for count, _ in results]
    figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
    axes.plot(counts, [result.f1 for _, result in results], "o-", label="F1")
    axes.plot(counts, [result.onset_f1 for _, result in results], "s-", label="onset F1")
    axes.plot(
        list(PUBLISHED), list(PUBLISHED.values()), "^--", color="grey", label="OmniPianist, F1"
    )
    axes.set(
        xscale="log", xlabel="excerpts (OmniPianist: songs)", ylabel="unseen pieces", ylim=(0, 1)
    )
    axes.set_xticks(counts, map(str, counts))
    axes.minorticks_off()
    axes.grid(alpha=0.3)
    axes.legend()
    figure.savefig(file, dpi=150)


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="folder of the distillations")
    parser.add_argument("--excerpts", type=int, nargs="+", default=[12, 150, 300, 900])
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args(arguments)
    results = []
    print("| excerpts | control steps | F1 | onset F1 | OmniPianist, F1 |")
    print("|---:|---:|---:|---:|---:|")
    for excerpts in given.excerpts:
        result = measure(given.out, excerpts, given.seed)
        results.append((excerpts, result))
        published = f"{PUBLISHED[excerpts]:.2f}" if excerpts in PUBLISHED else ""
        scores = f"{result.f1:.3f} | {result.onset_f1:.3f} | {published}"
        print(f"| {excerpts} | {result.transitions:,} | {scores} |", flush=True)
    draw(results, given.out / "scaling.png")


if __name__ == "__main__":
    main()
