"""The videos of docs/gallery.md: a few seconds of pieces, by players and by an agent that learned.

    python docs/gallery.py                # all
    python docs/gallery.py nocturne       # one, after 100,000 steps of training

It writes docs/gallery/*.mp4, and prints how well each was played.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path

from sb3_piano.envs import GENERAL_ID
from sb3_piano.music import load_score, write_midi
from sb3_piano.take import write_take
from sb3_piano.training import OpenPlayer, load_fine_tuning, train
from sb3_piano.training.playing.takes import take_of
from sb3_piano.viewing import Picture, View

FOLDER = Path(__file__).with_name("gallery")
SECONDS = 8.0


@dataclass(frozen=True, kw_only=True)
class Clip:
    """The beginning of a piece, played by somebody and seen from somewhere."""

    name: str
    piece: str
    title: str
    player: str
    view: View
    learns: bool = False
    """Whether stock SAC learns to correct the player on this piece first."""


CLIPS = (
    Clip(
        name="fur_elise",
        piece="FurElise",
        title="Beethoven: Für Elise",
        player="sight-reader",
        view="stage",
    ),
    Clip(
        name="maple_leaf_rag",
        piece="MapleLeafRag",
        title="Joplin: Maple Leaf Rag",
        player="tree:64x8:sight-reader",
        view="close",
    ),
    Clip(
        name="prelude_in_c",
        piece="BachPreludeC",
        title="Bach: Prelude in C",
        player="planned",
        view="top",
    ),
    Clip(
        name="nocturne",
        piece="ChopinNocturneOp9No2",
        title="Chopin: Nocturne op. 9 no. 2",
        player="planned",
        view="stage",
        learns=True,
    ),
)


def main() -> None:
    """Play and film each of them."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    names = [clip.name for clip in CLIPS]
    parser.add_argument("clips", nargs="*", default=names, metavar="CLIP", help=", ".join(names))
    chosen = parser.parse_args().clips
    FOLDER.mkdir(exist_ok=True)
    for clip in CLIPS:
        if clip.name not in chosen:
            continue
        with tempfile.TemporaryDirectory() as name:
            piece = Path(name, f"{clip.title}.mid")
            write_midi(load_score(clip.piece).excerpt(0.0, SECONDS), piece)
            who = corrected(clip.player, piece, Path(name, "run")) if clip.learns else clip.player
            with OpenPlayer.open(who, score=piece) as player:
                take = take_of(player)
            picture = Picture(width=854, height=480, view=clip.view, fps=30)
            files = write_take(take, Path(name, clip.name), picture)
            if files.video is None:
                raise SystemExit(f"No picture can be drawn here: {files.problem}")
            file = Path(shutil.copy(files.video, FOLDER))
        scores = f"F1 {take.metrics['f1']:.3f}, onset F1 {take.metrics['onset_f1']:.3f}"
        print(f"{file}: {scores}, {file.stat().st_size / 1e6:.2f} MB", flush=True)


def corrected(player: str, piece: Path, folder: Path) -> str:
    """Train the preset's correction of a player on a piece; return the run's folder."""
    kwargs = {"score": str(piece)}
    config = load_fine_tuning("sac", GENERAL_ID, player=player, env_kwargs=kwargs, seed=0)
    train(config, folder)
    return str(folder)


if __name__ == "__main__":
    main()
