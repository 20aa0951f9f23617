"""How does a MIDI file become an episode, and an episode a MIDI file?"""

import sys
from pathlib import Path
from tempfile import gettempdir

import gymnasium as gym
import numpy as np

import sb3_piano  # noqa: F401  registers the ids
from sb3_piano.music import Note, Score, load_score, write_midi


def main(source: str | None = None) -> None:
    # Any MIDI file will do; without one, write three notes with finger labels (0 = right thumb).
    path = Path(gettempdir()) / "three_notes.mid"
    notes = [
        Note(onset=i * 0.5, offset=i * 0.5 + 0.4, pitch=72 + 2 * i, finger=i) for i in range(3)
    ]
    write_midi(Score(notes=notes), path)
    score = load_score(source or path)
    print(f"{score}: keys {score.pitch_range}, finger labels: {score.has_fingering}")

    # Notes without a label get the finger that is the least effort.
    score = score.transpose(-5).stretch(1.5)
    env = gym.make("RoboPianist-v0", score=score, fingering="ergonomic")
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    action = env.unwrapped.rest_action
    truncated = False
    while not truncated:  # wandering hands
        action = np.clip(action + rng.normal(0, 0.2, action.shape), -1, 1).astype(np.float32)
        *_, truncated, info = env.step(action)

    played = env.unwrapped.performance.to_score()
    print(f"Played {played} at F1 {info['f1']:.3f}")
    if played is not None:
        result = Path(gettempdir()) / "performance.mid"
        write_midi(played, result)
        print(f"The performance is in {result}")
    env.close()


if __name__ == "__main__":
    main(*sys.argv[1:])
