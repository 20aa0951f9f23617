"""What does a piece sound like, and which finger plays what?"""

from tempfile import mkdtemp

from sb3_piano.training.playing.takes import play_score
from sb3_piano.viewing import Picture

PIECE = "CMajorChordProgressionTwoHands"


def main() -> None:
    # Of a trained model in a run's folder, play_run makes the same files.
    files = play_score(PIECE, mkdtemp(prefix="play_"), picture=Picture(width=320, height=180))
    print(f"{PIECE}: {files.midi}, {files.wav}")
    print(files.video if files.problem is None else f"0 pictures: {files.problem}")


if __name__ == "__main__":
    main()
