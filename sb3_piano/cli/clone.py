"""``sb3-piano clone``: make a run whose model imitates a data set."""

from __future__ import annotations

import argparse
import shlex
from typing import Any

from sb3_piano.cli.common import EXIT_OK, TRUST, add_shared, progress_bar, whole_number
from sb3_piano.cli.evaluate import evaluate_run
from sb3_piano.cli.record import with_minari


def add_parser(commands: Any) -> None:
    """Add the command and its arguments."""
    clone = commands.add_parser(
        "clone", help="make a run whose model imitates a data set", epilog=TRUST
    )
    add = clone.add_argument
    add("dataset", metavar="DATASET", help="name of a data set, such as 'sb3-piano record' writes")
    add("--algo", default="sac", metavar="NAME", help="sac (default), td3, tqc or ddpg")
    add_shared(add, "--config")
    add("--epochs", type=whole_number, default=60, metavar="N", help="default: 60")
    add("--batch-size", type=whole_number, default=256, metavar="N", help="default: 256")
    add("--learning-rate", type=float, default=1e-3, metavar="X", help="at first; default: 0.001")
    add(
        "--hidden",
        type=whole_number,
        nargs="+",
        default=[512, 512],
        metavar="N",
        help="sizes of the hidden layers; default: 512 512",
    )
    add("--no-normalize", action="store_true", help="give the observations as they are")
    add(
        "--prefill",
        action="store_true",
        help="let training on begin with the data set in the replay buffer",
    )
    add("--seed", type=int, metavar="N", help="default: drawn, and noted in the run's folder")
    add_shared(add, "--runs-dir", default="runs")
    add_shared(add, "--run")
    add_shared(add, "--no-progress")
    add("--evaluate", action="store_true", help="evaluate the model afterwards")
    clone.set_defaults(command=_clone)


def _clone(arguments: argparse.Namespace) -> int:
    with_minari()
    from rich.progress import TextColumn

    from sb3_piano.training import clone

    told = TextColumn("loss {task.fields[loss]:.2g}")
    with progress_bar(arguments, "epochs", [told]) as tell:
        tell(total=arguments.epochs, loss=float("nan"))
        result = clone(
            arguments.dataset,
            arguments.algo,
            arguments.run,
            runs_dir=arguments.runs_dir,
            config=arguments.config,
            net_arch=arguments.hidden,
            normalize=not arguments.no_normalize,
            prefill=arguments.prefill,
            seed=arguments.seed,
            epochs=arguments.epochs,
            batch_size=arguments.batch_size,
            learning_rate=arguments.learning_rate,
            on_epoch=lambda loss: tell(advance=1, loss=loss),
        )
    path, cloning = shlex.quote(str(result.folder.path)), result.cloning
    print(f"Cloned {cloning.n_transitions} transitions, to a loss of {cloning.losses[-1]:.2g}.")
    print(f"Run:         {result.folder.path}")
    print(f"Model:       {result.folder.model_file}")
    print(f"Evaluate:    sb3-piano evaluate {path}")
    print(f"Train on:    sb3-piano train --resume {path}")
    if arguments.evaluate:
        evaluate_run(str(result.folder.path))
    return EXIT_OK
