"""F1 of a player on pieces whose physics, latency or observations differ from the training's.

    python benchmarks/robustness.py sight-reader --pieces debug-CMajorScaleTwoHands

Each row changes one thing, by the wrapper DomainRandomization; numbers are means over pieces and
seeds.
"""

from __future__ import annotations

import argparse
import dataclasses
from typing import Any

import numpy as np

from sb3_piano.training import evaluate
from sb3_piano.training.playing.player import stage_for

CONDITIONS: dict[str, dict[str, Any]] = {
    "unchanged": {},
    "mass, factors 0.5 to 2": {"mass": [0.5, 2.0]},
    "friction, factors 0.3 to 3": {"friction": [0.3, 3.0]},
    "key springs, factors 0.5 to 2": {"key_spring": [0.5, 2.0]},
    "key thresholds, factors 0.8 to 1": {"key_threshold": [0.8, 1.0]},
    "actuator gains, factors 0.8 to 1.25": {"actuator_gain": [0.8, 1.25]},
    "latency, 1 control step": {"latency": [1, 1]},
    "noise of joint positions, 0.02": {"observation_noise": 0.02},
    "keyboard displaced by up to 2 mm": {"keyboard_offset": 0.002},
    "keyboard displaced by up to 5 mm": {"keyboard_offset": 0.005},
}


def main() -> None:
    """Play and print a table in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("player")
    parser.add_argument("--pieces", nargs="+", required=True)
    parser.add_argument("--seeds", nargs="+", type=int, default=[0])
    parser.add_argument("--physics", default="reference")
    arguments = parser.parse_args()
    print("| condition | F1 | onset F1 |\n|---|---:|---:|")
    for name, conditions in CONDITIONS.items():
        wrappers: Any = [{"sb3_piano.wrappers.DomainRandomization": conditions}]
        found = []
        for piece in arguments.pieces:
            env = dataclasses.replace(stage_for(piece), wrappers=wrappers)
            options = {"seed": arguments.seeds, "physics": arguments.physics}
            found.append(evaluate(arguments.player, env=env, score=piece, **options).summary)
        f1, onset_f1 = (np.mean([each[n].mean for each in found]) for n in ("f1", "onset_f1"))
        print(f"| {name} | {f1:.3f} | {onset_f1:.3f} |", flush=True)


if __name__ == "__main__":
    main()
