"""Files of a player: find those it depends on, and export a run."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.files import read_file, write_bytes
from sb3_piano.jobs.folders import unwritable
from sb3_piano.players import HandModel, PlayerSpec
from sb3_piano.players.hand_model import network_file
from sb3_piano.training.configuration.config import RunConfig
from sb3_piano.training.configuration.env_spec import BASE
from sb3_piano.training.playing.player import OpenPlayer
from sb3_piano.training.runs.folder import RunFolder
from sb3_piano.training.runs.saved import (
    model_files,
    pack_weights,
)


def player_files(spec: PlayerSpec) -> list[Path]:
    """Return the files that a player depends on, including those of a corrected run.

    Raises:
        RunError: If there is no such run, or it has no model.
    """
    run = RunFolder.open(spec.name) if spec.is_run else None
    former = None if run is None else run.read_player()
    if run is None or former is not None:
        file = spec.file if former is None else former[0].file
        own = [] if run is None else [run.config_file]
        return [*own, *([] if file is None else [network_file(file)])]
    config = run.read_config()
    files = [run.config_file, *filter(None, model_files(run, config))]
    for option, text in config.env.files.items():
        named = PlayerSpec(name=text) if option == BASE else None
        files += [network_file(text)] if named is None else player_files(named)
    return files


def _hand_model(player: OpenPlayer) -> HandModel | None:
    """Return the network of a hand; ``None`` if the run has none."""
    try:
        return HandModel.of(player.model.policy, player.wrapped, player.num_timesteps)
    except ConfigError:  # another policy, other actions, or another observation
        return None


def keep_base(run: RunFolder, config: RunConfig) -> None:
    """Copy the corrected run, if any, into the folder of the new run."""
    if config.env.base is not None:
        write_player(config.env.base, run.base_dir)
        kept = run.read_config()
        run.write_config(kept.with_env(kept.env.with_base(str(run.base_dir))))


def write_player(
    run: str | os.PathLike[str], folder: str | os.PathLike[str], *, best: str | None = None
) -> RunFolder:
    """Export the files that play a run: settings, origin, score and weights, without pickles.

    One network for both hands (a policy for hands with
    :class:`~sb3_piano.wrappers.HandActions`) is written, too: ``hand.safetensors`` plays any piece
    as a :class:`~sb3_piano.players.SightReader`. Arguments and errors are as for
    :func:`~sb3_piano.training.export_run`, which adds a model card and a video.
    """
    with player_written(run, folder, best) as written:
        return written


@contextlib.contextmanager
def player_written(
    run: str | os.PathLike[str], folder: str | os.PathLike[str], best: str | None
) -> Iterator[RunFolder]:
    """Yield the unfinished folder of :func:`write_player`; the block completes it."""
    with contextlib.ExitStack() as made:
        with OpenPlayer.open(os.fspath(run), best=best) as player:
            if player.run is None:
                raise RunError(
                    f"{player.named} was not trained, and needs no export: expected a trained run."
                )
            config = player.run.read_config()
            written = made.enter_context(RunFolder.making(config, folder))
            try:
                keep_base(written, config)
                written.keep_pieces()
                if player.run.provenance_file.is_file():
                    write_bytes(written.provenance_file, read_file(player.run.provenance_file))
                write_bytes(written.weights_file, pack_weights(player.model, config))
                hand = _hand_model(player)
                if hand is not None:
                    hand.save(written.hand_file)
            except OSError as error:
                raise unwritable(written.path, error) from error
        yield written
