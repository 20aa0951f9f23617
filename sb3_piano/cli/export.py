"""``sb3-piano export RUN``: export a run without pickles."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Callable
from typing import Any

from sb3_piano.cli.common import (
    EXIT_OK,
    print_errors,
    progress_bar,
    whole_number,
)

RUN_OPTIONS = ("best", "episodes", "no_video", "push_to_hub")
"""Options for runs only."""


def add_run_arguments(add: Callable[..., Any]) -> None:
    """Add the options of a run's export."""
    add("--best", text="of a run: use the best model by f1 or onset_f1 instead of the last")
    add("--episodes", "N", "of a run: episodes for the model card; default: 5", whole_number)
    add("--no-video", text="of a run: without replay.mp4")
    add("--push-to-hub", "REPO", "also publish the folder as OWNER/NAME on the Hugging Face Hub")


def export_run_folder(arguments: argparse.Namespace) -> int:
    """Export the run ``arguments.what``."""
    from sb3_piano.training import RunFolder, export_run
    from sb3_piano.training.evaluation.evaluate import pieces_of
    from sb3_piano.training.sharing.hub import push_to_hub
    from sb3_piano.viewing.views import DEFAULT_PICTURE

    count = arguments.episodes or 5
    with progress_bar(arguments, "Episodes") as tell:
        tell(total=count * len(pieces_of(RunFolder.open(arguments.what))))
        exported = export_run(
            arguments.what,
            arguments.folder,
            best=arguments.best,
            episodes=count,
            picture=None if arguments.no_video else DEFAULT_PICTURE,
            on_episode=lambda: tell(advance=1),
            progress=lambda done, total: tell(description="Video", completed=done, total=total),
        )
    print(f"Exported: {exported.path}")
    print("          without pickles; run.yml and README.md describe the training")
    print(f"Evaluate: sb3-piano evaluate {shlex.quote(str(exported.path))}")
    if arguments.push_to_hub is not None:
        print(f"Hub:      {push_to_hub(exported, arguments.push_to_hub)}")
    if not arguments.no_video and not exported.video_file.is_file():
        return print_errors("There is no video: no piano environment, or no renderer here.")
    return EXIT_OK
