"""The animation of the README: untrained hands play a few bars of real music.

    python docs/animation.py

It writes docs/playing.gif, and prints how well it was played.
"""

from __future__ import annotations

import subprocess
import tempfile
from pathlib import Path

import imageio_ffmpeg

from sb3_piano.music import load_score, write_midi
from sb3_piano.training.playing.takes import planner_config, take_of_planner
from sb3_piano.viewing import Picture, write_take

PIECE, SECONDS = "BachMinuetG", 8.0
WIDTH, FPS, COLORS = 480, 10, 128
CROP = "crop=in_w/2:in_h*0.56:in_w/4:in_h*0.28"  # the hands and the keys around them
OUT = Path(__file__).with_name("playing.gif")


def main() -> None:
    """Play, draw a video, and make a GIF of it with the ffmpeg that imageio-ffmpeg brings."""
    palette = f"split[a][b];[a]palettegen=max_colors={COLORS}[p];[b][p]paletteuse=dither=bayer"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_midi(load_score(PIECE).excerpt(0.0, SECONDS), folder / "excerpt.mid")
        config = planner_config(str(folder / "excerpt.mid"), "sampling", samples=32)
        played = take_of_planner(config)
        print(f"F1 {played.metrics['f1']:.3f}, onset F1 {played.metrics['onset_f1']:.3f}")
        video = write_take(played.take, folder / "video", Picture(width=1280, height=720)).video
        filters = f"{CROP},fps={FPS},scale={WIDTH}:-1:flags=lanczos,{palette}:bayer_scale=5"
        ffmpeg = [imageio_ffmpeg.get_ffmpeg_exe(), "-y", "-v", "error"]
        subprocess.run([*ffmpeg, "-i", str(video), "-vf", filters, str(OUT)], check=True)
    print(f"{OUT}: {OUT.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
