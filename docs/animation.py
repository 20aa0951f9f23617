"""Pictures of the README and of docs/watching.md: the sight-reader plays a few bars of music.

    python docs/animation.py

It writes docs/playing.gif and docs/views.jpg, and prints how well it was played.
"""

from __future__ import annotations

import contextlib
import subprocess
import tempfile
import typing
from pathlib import Path

import imageio_ffmpeg
import numpy as np
from PIL import Image

from sb3_piano.music import load_score, write_midi
from sb3_piano.take import Take, write_take
from sb3_piano.training import OpenPlayer
from sb3_piano.training.playing.takes import take_of
from sb3_piano.viewing import PerformanceRenderer, Picture, View, moments

PIECE, TITLE, SECONDS = "BachMinuetG", "Petzold: Minuet in G", 8.0
WIDTH, FPS, COLORS = 600, 10, 64
ANIMATION, VIEWS = (Path(__file__).with_name(name) for name in ("playing.gif", "views.jpg"))
STEP = 80
"""The moment of which there is a picture from each view, a control step."""


def main() -> None:
    """Play, and write both files."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_midi(load_score(PIECE).excerpt(0.0, SECONDS), folder / f"{TITLE}.mid")
        with OpenPlayer.open("sight-reader", score=folder / f"{TITLE}.mid") as player:
            take = take_of(player)
        print(f"F1 {take.metrics['f1']:.3f}, onset F1 {take.metrics['onset_f1']:.3f}")
        write_animation(take, folder)
    write_views(take)


def write_animation(take: Take, folder: Path) -> None:
    """Draw a video into a folder, and make a GIF of it with imageio-ffmpeg's ffmpeg."""
    palette = f"split[a][b];[a]palettegen=max_colors={COLORS}[p];[b][p]paletteuse=dither=none"
    video = write_take(take, folder / "video", Picture(width=1280, height=720, fps=30)).video
    filters = f"fps={FPS},scale={WIDTH}:-1:flags=lanczos,{palette}"
    ffmpeg = [imageio_ffmpeg.get_ffmpeg_exe(), "-y", "-v", "error"]
    subprocess.run([*ffmpeg, "-i", str(video), "-vf", filters, str(ANIMATION)], check=True)
    print(f"{ANIMATION}: {ANIMATION.stat().st_size / 1e6:.1f} MB")


def write_views(take: Take) -> None:
    """Draw one moment from each view, two beside two."""
    drawn = []
    for view in typing.get_args(View):
        renderer = PerformanceRenderer(take.scene, width=WIDTH, height=360, view=view)
        with contextlib.closing(renderer):
            performance = take.piano
            seen = list(moments(take))[STEP]
            drawn.append(renderer.render(performance.roll, performance.title, seen))
    rows = [np.concatenate(drawn[k : k + 2], axis=1) for k in (0, 2)]
    Image.fromarray(np.concatenate(rows)).save(VIEWS, quality=88)
    print(f"{VIEWS}: {VIEWS.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
