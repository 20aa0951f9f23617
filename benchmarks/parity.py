"""Does another physics play the piano as MuJoCo's own does? Single steps and whole episodes.

    python benchmarks/parity.py --backend cpu
    python benchmarks/parity.py --backend warp --device cuda --worlds 256
    python benchmarks/parity.py --backend cpu --write steps.npz     # with one MuJoCo
    python benchmarks/parity.py --backend cpu --read steps.npz      # with another

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
    parser.add_argument("--write", help="also write MuJoCo's steps to this file (.npz)")
    parser.add_argument("--read", help="compare with the steps in this file, of another MuJoCo")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    warnings.simplefilter("once")
    for physics in arguments.physics:
        print(f"\n{physics}, {arguments.worlds} worlds, {arguments.steps} control steps\n")
        if arguments.read is not None:
            with np.load(arguments.read) as steps:
                single = single_steps(dict(steps), physics, arguments)
        else:
            steps, episodes = compare(physics, arguments)
            single = single_steps(steps, physics, arguments)
            if arguments.write is not None:
                np.savez_compressed(arguments.write, **steps)
        print(table(("contacts", "states", "joints, median", "90 %", "most", "keys"), single))
        if arguments.read is None:
            heads = ("episodes of", "equal keys", "joints, median", "90 %", "F1", "strikes")
            print(f"\n{table((*heads, 'return'), episodes)}")


def made(physics: str, arguments: argparse.Namespace, **backend: Any) -> BatchedPiano:
    """Return pianos at the start of their episodes."""
    options: dict[str, Any] = {"metrics": "sums", "physics": physics, "observation": "fingers"}
    batch = BatchedPiano(arguments.worlds, PIECE, **backend, **options)
    batch.reset()
    return batch


def compare(physics: str, arguments: argparse.Namespace) -> tuple[dict[str, Any], list[Any]]:
    """Return the steps of MuJoCo's own worlds, and the rows of the second table."""
    own, beside = made(physics, arguments), made(physics, arguments)
    other = made(physics, arguments, backend=arguments.backend, device=arguments.device)
    batches = {"MuJoCo": own, f"MuJoCo, {NEAR:g} beside": beside, "the other": other}
    random = np.random.default_rng(arguments.seed)
    noise = torch.from_numpy(random.normal(0, NEAR, beside.worlds.qpos.shape))
    beside.worlds.set_state(beside.worlds.qpos + noise, beside.worlds.qvel.clone())
    action = np.zeros((arguments.worlds, own.action_space.shape[0]))
    steps, equal, apart = (defaultdict(list) for _ in range(3))
    strikes = {name: torch.zeros(arguments.worlds) for name in batches}
    for _ in range(arguments.steps):
        action = np.clip(0.9 * action + 0.3 * random.normal(size=action.shape), -1, 1)
        for name in ("qpos", "qvel"):
            steps[name].append(getattr(own.worlds, name).numpy().copy())
        steps["action"].append(action.astype(np.float32))
        for batch in batches.values():
            batch.step(torch.from_numpy(steps["action"][-1]))
        keys, joints = state(own)
        steps["keys"].append(keys.numpy())
        steps["joints"].append(joints.numpy())
        steps["kinds"].append([kinds(own, world) for world in range(arguments.worlds)])
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
        f1 = [each["f1"] for each in batch.summaries(range(arguments.worlds))]
        of_worlds = (f1, strikes[name].tolist(), batch.sums.earned.tolist())
        rows.append([*row, *(f"{np.mean(x):.3f} ± {deviation(x):.3f}" for x in of_worlds)])
    return {name: np.array(values) for name, values in steps.items()}, rows


def single_steps(
    steps: dict[str, Any], physics: str, arguments: argparse.Namespace
) -> list[list[str]]:
    """Return the rows of the first table: each step again, from the state before it."""
    stage = made(physics, arguments, backend=arguments.backend, device=arguments.device)
    found: dict[str, list[Any]] = defaultdict(list)
    for number, action in enumerate(steps["action"]):
        before = (torch.from_numpy(steps[name][number]) for name in ("qpos", "qvel"))
        stage.worlds.set_state(*(one.to(stage.worlds.qpos) for one in before))
        stage.step(torch.from_numpy(action))
        keys, joints = (tensor.numpy() for tensor in state(stage))
        off = np.abs(joints - steps["joints"][number]).max(axis=1)
        wrong = (keys != steps["keys"][number]).any(axis=1)
        for world, kinds in enumerate(steps["kinds"][number]):
            for kind in str(kinds).split():
                found[kind].append((off[world], wrong[world]))
    return [summary(kind, found[kind]) for kind in sorted(found)]


def kinds(batch: BatchedPiano, world: int) -> str:
    """Return the kinds of shapes that touch in a world, separated by spaces."""
    assert isinstance(batch.worlds, CpuWorlds), "the reference is MuJoCo's own"
    found = {"-".join(pair).lower() for pair in batch.worlds.contacts(world)}
    return " ".join(sorted(found or {"none"}))


def deviation(numbers: list[float]) -> float:
    """Return the standard error of a mean."""
    return float(np.std(numbers) / np.sqrt(len(numbers)))


def state(batch: BatchedPiano) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the sounding keys, (N, 88), and the positions of the hands' joints, (N, m)."""
    joints = torch.as_tensor(batch.piano.scene.hand_qpos, device=batch.device)
    positions = batch.worlds.qpos.index_select(1, joints)
    return batch.heard.sounding.cpu(), positions.double().cpu()


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
