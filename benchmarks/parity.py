"""Does another physics play the piano as MuJoCo's own does? Single steps and whole episodes.

    python benchmarks/parity.py --backend cpu
    python benchmarks/parity.py --backend warp --device cuda --worlds 256

The first table has one control step from equal states, by the kinds of shapes that touch there. A
fault in one collision routine shows in its rows alone. The second table has episodes of equal
actions, which wander about the resting place so that hands collide. These are chaotic, so MuJoCo's
own spread is the measure: its worlds again, from positions that are 1e-7 away. docs/parity.md has
results.
"""

from __future__ import annotations

import argparse
import warnings
from collections import defaultdict
from typing import Any

import numpy as np
import torch

from sb3_piano.batch import BatchedPiano
from sb3_piano.batch.cpu_worlds import CpuWorlds

PIECE = "debug-CMajorScaleTwoHands"
NEAR = 1e-7
"""Standard deviation of the disturbed positions, rad or m."""


def main() -> None:
    """Measure and print both tables in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--backend", choices=["cpu", "warp"], default="warp")
    parser.add_argument("--device", choices=["cpu", "cuda"])
    parser.add_argument("--physics", nargs="+", default=["fast-capsules"])
    parser.add_argument("--worlds", type=int, default=32)
    parser.add_argument("--steps", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    warnings.simplefilter("once")
    for physics in arguments.physics:
        found = compare(physics, arguments)
        print(f"\n{physics}, {arguments.worlds} worlds, {arguments.steps} control steps\n")
        print(table(("contacts", "states", "joints, median", "90 %", "most", "keys"), found[0]))
        print()
        heads = ("episodes of", "equal keys", "joints, median", "90 %", "F1", "strikes", "return")
        print(table(heads, found[1]))


def compare(physics: str, arguments: argparse.Namespace) -> tuple[list[Any], list[Any]]:
    """Return the rows of both tables."""
    options = {"metrics": "sums", "physics": physics, "observation": "fingers"}
    other: dict[str, Any] = {"backend": arguments.backend, "device": arguments.device}
    own = [BatchedPiano(arguments.worlds, PIECE, **options) for _ in range(2)]
    theirs = BatchedPiano(arguments.worlds, PIECE, **other, **options)
    stage = BatchedPiano(arguments.worlds, PIECE, **other, **options)
    batches = {"MuJoCo": own[0], f"MuJoCo, {NEAR:g} beside": own[1], "the other": theirs}
    for batch in (*batches.values(), stage):
        batch.reset()
    random = np.random.default_rng(arguments.seed)
    beside = own[1].worlds
    noise = torch.from_numpy(random.normal(0, NEAR, beside.qpos.shape))
    beside.set_state(beside.qpos + noise, beside.qvel.clone())
    action = np.zeros((arguments.worlds, own[0].action_space.shape[0]))
    single: dict[str, list[Any]] = defaultdict(list)
    equal, apart = defaultdict(list), defaultdict(list)
    strikes = {name: torch.zeros(arguments.worlds) for name in batches}
    for _ in range(arguments.steps):
        action = np.clip(0.9 * action + 0.3 * random.normal(size=action.shape), -1, 1)
        told = torch.from_numpy(action.astype(np.float32))
        before = own[0].worlds
        stage.worlds.set_state(before.qpos.clone(), before.qvel.clone())
        for batch in (*batches.values(), stage):
            batch.step(told)
        keys, joints = state(own[0])
        add_single_steps(single, own[0], keys, joints, state(stage))
        for name, batch in batches.items():
            other_keys, other_joints = state(batch)
            strikes[name] += batch.heard.struck.sum(1).cpu()
            equal[name].append((other_keys == keys).all(1))
            apart[name].append((other_joints - joints).abs().flatten())
    rows = []
    for name, batch in batches.items():
        off = torch.cat(apart[name]).numpy()
        row = [name, f"{torch.cat(equal[name]).double().mean():.3f}"]
        row += [f"{np.quantile(off, share):.0e}" for share in (0.5, 0.9)]
        found = batch.summaries(range(arguments.worlds))
        of_worlds = (
            [each["f1"] for each in found],
            strikes[name].tolist(),
            batch.sums.earned.tolist(),
        )
        rows.append([*row, *(f"{np.mean(x):.3f} ± {deviation(x):.3f}" for x in of_worlds)])
    return [summary(name, single[name]) for name in sorted(single)], rows


def deviation(numbers: list[float]) -> float:
    """Return the standard error of a mean."""
    return float(np.std(numbers) / np.sqrt(len(numbers)))


def state(batch: BatchedPiano) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the sounding keys, (N, 88), and the positions of the hands' joints, (N, m)."""
    joints = torch.as_tensor(batch.piano.scene.hand_qpos, device=batch.device)
    positions = batch.worlds.qpos.index_select(1, joints)
    return batch.heard.sounding.cpu(), positions.double().cpu()


def add_single_steps(
    single: dict[str, list[Any]],
    own: BatchedPiano,
    keys: torch.Tensor,
    joints: torch.Tensor,
    theirs: tuple[torch.Tensor, torch.Tensor],
) -> None:
    """Add what each world's step was off by to the kinds of contacts that it ended with."""
    assert isinstance(own.worlds, CpuWorlds), "the reference is MuJoCo's own"
    off = (theirs[1] - joints).abs().amax(1).tolist()
    wrong = (theirs[0] != keys).any(1).tolist()
    for world, pair in enumerate(zip(off, wrong, strict=True)):
        kinds = {"-".join(kinds).lower() for kinds in own.worlds.contacts(world)}
        for kind in kinds or {"none"}:
            single[kind].append(pair)


def summary(kind: str, found: list[tuple[float, bool]]) -> list[str]:
    """Return a row of the first table; its last column counts steps with other keys."""
    off = np.array([each[0] for each in found])
    numbers = [np.median(off), np.quantile(off, 0.9), off.max()]
    different = sum(wrong for _, wrong in found)
    return [kind, f"{len(found)}", *(f"{number:.0e}" for number in numbers), f"{different} differ"]


def table(heads: tuple[str, ...], rows: list[list[str]]) -> str:
    """Return a table in Markdown."""
    lines = [list(heads), ["---", *["---:"] * (len(heads) - 1)], *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


if __name__ == "__main__":
    main()
