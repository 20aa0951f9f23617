"""The observation as a described vector: which numbers stand where, and what they mean."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from gymnasium import spaces

from sb3_piano.music.constants import NUM_FINGERS, NUM_KEYS
from sb3_piano.simulation import PianoScene

GOAL_WIDTH = NUM_KEYS + 1
"""Numbers in one row of the goal: the keys, then the pedal."""

# Joint limits are soft: a joint that is pushed may overshoot its range by a little. The declared
# bounds leave this much room (rad, or m for the sliders).
_JOINT_OVERSHOOT = 1.0


@dataclass(frozen=True, kw_only=True)
class ObservationBlock:
    """One named part of the observation vector."""

    name: str
    """Name by which wrappers cut the block."""
    start: int
    """First index in the observation vector."""
    shape: tuple[int, ...]
    """Shape of the block before it was flattened (row-major)."""
    unit: str
    """Unit of its numbers; "1" for pure numbers."""
    meaning: str
    """What its numbers say, in a sentence."""

    @property
    def size(self) -> int:
        """How many numbers the block holds."""
        return math.prod(self.shape)

    @property
    def slice(self) -> slice:
        """Where the block stands in the observation vector."""
        return slice(self.start, self.start + self.size)


class ObservationLayout(Mapping[str, ObservationBlock]):
    """The blocks of an observation vector by name, in their order, without gaps."""

    def __init__(self, blocks: Mapping[str, tuple[tuple[int, ...], str, str]]):
        """Lay out blocks one after the other.

        Args:
            blocks: For each name its shape, unit and meaning.
        """
        self._blocks: dict[str, ObservationBlock] = {}
        start = 0
        for name, (shape, unit, meaning) in blocks.items():
            block = ObservationBlock(
                name=name, start=start, shape=shape, unit=unit, meaning=meaning
            )
            self._blocks[name] = block
            start += block.size
        self.size = start

    def __getitem__(self, name: str) -> ObservationBlock:
        return self._blocks[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._blocks)

    def __len__(self) -> int:
        return len(self._blocks)

    def __repr__(self) -> str:
        blocks = ", ".join(f"{b.name}[{b.start}:{b.start + b.size}]" for b in self.values())
        return f"ObservationLayout({blocks})"


def piano_layout(scene: PianoScene, n_steps_lookahead: int) -> ObservationLayout:
    """Return RoboPianist's observation order for a scene.

    Args:
        scene: The scene whose hands are observed.
        n_steps_lookahead: How many control steps after the current one the goal shows.
    """
    right, left = (len(addresses) for addresses in scene.joint_qpos)
    joints = "joint positions, wrist to thumb, then the sliders along the keyboard and upwards"
    return ObservationLayout(
        {
            "goal": (
                (n_steps_lookahead + 1, GOAL_WIDTH),
                "1",
                "1 where a key (columns 0-87) or the pedal (column 88) should be down, for the "
                "current control step and those after it; 0 beyond the end",
            ),
            "fingering": (
                (NUM_FINGERS,),
                "1",
                "1 for each finger that is labelled to press now: right thumb to little, then left",
            ),
            "key_state": ((NUM_KEYS,), "1", "key angle over its largest angle, in [0, 1]"),
            "sustain": ((1,), "1", "the pedal's command in [0, 1]; down from 0.5 on"),
            "right_joints": ((right,), "rad, m for the last two", f"right hand's {joints}"),
            "left_joints": ((left,), "rad, m for the last two", f"left hand's {joints}"),
        }
    )


def piano_space(layout: ObservationLayout, scene: PianoScene) -> spaces.Box:
    """Return the observation space that belongs to a layout of :func:`piano_layout`."""
    low = np.zeros(layout.size, dtype=np.float32)
    high = np.ones(layout.size, dtype=np.float32)
    for name, limits in zip(("right_joints", "left_joints"), scene.joint_range, strict=True):
        low[layout[name].slice] = limits[:, 0] - _JOINT_OVERSHOOT
        high[layout[name].slice] = limits[:, 1] + _JOINT_OVERSHOOT
    return spaces.Box(low, high, dtype=np.float32)
