"""Draw the pictures of takes, from their recorded motion."""

from __future__ import annotations

import contextlib
import itertools
import math
import os
from collections import deque
from collections.abc import Generator, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from sb3_piano.metrics import frame_f1
from sb3_piano.simulation.gl import find_gl_backend
from sb3_piano.viewing.moment import Moment
from sb3_piano.viewing.performance_renderer import PerformanceRenderer
from sb3_piano.viewing.views import DEFAULT_PICTURE, Picture

if TYPE_CHECKING:
    from sb3_piano.viewing.take import Take

_MOST_THREADS = 4
_AHEAD = 3
"""Pictures that each thread may draw before they are used."""


def moments(take: Take, fps: float | None = None) -> Iterator[Moment]:
    """Yield the moments of a take: its start, and the end of each control step.

    The first moment shows the first step's due keys, each later one those of the step just played.

    Args:
        take: The take.
        fps: Moments a second from the start to the end, with interpolated positions; by default
            those at which the positions were recorded.
    """
    scene, roll, qpos = take.scene, take.piano.roll, take.qpos
    played, pedal, judged = take.piano.key_active, take.piano.sustain, take.judged
    each = 1.0 if fps is None else 1.0 / (fps * take.period)
    f1, scored = None, 0
    for k in range(moment_count(take, fps)):
        step = min(round(k * each, 6), len(qpos) - 1.0)
        before, share = int(step), step % 1.0
        positions = qpos[before]
        if share:
            positions = positions + share * (qpos[before + 1] - positions)
        now = max(math.ceil(step) - 1, 0)
        due, fingers = roll.due(now)
        sounding = scene.key_angle_at(positions) >= scene.key_sounding_angle
        if judged and before > scored:
            f1, scored = frame_f1(roll.active[:before], played[:before]), before
        yield Moment(
            qpos=positions,
            step=step,
            due=due,
            fingers=fingers,
            sounding=sounding if judged else None,
            f1=f1,
            pedal=bool(pedal[now]) if len(pedal) else False,
        )


def moment_count(take: Take, fps: float | None = None) -> int:
    """Return the number of :func:`moments`."""
    steps = len(take.qpos)
    return steps if fps is None else max(round(steps * take.period * fps), 1)


def film(
    take: Take, picture: Picture = DEFAULT_PICTURE
) -> Generator[npt.NDArray[np.uint8], None, None]:
    """Draw a take as the environment's ``render`` draws every step.

    Threads draw the pictures, each with a drawing context of its own.

    Returns:
        Pictures, (height, width, 3) uint8; picture k shows time ``k / picture.fps``.

    Raises:
        RenderingError: If this machine cannot draw; the message says what to install.
    """
    roll, title = take.piano.roll, take.piano.title
    # GLFW draws in the main thread only.
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    threads = 0 if find_gl_backend() == "glfw" else min(cores or 1, _MOST_THREADS)

    def opened() -> PerformanceRenderer:
        return PerformanceRenderer(
            take.scene, width=picture.width, height=picture.height, view=picture.view
        )

    def frames_here() -> Generator[npt.NDArray[np.uint8], None, None]:
        with contextlib.closing(opened()) as renderer:
            for seen in moments(take, picture.fps):
                yield renderer.render(roll, title, seen)

    def frames() -> Generator[npt.NDArray[np.uint8], None, None]:
        pools = [ThreadPoolExecutor(1, "film") for _ in range(threads)]
        # Contexts belong to threads: each opens, uses and closes its own.
        renderers = [pool.submit(opened) for pool in pools]
        drawn: deque[Future[npt.NDArray[np.uint8]]] = deque()
        try:
            [renderer.result() for renderer in renderers]
            seen = moments(take, picture.fps)
            for pool, renderer in itertools.cycle(zip(pools, renderers, strict=True)):
                if (moment := next(seen, None)) is None:
                    break
                drawn.append(pool.submit(renderer.result().render, roll, title, moment))
                if len(drawn) >= _AHEAD * threads:
                    yield drawn.popleft().result()
            while drawn:
                yield drawn.popleft().result()
        finally:
            for future in drawn:
                future.cancel()
            for pool, renderer in zip(pools, renderers, strict=True):
                if not renderer.exception():
                    pool.submit(renderer.result().close)
                pool.shutdown()

    return frames() if threads else frames_here()
