"""Print how well the runs of choice.yml play the pieces that none of them was trained on.

    python examples/curriculum/choice.py examples/curriculum/kept/choice/*.json

The files are those of ``sb3-piano evaluate --json`` in the head of choice.yml, one of each way to
choose. Numbers are means [least, greatest] over the training seeds, each of all pieces, and of each
kind of pieces onset F1 and F1.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from statistics import fmean

from seeds import over_seeds

from sb3_piano.training.evaluation.comparison import SavedEpisodes, read_episodes

COLUMNS = {"onset_f1": "onset F1", "f1": "F1", "effective_fingers": "fingers"}
KINDS = {"scale": "scales", "arpeggio": "arpeggios", "hanon": "Hanon", "repertoire": "repertoire"}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE")
    found = {file.stem: read_episodes(file) for file in parser.parse_args().files}
    print(f"| choice | {' | '.join((*COLUMNS.values(), *KINDS.values()))} |")
    print("|" + " --- |" * (1 + len(COLUMNS) + len(KINDS)))
    for name, evaluations in found.items():
        seeds = sorted({str(one.training_seed) for one in evaluations})
        of_seeds = [[one for one in evaluations if str(one.training_seed) == s] for s in seeds]
        columns = [over_seeds([mean(own, metric) for own in of_seeds]) for metric in COLUMNS]
        for kind in KINDS:
            own = [one for one in evaluations if one.piece.startswith(f"{kind}-")]
            columns.append(f"{mean(own, 'onset_f1'):.3f} / {mean(own, 'f1'):.3f}")
        print(f"| {name.replace('_', ' ')} | {' | '.join(columns)} |")


def mean(evaluations: Sequence[SavedEpisodes], metric: str) -> float:
    """Return the mean of a metric over pieces, each one the mean of its episodes."""
    return fmean(fmean(found[metric] for found in one.episodes) for one in evaluations)


if __name__ == "__main__":
    main()
