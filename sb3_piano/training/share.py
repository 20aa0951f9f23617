"""Runs for others to play: a folder without pickles, so that loading it runs no code of it."""

from __future__ import annotations

import os
import shutil

from sb3_piano.exceptions import RunError
from sb3_piano.files import write_bytes
from sb3_piano.planning import PianoPolicy
from sb3_piano.training.playing import SavedPlayer
from sb3_piano.training.run_folder import RunFolder
from sb3_piano.training.weights import WEIGHTS_FILE, pack_weights


def share(
    run: str | os.PathLike[str], folder: str | os.PathLike[str], *, best: str | None = None
) -> RunFolder:
    """Write what playing a run needs: its settings, origin, score and weights, in plain files.

    The new folder is evaluated, played and reported on like the run, with the same result to the
    last bit; it cannot be trained on.

    Args:
        run: The run's folder.
        folder: Where to, a new or empty folder.
        best: Share the best model by this metric, such as "f1", in place of the last one.

    Raises:
        ConfigError: If the run's config is damaged.
        RunError: If there is no run, it has no model that can be loaded, or the folder cannot be
            used.
    """
    with SavedPlayer.open(run, best=best) as player:
        model = player.model
        config = player.run.read_config()
        # What plays without training has no weights.
        packed = None if isinstance(model, PianoPolicy) else pack_weights(model, config)
        shared = RunFolder.create(config, folder)
        try:
            if player.run.provenance_file.is_file():
                shutil.copyfile(player.run.provenance_file, shared.provenance_file)
            if packed is not None:
                write_bytes(shared.path / WEIGHTS_FILE, packed)
        except OSError as error:
            shutil.rmtree(shared.path, ignore_errors=True)
            raise RunError(
                f"Folder '{shared.path}' cannot be written: {error.strerror or error}. Expected a "
                "place in which files can be made."
            ) from error
        return shared
