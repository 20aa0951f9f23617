"""Fingering from video against known fingers: tables of docs/fingering_from_video.md.

    python benchmarks/video_fingering.py --pieces TwinkleTwinkle BachMinuetG
    python benchmarks/video_fingering.py --pieces TwinkleTwinkle --film film

The planned pianist plays, a camera that is only computed looks at its fingertips, and errors like
those of a detector are added. Measured is the macro F1 between the fingers that are found and
those that pressed the keys. The alignment hears the sound of the performance. ``--film`` also
writes a video with its landmarks and labels into a folder, for the command.
"""

from __future__ import annotations

import argparse
import dataclasses
import tempfile
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path

import mujoco
import numpy as np

import sb3_piano
from sb3_piano.exceptions import PlanWarning
from sb3_piano.lab.video.alignment import Alignment, align, read_sound
from sb3_piano.lab.video.filmed import Camera, corners, filmed_landmarks, played_score
from sb3_piano.lab.video.fingers import (
    choose_fingers,
    finger_probabilities,
    macro_f1,
    table_of,
)
from sb3_piano.lab.video.keyboard import KeyboardPlane
from sb3_piano.music import Score, load_score
from sb3_piano.music.fingering import without_fingers
from sb3_piano.music.fingering.labels import pair_notes
from sb3_piano.take import Take
from sb3_piano.viewing.video import write_video

_PIECES = ("TwinkleTwinkle", "OdeToJoy", "BachMinuetG", "FurElise", "BachPreludeC", "Gymnopedie1")
_SKIN = (0.85, 0.62, 0.5, 1.0)
_FILMED = Camera(field=72.7)  # the renderer's view
_CAMERAS = {
    "no error": {},
    "noise 4 mm": {"noise": 4},
    "noise 8 mm": {"noise": 8},
    "noise 12 mm": {"noise": 12},
    "noise 16 mm": {"noise": 16},
    "lasting errors 4 mm": {"jitter": 4},
    "noise 8 mm, 60 pictures/s": {"noise": 8, "rate": 60},
    "noise 8 mm, 15 pictures/s": {"noise": 8, "rate": 15},
    "noise 8 mm, 30 % of hands not found": {"noise": 8, "dropout": 0.3},
    "noise 8 mm, lens k = 0.05": {"noise": 8, "distortion": 0.05},
    "noise 8 mm, from 0.9 m": {"noise": 8, "height": 0.9, "field": 80},
    "noise 8 mm, from 2 m": {"noise": 8, "height": 2.0, "field": 40},
    "noise 8 mm, tilted by 45 degrees": {"noise": 8, "tilt": 45},
}


def truth_of(take: Take, score: Score) -> list[int]:
    """Return the finger that pressed each note of a score, -1 where none did within 0.1 s."""
    played = played_score(take)
    lead = take.piano.roll.onset_time.min() - min(note.onset for note in score.notes)
    due = [
        dataclasses.replace(note, onset=note.onset + lead, offset=note.offset + lead)
        for note in score.notes
    ]
    found = [-1] * len(due)
    for place, index in pair_notes(played.notes, due, 0.1).items():
        found[index] = played.notes[place].finger
    return found


def heard(take: Take, score: Score) -> Alignment:
    """Align a score with the sound of a take."""
    with tempfile.TemporaryDirectory() as folder:
        take.save_wav(Path(folder, "sound.wav"))
        return align(score, read_sound(Path(folder, "sound.wav")))


def film(take: Take, score: Score, folder: Path) -> None:
    """Write a video of a take with hands in a skin's colour, its landmarks and its labels."""
    model = take.scene.model
    hands = [k for k in range(model.ngeom) if "hand" in model.body(model.geom_bodyid[k]).name]
    model.geom_rgba[hands], model.geom_matid[hands] = _SKIN, -1
    model.vis.global_.offwidth, model.vis.global_.offheight = 1280, 720
    renderer, data = mujoco.Renderer(model, 720, 1280), mujoco.MjData(model)
    camera = mujoco.MjvCamera()
    camera.azimuth, camera.elevation = 180, _FILMED.tilt - 90
    camera.lookat[:] = 0.0, 0.0, 0.02
    camera.distance = _FILMED.height / np.cos(np.radians(_FILMED.tilt))

    def pictures() -> Iterator[np.ndarray]:
        for qpos in take.qpos:
            data.qpos[:] = qpos
            mujoco.mj_forward(model, data)
            renderer.update_scene(data, camera)
            yield renderer.render()

    folder.mkdir(parents=True, exist_ok=True)
    take.save_wav(folder / "sound.wav")
    sound, size = folder / "sound.wav", (1280, 720)
    write_video(folder / "film.mp4", pictures(), fps=1 / take.period, audio=sound, size=size)
    noisy = dataclasses.replace(_FILMED, noise=8.0, dropout=0.05)
    filmed_landmarks(take, noisy).write(folder / "landmarks.npz")
    fingers = np.array(truth_of(take, score))
    labels = table_of(score, fingers, np.ones(len(fingers)))
    (folder / "labels.csv").write_text(labels, encoding="utf-8")


def main(argv: Sequence[str] | None = None) -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pieces", nargs="+", default=_PIECES)
    parser.add_argument("--film", type=Path, help="folder for a video of the first piece")
    options = parser.parse_args(argv)
    warnings.simplefilter("ignore", PlanWarning)
    means: dict[str, list[float]] = {name: [] for name in ("onsets heard", *_CAMERAS)}
    for piece in options.pieces:
        score = without_fingers(load_score(piece), keep_hands=False)
        take = sb3_piano.play(piece, player="planned")
        if options.film is not None and piece == options.pieces[0]:
            film(take, score, options.film)
        truth, alignment = truth_of(take, score), heard(take, score)
        means["onsets heard"].append(alignment.hits)
        for name, changed in _CAMERAS.items():
            camera = Camera(**changed)
            landmarks = filmed_landmarks(take, camera, seed=1)
            plane = KeyboardPlane.of_corners(corners(camera).tolist())
            likely = finger_probabilities(score, alignment.onsets, landmarks, plane)
            means[name].append(macro_f1(choose_fingers(score, likely)[0], truth))
    print(f"| | {' | '.join(options.pieces)} | mean |")
    print("| --- |" + " ---: |" * (len(options.pieces) + 1))
    for name, values in means.items():
        print(f"| {name} | {' | '.join(f'{x:.3f}' for x in (*values, np.mean(values)))} |")


if __name__ == "__main__":
    main()
