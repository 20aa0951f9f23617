"""Hyperparameters for the piano environments, one YAML file per algorithm in RL Zoo's form."""

from __future__ import annotations

import re
from pathlib import Path

_HERE = Path(__file__).parent

DEFAULT_ALGORITHM = "sac"
"""What all commands train where no algorithm is named: what learns notes best here."""

PRESETS = {path.stem: path for path in sorted(_HERE.glob("*.yml"))}
"""The files by the name of their algorithm."""

NAMED = {
    "fast": dict.fromkeys(("sac", "td3", "tqc"), _HERE / "fast" / "hands.yml"),
    **{
        name: {path.stem: path for path in sorted(_HERE.glob(f"{name}/*.yml"))}
        for name in ("batched", "robopianist", "robovirtuoso", "sac_vs_td3")
    },
}
"""Files of the same kind by the name of a set, then of the algorithm: "fast" (one file for all) and
"batched" are settings of our own for learning from nothing, the others those of one publication
each."""

SIGHT_READER = _HERE / "sight_reader" / "ppo.yml"
"""PPO on many pieces, from a distilled network of a hand."""

FINE_TUNING = {path.stem: path for path in sorted(_HERE.glob("fine_tuning/*.yml"))}
"""Files for corrections of the sight-reader on one piece, likewise. RL Zoo does not know all their
keys."""


def purpose(file: Path) -> str:
    """Return what a file is for: the first sentence of the comment at its head."""
    head = file.read_text(encoding="utf-8").partition("\n\n")[0]
    text = " ".join(line.lstrip("# ") for line in head.splitlines() if line.startswith("#"))
    return re.split(r"[.:](?: |$)", text)[0]
