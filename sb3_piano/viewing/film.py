"""Draw the pictures of takes, from their recorded motion."""

from __future__ import annotations

import contextlib
import itertools
import math
import os
from collections import deque
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Protocol

import numpy as np
import numpy.typing as npt

from sb3_piano.arrays import FloatArray
from sb3_piano.metrics import frame_f1
from sb3_piano.performance import Performance
from sb3_piano.simulation import PianoScene
from sb3_piano.simulation.gl import find_gl_backend
from sb3_piano.viewing.moment import Moment
from sb3_piano.viewing.performance_renderer import PerformanceRenderer
from sb3_piano.viewing.views import DEFAULT_PICTURE, Picture

Frame = npt.NDArray[np.uint8]
_Opened = Callable[[], PerformanceRenderer]
_Draw = Callable[[PerformanceRenderer, Moment], Frame]

_MOST_THREADS = 4
_AHEAD = 3
"""Pictures that each thread may draw before they are used."""


class Filmed(Protocol):
    """What pictures need of a :class:`~sb3_piano.take.Take`."""

    @property
    def scene(self) -> PianoScene:
        """Scene of the performance."""

    @property
    def piano(self) -> Performance:
        """The performance, with the due notes."""

    @property
    def qpos(self) -> FloatArray:
        """(t + 1, nq) joint positions at the start and after each control step, rad or m."""

    @property
    def period(self) -> float:
        """Time between two of these, s."""

    @property
    def judged(self) -> bool:
        """Whether pictures show right and wrong keys, and the F1 so far."""


def moments(take: Filmed, fps: float | None = None) -> Iterator[Moment]:
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
        step = min(round(k * each, 9), len(qpos) - 1.0)
        before, share = int(step), step % 1.0
        positions = qpos[before]
        if share:
            positions = positions + share * (qpos[before + 1] - positions)
        now = max(math.ceil(step) - 1, 0)
        due, fingers = roll.due(now)
        sounding = scene.clipped_key_angle(positions[scene.key_slice]) >= scene.key_sounding_angle
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


def moment_count(take: Filmed, fps: float | None = None) -> int:
    """Return the number of :func:`moments`."""
    steps = len(take.qpos)
    return steps if fps is None else max(round(steps * take.period * fps), 1)


def film(take: Filmed, picture: Picture = DEFAULT_PICTURE) -> Generator[Frame, None, None]:
    """Draw a take as the environment's ``render`` draws every step.

    Threads draw the pictures, each with a drawing context of its own.

    Returns:
        Pictures, (height, width, 3) uint8; picture k shows time ``k / picture.fps``.

    Raises:
        RenderingError: If this machine cannot draw; the message says what to install.
    """
    roll, title, seen = take.piano.roll, take.piano.title, moments(take, picture.fps)

    def opened() -> PerformanceRenderer:
        return PerformanceRenderer(
            take.scene, width=picture.width, height=picture.height, view=picture.view
        )

    def draw(renderer: PerformanceRenderer, moment: Moment) -> Frame:
        return renderer.render(roll, title, moment)

    if find_gl_backend() == "glfw":  # it draws in the main thread only
        return _drawn_here(opened, draw, seen)
    return _drawn_by_threads(opened, draw, seen, min(_cores(), _MOST_THREADS))


def _cores() -> int:
    linux = hasattr(os, "sched_getaffinity")
    return len(os.sched_getaffinity(0)) if linux else os.cpu_count() or 1


def _drawn_here(
    opened: _Opened, draw: _Draw, seen: Iterator[Moment]
) -> Generator[Frame, None, None]:
    with contextlib.closing(opened()) as renderer:
        for moment in seen:
            yield draw(renderer, moment)


def _drawn_by_threads(
    opened: _Opened, draw: _Draw, seen: Iterator[Moment], threads: int
) -> Generator[Frame, None, None]:
    # A drawing context belongs to a thread: each opens, uses and closes its own.
    pools = [ThreadPoolExecutor(1, "film") for _ in range(threads)]
    renderers = [pool.submit(opened) for pool in pools]
    drawn: deque[Future[Frame]] = deque()
    try:
        ready = [renderer.result() for renderer in renderers]
        turns = itertools.cycle(zip(pools, ready, strict=True))
        for (pool, renderer), moment in zip(turns, seen, strict=False):
            drawn.append(pool.submit(draw, renderer, moment))
            if len(drawn) >= _AHEAD * threads:
                yield drawn.popleft().result()
        while drawn:
            yield drawn.popleft().result()
    finally:
        for picture in drawn:
            picture.cancel()
        for pool, opening in zip(pools, renderers, strict=True):
            # When the interpreter ends, threads end first; the renderer then closes by itself.
            with contextlib.suppress(RuntimeError):
                if opening.exception() is None:
                    pool.submit(opening.result().close)
            pool.shutdown()
