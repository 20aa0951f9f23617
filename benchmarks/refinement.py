"""Refined plans beside predictive sampling: a table of docs/planned_pianist_results.md.

    python benchmarks/refinement.py --seconds 8 --passes 2
    python benchmarks/refinement.py --pieces ChopinNocturneOp9No2 MapleLeafRag --seconds 15
    python benchmarks/refinement.py --samples 0 --forearms forearm_tx forearm_ty forearm_yaw

The beginning of each piece of the repertoire is planned, refined by some passes, and played by
predictive sampling around the plan. Each cell has F1, onset F1 and seconds of one core as the
processor counts them: of a refinement those of all passes so far, of sampling those of playing. A
row is printed as soon as it is measured. ``--samples 0`` leaves sampling out; ``--forearms`` takes
the joints that forearms have.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Mapping, Sequence

from sb3_piano.arrays import FloatArray
from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import PlanWarning
from sb3_piano.music import BUILT_IN, load_score
from sb3_piano.planning import Refinement
from sb3_piano.players.planned import PlannedPianist
from sb3_piano.players.sampling import PredictiveSampling
from sb3_piano.training.playing.player import PLANNED_IN

REPERTOIRE = [name for name, piece in BUILT_IN.items() if piece.collection == "repertoire"]


def row(
    piece: str, seconds: float, passes: int, samples: int, forearms: Sequence[str] | None
) -> list[str]:
    """Return the cells of a piece."""
    score = load_score(piece).excerpt(0.0, seconds)
    env = PianoEnv(score, **PLANNED_IN, forearm_dofs=forearms and tuple(forearms))
    env.reset(seed=0)
    start = time.process_time()
    pianist = PlannedPianist(env)
    plan = pianist.plan()
    spent = time.process_time() - start
    cells = [cell(played(env, pianist), spent)]
    start = time.process_time()
    refinement = Refinement(plan, env.scene, pianist.settings, n_threads=1)
    for _ in range(passes):
        refinement.run(passes=1)
        spent = time.process_time() - start
        cells.append(cell(told(env, refinement.plan.commands), spent))
    if samples > 0:
        sampling = PredictiveSampling(env, samples=samples, n_threads=1)
        start = time.process_time()
        cells.append(cell(played(env, sampling), time.process_time() - start))
    return [piece.removeprefix("repertoire-"), *cells]


def told(env: PianoEnv, commands: FloatArray) -> Mapping[str, float]:
    """Return the metrics of commands that are told as they are."""
    env.reset(seed=0)
    info: Mapping[str, float] = {}
    for step, now in enumerate(commands):
        action = env.action_map.action(now, pedal_down=bool(env.roll.sustain[step]))
        *_, info = env.step(action)
    return info


def played(env: PianoEnv, player: PlannedPianist | PredictiveSampling) -> Mapping[str, float]:
    """Return the metrics of what a player plays."""
    observation, _ = env.reset(seed=0)
    info: Mapping[str, float] = {}
    for _ in range(len(env.roll)):
        observation, *_, info = env.step(player.predict(observation)[0])
    return info


def cell(info: Mapping[str, float], seconds: float) -> str:
    """Return metrics and seconds as a cell."""
    return f"**{info['f1']:.3f}** / {info['onset_f1']:.3f} / {seconds:.1f}"


def main(argv: Sequence[str] | None = None) -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pieces", nargs="+", default=REPERTOIRE)
    parser.add_argument("--seconds", type=float, default=15.0, help="of music from the beginning")
    parser.add_argument("--passes", type=int, default=2)
    parser.add_argument("--samples", type=int, default=32)
    parser.add_argument("--forearms", nargs="+", metavar="JOINT", help="their joints")
    options = parser.parse_args(argv)
    warnings.simplefilter("ignore", PlanWarning)
    passes = [f"{n + 1} pass{'es' if n else ''}" for n in range(options.passes)]
    heads = ["piece", "planned", *passes]
    heads += [f"sampling-{options.samples}"] if options.samples > 0 else []
    print(f"| {' | '.join(heads)} |")
    print("|" + " --- |" * len(heads))
    for piece in options.pieces:
        cells = row(piece, options.seconds, options.passes, options.samples, options.forearms)
        print(f"| {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
