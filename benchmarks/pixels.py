"""Time of pictures as observations: plain ones beside those of videos, in the same process.

    MUJOCO_GL=osmesa python benchmarks/pixels.py

Prints the processor's time of a control step with and without a picture.
"""

from __future__ import annotations

import time

import gymnasium as gym
import numpy as np
import numpy.typing as npt

import sb3_piano  # noqa: F401  registers the environments
from sb3_piano.viewing import FrameRenderer
from sb3_piano.viewing.moment import geom_colors
from sb3_piano.wrappers import Pixels

ENV_ID = "RoboPianist-debug-CMajorScaleTwoHands-v0"
SIZES = ((84, 84), (160, 120))
STEPS = 40
ROUNDS = 5


def seconds_per_step(env: gym.Env) -> float:
    """Return the processor's time of a control step."""
    rest = env.unwrapped.rest_action
    env.reset(seed=0)
    start = time.process_time()
    for _ in range(STEPS):
        env.step(rest)
    return (time.process_time() - start) / STEPS


class Film(gym.ObservationWrapper):
    """Pictures as videos have them, with shadows and smooth edges."""

    def __init__(self, env: gym.Env, width: int, height: int) -> None:
        super().__init__(env)
        piano = env.unwrapped
        self.renderer = FrameRenderer(piano.scene, width=width, height=height, camera="overview")

    def observation(self, observation: npt.NDArray) -> npt.NDArray:
        """Return a picture."""
        piano = self.unwrapped
        nothing = np.array([], dtype=np.intp)
        colors = geom_colors(piano.scene, due=nothing, fingers=nothing, sounding=piano.key_active)
        return self.renderer.render(piano.data, colors)


def main() -> None:
    """Measure in turns, and print the medians."""
    print("| picture | alone | with it | as in a video | plain over video |")
    print("|---|---:|---:|---:|---:|")
    for width, height in SIZES:
        cases = [
            gym.make(ENV_ID),
            Pixels(gym.make(ENV_ID), width, height),
            Film(gym.make(ENV_ID), width, height),
        ]
        rounds = [[seconds_per_step(env) for env in cases] for _ in range(ROUNDS)]
        alone, plain, film = np.median(rounds, axis=0)
        ratio = (film - alone) / (plain - alone)
        steps = " | ".join(f"{1 / each:.0f} steps/s" for each in (alone, plain, film))
        print(f"| {width} x {height} | {steps} | {ratio:.1f} |")


if __name__ == "__main__":
    main()
