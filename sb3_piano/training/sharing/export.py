"""Export of a run: what plays it, what it plays, and how well, in a folder without pickles."""

from __future__ import annotations

import os
from collections.abc import Callable

from sb3_piano.envs import PianoEnv
from sb3_piano.files import Place, write_text
from sb3_piano.training.evaluation.evaluate import evaluate
from sb3_piano.training.playing.player import OpenPlayer
from sb3_piano.training.playing.player_files import player_written
from sb3_piano.training.playing.takes import take_of
from sb3_piano.training.runs.folder import RunFolder
from sb3_piano.training.sharing.card import card_of
from sb3_piano.viewing import Picture, write_take
from sb3_piano.viewing.take import Progress
from sb3_piano.viewing.views import DEFAULT_PICTURE

REPLAY = "replay"
"""Name of the video and of its MIDI file, without suffixes; the Hub shows ``replay.mp4``."""


class ExportedFolder(RunFolder):
    """The folder of an exported run."""

    card_file = Place("README.md")
    video_file = Place(f"{REPLAY}.mp4")


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
    """Write a run for others to play: settings, weights, a card, a video, in plain files.

    The new folder has no pickles, and its settings name only classes of
    ``KNOWN_PACKAGES``, so that loading it runs no code of it. It is
    evaluated, played and reported on like the run, with the same result to the last bit; it cannot
    be trained on. Whatever ends this early leaves no folder,
    but for a kill, after which the same call makes it anew.

    Args:
        run: The run's folder.
        folder: Where to, a new or empty folder.
        best: Export the best model by this metric, such as "f1", in place of the last one.
        episodes: How many the card tells of, each from the next seed from 0 on; at least 1.
        picture: How the video looks; ``None`` for no video. Without a graphics driver there is
            none either.
        on_episode: Is called after each episode.
        progress: Is told how far the video is.

    Raises:
        ConfigError: If a setting is out of range, or names a class of another package.
        RunError: If there is no run, it has no model that can be loaded, or the folder cannot be
            used.
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
