"""Wrapper that changes the lookahead."""

from __future__ import annotations

import dataclasses
import math
from typing import Annotated, Any

import gymnasium as gym
import numpy as np
from annotated_types import Ge
from numpy.lib.stride_tricks import sliding_window_view

from sb3_piano.arrays import BoolArray, Float32Array
from sb3_piano.envs.config import LookaheadSteps
from sb3_piano.envs.observation import ObservationBlock, ObservationLayout
from sb3_piano.exceptions import ConfigError
from sb3_piano.layers import layers
from sb3_piano.music import PianoRoll
from sb3_piano.settings import Count, Number, Unit, checked
from sb3_piano.wrappers.hide_fingering import HideFingering
from sb3_piano.wrappers.piano import LayoutWrapper, layout_of, unwrap_piano

_LABELS = "lookahead_fingering"

# Within which a time is a whole number of control steps, s.
_TIME_TOLERANCE = 1e-9


class Lookahead(LayoutWrapper, gym.utils.RecordConstructorArgs):
    """Observe the goal of more, or fewer, future control steps.

    The block ``goal`` gets another number of rows, whatever the environment's own
    ``n_steps_lookahead``; it keeps the keys it has. Row 0 is the current control step. With
    ``stride`` s, row k covers the s steps from ``(k - 1) * s + 1`` to ``k * s`` after it: a number
    is 1 if it is 1 in any of them. Beyond the end of the piece all is 0.

    With ``fingers`` there is one block more at the end, ``lookahead_fingering``: for each row the
    fingers labelled to press in its steps, right thumb to little, then left.

    Source: RoboVirtuoso, section 7.2, has ``steps=100, stride=10`` by a convolution: "one vector
    representing the current goal" and "10 vectors each representing 0.5s of lookahead". It learns
    what a vector keeps of its ten steps; here it is the union. "We also introduced a lookahead for
    the fingering goal."

    Args:
        env: A piano environment, wrapped or not, that observes keys (not ``"fingers"``).
        steps: How many control steps after the current one are shown, 0 or more; a multiple of
            ``stride``.
        seconds: The same as a time, s, a whole number of control steps. Exactly one of ``steps``
            and ``seconds`` is given.
        stride: How many control steps a row covers, except the first one; 1 or more.
        fingers: Whether the finger labels of the future are shown, too.

    Raises:
        ConfigError: If an argument has the wrong type or is out of range, ``env`` is no piano or
            does not observe keys, or fingers are asked for that are hidden or shown already.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any],
        steps: int | None = None,
        *,
        seconds: float | None = None,
        stride: int = 1,
        fingers: bool = False,
    ) -> None:
        gym.utils.RecordConstructorArgs.__init__(
            self, steps=steps, seconds=seconds, stride=stride, fingers=fingers
        )
        layout = layout_of(env, "Lookahead", "goal")
        if checked("fingers", fingers, bool) and any(
            isinstance(layer, HideFingering) for layer in layers(env)
        ):
            raise ConfigError(
                "Lookahead with fingers would show the labels that a HideFingering inside of it "
                "hides: expected the HideFingering outside, or fingers=False."
            )
        self._piano = unwrap_piano(env, "Lookahead")
        self._stride = checked("stride", stride, Count)
        self._steps = _steps_ahead(
            steps, seconds, self._stride, self._piano.config.control_timestep
        )
        super().__init__(env, self._other_layout(layout, fingers))
        inner = layout["goal"]
        self._start, self._stop, self._columns = inner.start, inner.slice.stop, inner.all_columns
        self._labels = self._piano.scene.fingers if fingers else None
        self._take(self._piano.asked_roll)

    def observation(self, observation: Any) -> Float32Array:
        """Return the observation with the new goal; after the last step the goal repeats."""
        if self._piano.asked_roll is not self._roll:
            self._take(self._piano.asked_roll)
        step = min(self._piano.steps_played, len(self._roll) - 1)
        before, after = observation[: self._start], observation[self._stop :]
        labels = [self._labels_ahead.rows(step)] if self._labels is not None else []
        return np.concatenate([before, self._goal_ahead.rows(step), after, *labels])

    def _take(self, roll: PianoRoll) -> None:
        """Prepare a piece."""
        self._roll = roll
        goal = np.column_stack([roll.active, roll.sustain])[:, self._columns]  # (T, n)
        self._goal_ahead = _Ahead(goal, self._steps, self._stride)
        if self._labels is not None:
            labels = roll.labelled_fingers()[:, self._labels]
            self._labels_ahead = _Ahead(labels, self._steps, self._stride)

    def _other_layout(self, layout: ObservationLayout, fingers: bool) -> ObservationLayout:
        """Return the layout with the new goal, and with finger labels if enabled."""
        rows = self._steps // self._stride + 1
        count = len(self._piano.scene.fingers) if fingers else 0
        return _layout(layout, rows, self._stride, count)


class _Ahead:
    """Rows of the goal ahead of each control step, from (T, n) bool."""

    def __init__(self, values: BoolArray, steps: int, stride: int):
        self._steps, self._stride = steps, stride
        self._now = values.astype(np.float32)
        # Silence is appended, so that the lookahead of the last step can be cut like any other.
        padded = np.pad(values, ((0, steps + stride), (0, 0)))
        # In row t, what any of the steps t + 1 to t + stride asks for.
        soon = np.logical_or.reduce(sliding_window_view(padded[1:], stride, axis=0), axis=-1)
        self._soon = soon.astype(np.float32)

    def rows(self, step: int) -> Float32Array:
        """Return the rows of a control step, concatenated."""
        ahead = self._soon[step : step + self._steps : self._stride]
        return np.concatenate([self._now[step], ahead.reshape(-1)])


def _layout(layout: ObservationLayout, rows: int, stride: int, fingers: int) -> ObservationLayout:
    covers = f" Each row after the first covers {stride} control steps." if stride > 1 else ""
    goal = layout["goal"]
    other = dataclasses.replace(
        goal, shape=(rows, goal.shape[1]), low=0.0, high=1.0, meaning=goal.meaning + covers
    )
    blocks = [other if block.name == "goal" else block for block in layout.values()]
    if fingers:
        meaning = (
            "1 for each finger that is labelled to press, for the current control step and those "
            f"after it: thumb to little, the right hand first; 0 beyond the end{covers}"
        )
        shape = (rows, fingers)
        block = ObservationBlock(name=_LABELS, shape=shape, meaning=meaning, binary=True)
        blocks.append(block)
    return ObservationLayout(blocks)


def _steps_ahead(
    steps: int | None, seconds: float | None, stride: int, control_timestep: float
) -> int:
    """Return the lookahead in control steps, from a number of steps or a time."""
    if (steps is None) == (seconds is None):
        raise ConfigError(
            f"steps is {steps!r} and seconds is {seconds!r}: expected exactly one of them."
        )
    if seconds is not None:
        seconds = checked("seconds", seconds, Annotated[Number, Ge(0), Unit("s")])
        steps = round(seconds / control_timestep)
        if abs(steps * control_timestep - seconds) > _TIME_TOLERANCE:
            below = math.floor(seconds / control_timestep)
            raise ConfigError(
                f"seconds is {seconds!r}, which is no whole number of control steps of "
                f"{control_timestep:g} s: expected {below * control_timestep:g} or "
                f"{(below + 1) * control_timestep:g}."
            )
    steps = checked("steps", steps, LookaheadSteps)
    if steps % stride != 0:
        below = steps // stride * stride
        raise ConfigError(
            f"Lookahead over {steps} control steps cannot be cut into rows of stride {stride}: "
            f"expected a multiple of it, such as {below} or {below + stride}."
        )
    return steps
