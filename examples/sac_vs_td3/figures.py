"""Draw the paper's figures 3 to 8, returns over steps, from the runs' files.

    python examples/sac_vs_td3/figures.py --out figures

The runs are those of ``run.py`` and of results.json; each line is a run, in the colour of its cell.
Returns are of the training's episodes, with exploration, by control step, so that pieces at any
tempo compare. Cells that were not run are left out, and so is a figure without any.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
from cells import RUNS, Cell, find_cells
from results import KEPT, Result, results_of

SHIFTS = ["", "_shift_2", "_shift_3", "_shift_5", "_shift_7"]
STRETCHES = ["_stretch_05", "", "_stretch_2"]
TWO_PIECES = ["c_major", "nocturne"]

FIGURES = {
    "figure_3": [
        [f"{algo}/{piece}" for algo in ("sac", "td3")] for piece in [*TWO_PIECES, "d_major"]
    ],
    "figure_4": [[f"sac/{piece}{shift}" for shift in SHIFTS] for piece in TWO_PIECES],
    "figure_5": [[f"td3/{piece}{shift}" for shift in SHIFTS] for piece in TWO_PIECES],
    "figure_6": [[f"sac/{piece}{stretch}" for stretch in STRETCHES] for piece in TWO_PIECES],
    "figure_7": [[f"td3/{piece}{stretch}" for stretch in STRETCHES] for piece in TWO_PIECES],
    "figure_8": [["td3/d_major", "td3/d_major_36_keys", "td3/d_major_piece_keys"]],
}
"""Names of the cells in each panel of each figure."""


def main() -> None:
    """Draw what there is."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    add = parser.add_argument
    add("--runs", type=Path, default=RUNS, metavar="DIR", help=f"default: {RUNS}")
    add("--kept", type=Path, default=KEPT, metavar="FILE", help="default: results.json beside this")
    add("--out", type=Path, default=Path("figures"), metavar="DIR", help="default: figures")
    arguments = parser.parse_args()
    cells = {cell.name: cell for cell in find_cells()}
    arguments.out.mkdir(parents=True, exist_ok=True)
    for name, panels in FIGURES.items():
        file = arguments.out / f"{name}.png"
        found = [[(cell, curves(cells[cell], arguments)) for cell in panel] for panel in panels]
        drawn = draw(found, file)
        print(file if drawn else f"{name}: none of its cells was run")


def curves(cell: Cell, arguments: argparse.Namespace) -> list[Result]:
    """Return the runs of a cell whose curves are there."""
    found = results_of(cell, arguments.runs, arguments.kept).values()
    return [result for result in found if result.steps]


def draw(panels: list[list[tuple[str, list[Result]]]], file: Path) -> bool:
    """Draw a figure of several panels of cells; return whether there was anything to draw."""
    if not any(of_cell for panel in panels for _, of_cell in panel):
        return False
    size = (1 + 4 * len(panels), 3.6)
    figure, axes = plt.subplots(1, len(panels), figsize=size, squeeze=False, layout="constrained")
    for axis, panel in zip(axes[0], panels, strict=True):
        for color, (cell, of_cell) in enumerate(panel):
            for number, run in enumerate(of_cell):
                label = None if number else cell
                axis.plot(run.steps, run.returns, color=f"C{color}", alpha=0.8, label=label)
        axis.set(xlabel="environment steps", ylabel="return by control step")
        axis.grid(alpha=0.3)
        if axis.lines:
            axis.legend(fontsize=8)
    figure.savefig(file, dpi=120)
    plt.close(figure)
    return True


if __name__ == "__main__":
    main()
