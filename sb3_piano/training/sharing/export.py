"""Export a run with weights, model card and video to a folder without pickles."""

from __future__ import annotations

import os
from collections.abc import Callable

from sb3_piano.envs import PianoEnv
from sb3_piano.files import FileIn, write_text
from sb3_piano.take import Progress, write_take
from sb3_piano.training.evaluation.evaluate import evaluate
from sb3_piano.training.playing.player import OpenPlayer
from sb3_piano.training.playing.player_files import player_written
from sb3_piano.training.playing.takes import take_of
from sb3_piano.training.runs.folder import RunFolder
from sb3_piano.training.sharing.card import card_of
from sb3_piano.viewing import Picture
from sb3_piano.viewing.views import DEFAULT_PICTURE

REPLAY = "replay"
"""Name of the video and of its MIDI file, without suffixes; the Hub shows ``replay.mp4``."""


class ExportedFolder(RunFolder):
    """The folder of an exported run."""

    card_file = FileIn("README.md")
    video_file = FileIn(f"{REPLAY}.mp4")


def export_run(
    run: str | os.PathLike[str],
    folder: str | os.PathLike[str],
    *,
    best: str | None = None,
    episodes: int = 5,
    picture: Picture | None = DEFAULT_PICTURE,
    on_episode: Callable[[], object] = lambda: None,
    progress: Progress | None = None,
) -> ExportedFolder:
    """Export a run without pickles: settings, weights, a model card and a video.

    The settings of the new folder name only classes of ``KNOWN_PACKAGES``, so that loading it runs
    no code of the folder. Commands such as evaluate, play and report accept it like the run, with
    bit-identical results; it cannot be trained further. An error or Ctrl-C leaves no folder. After
    a kill the same call makes it anew.

    Args:
        run: The run's folder.
        folder: Output folder, new or empty.
        best: Export the best model by this metric, such as "f1", instead of the last.
        episodes: Number of evaluation episodes for the card, with seeds 0, 1, ...; at least 1.
        picture: Settings of the video; ``None`` for no video. A graphics driver is needed.
        on_episode: Called after each episode.
        progress: Called with the progress of the video.

    Raises:
        ConfigError: If a setting is out of range, or names a class of another package.
        RunError: If there is no run, its model cannot be loaded, or the folder cannot be used.
    """
    with player_written(run, folder, best) as written:
        exported = ExportedFolder(written.path)
        config = exported.read_config(exported=True)
        found = evaluate(exported.path, 1, range(episodes), on_episode=on_episode)
        if found.interrupted:
            raise KeyboardInterrupt
        with OpenPlayer.open(exported.path) as player:
            take = take_of(player) if picture and isinstance(player.env, PianoEnv) else None
        if take is not None:
            files = write_take(take, exported.path / REPLAY, picture, progress)
            for file in filter(None, (files.wav, files.take)):
                file.unlink()
        write_text(exported.card_file, card_of(exported, config, found))
    return exported
