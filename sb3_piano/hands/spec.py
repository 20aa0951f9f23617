"""Specification of a robot hand besides its model: roles of its parts, reach and rest posture.

A hand is a folder with ``hand.yml``, ``right.xml`` and optionally ``left.xml`` (MJCF). Without
``left.xml`` the left hand is the mirrored right hand.
"""

from __future__ import annotations

import dataclasses
import functools
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import numpy as np
from annotated_types import Len

from sb3_piano.arrays import FloatArray
from sb3_piano.exceptions import ConfigError, naming, near_names
from sb3_piano.plain_yaml import read_yaml_mapping
from sb3_piano.settings import (
    Listed,
    Nested,
    NotNegative,
    Number,
    Positive,
    Share,
    refuse_unknown,
    settings,
)

DEFAULT_HAND = "shadow"
"""Name of the default hand."""

SPEC_FILE = "hand.yml"

_HANDS = Path(__file__).parent

Side = Literal["right", "left"]
FingerName = Literal["thumb", "index", "middle", "ring", "little"]
ForearmRole = Literal["along", "across", "up", "roll", "pitch", "yaw"]
Role = ForearmRole | Literal["wrist", "abduction", "finger"]
"""Role of a joint: slide along the keyboard, across it (towards the keys' hinges) or up; turn the
forearm about its own axis, up or to the side; bend the wrist; spread fingers; or bend fingers."""

Names = Annotated[tuple[str, ...], Listed]
_Three = Annotated[tuple[Number, Number, Number], Listed]
_Range = Annotated[tuple[Number, Number], Listed]
_Table = Annotated[tuple[Annotated[tuple[NotNegative, ...], Listed], ...], Listed]


@settings
class Capsule:
    """Capsule that can replace a forearm's geoms."""

    size: Annotated[tuple[Positive, Positive], Listed]
    """Radius and half length, m."""
    pos: _Three
    """Its centre in the forearm's frame, m."""


@settings
class Forearm:
    """Forearm of a hand."""

    body: str
    """Its link, the root of the model."""
    joints: Mapping[ForearmRole, str]
    """Its joints by role, in the order of the model: the slider ``along`` the keyboard, and any of
    ``across``, ``up``, ``roll``, ``pitch`` and ``yaw``."""
    apart: Positive
    """Least distance of the two forearms, m."""
    capsule: Nested[Capsule] | None = None
    """Replacement of its geoms in physics profiles with capsules."""


@settings
class ReducedActions:
    """Joints that the reduced action space removes or narrows."""

    removed: Names = ()
    """Joints that are fixed at 0 and have no actuator."""
    ranges: Mapping[str, _Range] = dataclasses.field(default_factory=dict)
    """Changed ranges of joints and of their actuators, rad."""


@settings
class Rest:
    """Rest posture over neighbouring white keys."""

    height: Positive
    """Height of the fingertips' centres over the keys' tops, m."""
    posture: Mapping[str, Number]
    """Initial posture of the search, by actuator, rad or m; 0 for other actuators."""


@settings
class Reach:
    """Distances at which fingers can press white keys, m."""

    nearest: _Table
    """(f, f) least distance of two fingertips, the second nearer to the little finger."""
    farthest: _Table
    """(f, f) greatest distance of two fingertips."""
    gaps: Annotated[tuple[NotNegative, ...], Listed]
    """(f - 1,) least distances of neighbouring fingertips, from the thumb on."""


@settings
class Ball:
    """Ellipsoid in its link's frame."""

    centre: _Three
    """m."""
    radii: _Three
    """m."""


@settings
class Shape:
    """Convex hull of ellipsoids, drawn over a link of a right hand in place of its geoms."""

    link: str
    """The link with which it moves."""
    color: Annotated[tuple[Share, Share, Share, Share], Listed]
    """RGBA."""
    balls: Annotated[tuple[Nested[Ball], ...], Listed]
    """Ellipsoids of the hull."""


@settings
class HandSpec:
    """Roles of a hand's parts, and its constants for planning, reading and fingering.

    Names are those of the model without the side's prefix, actuators' also without ``A_``.
    """

    source: str
    """Name or absolute path of the hand."""
    title: str
    """Title of the hand."""
    prefix: Annotated[Mapping[Side, str], Len(2)]
    """Prefix of the names of each side."""
    mirror: Literal["x", "y", "z"] = "y"
    """Axis of the links' frames that points across the hand. A left hand without a file is the
    right hand mirrored along it, with the shapes drawn over its links."""
    forearm: Nested[Forearm]
    """The hand's forearm."""
    wrist: Names = ()
    """Joints of the wrist."""
    abduction: Names = ()
    """Joints that spread the fingers."""
    coupled: Names = ()
    """Joints that share an actuator with the next joint; friction decides their shares."""
    fingers: Mapping[FingerName, Annotated[Names, Len(1)]]
    """Links of each finger that may touch keys, the fingertip last; the thumb first."""
    reduced_action_space: Nested[ReducedActions] = ReducedActions()
    """Changes of the reduced action space."""
    rest: Nested[Rest]
    """Rest posture."""
    reach: Nested[Reach]
    """Distances that the fingers can span."""
    look: Annotated[tuple[Nested[Shape], ...], Listed] = ()
    """Shapes in pictures, where the colliders of links other than fingertips are then hidden."""

    def __post_init__(self) -> None:
        if len({*self.prefix.values(), ""}) < 3:
            raise ConfigError(f"prefix is {self.prefix}: expected two texts, one for each side.")
        names, all_names = tuple(self.fingers), get_args(FingerName)
        if len(names) < 3 or names != all_names[: len(names)]:
            raise ConfigError(
                f"fingers are {', '.join(names)}: expected {', '.join(all_names)} in this order, "
                "of which the last ones may be missing."
            )
        if "along" not in self.forearm.joints:
            raise ConfigError("forearm['joints'] has no 'along': expected the slider's name.")
        n, reach = len(names), self.reach
        tables = {"nearest": reach.nearest, "farthest": reach.farthest}
        fits = {name: [len(row) for row in rows] == [n] * n for name, rows in tables.items()}
        for name, is_fit in {**fits, "gaps": len(reach.gaps) == n - 1}.items():
            if not is_fit:
                count = n - 1 if name == "gaps" else f"{n} x {n}"
                raise ConfigError(
                    f"reach[{name!r}] does not fit {n} fingers: expected {count} distances."
                )

    def __hash__(self) -> int:
        return hash(self.source)

    def __reduce__(self) -> tuple[Any, ...]:
        return find_hand, (self.source,)

    @property
    def folder(self) -> Path:
        """Folder of its files."""
        return _HANDS / self.source  # an absolute path stays one

    @property
    def tips(self) -> tuple[str, ...]:
        """Links that press keys, thumb first."""
        return tuple(links[-1] for links in self.fingers.values())

    @functools.cached_property
    def spans(self) -> FloatArray:
        """(2, f, f) :attr:`Reach.nearest` and :attr:`Reach.farthest`, m."""
        return np.array([self.reach.nearest, self.reach.farthest])

    def forearm_dofs(self, names: Sequence[str] | None = None) -> tuple[str, ...]:
        """Check names of the forearm's joints; return them, by default the sliders on the keyboard.

        Raises:
            ConfigError: If one is unknown, repeated or not in order, or the slider along the
                keyboard is missing.
        """
        joints = self.forearm.joints
        if names is None:
            return tuple(name for role, name in joints.items() if role in ("along", "across"))
        refuse_unknown(names, joints.values(), "joint", "forearm_dofs")
        expected = [name for name in joints.values() if name in {*names, joints["along"]}]
        if list(names) != expected:
            raise ConfigError(
                f"forearm_dofs is {list(names)}: expected {expected}, each joint once, in the "
                f"hand's order, and {joints['along']!r}, without which it stays where it is."
            )
        return tuple(names)

    def short(self, name: str) -> str:
        """Convert a name of a compiled or single model to the short name in ``hand.yml``."""
        name = name.rpartition("/")[2]
        for prefix in self.prefix.values():
            name = name.removeprefix(prefix)
        return name.removeprefix("A_")

    def role(self, joint: str) -> Role:
        """Return the role of a joint, given its short name."""
        other: Role = "abduction" if joint in self.abduction else "finger"
        roles: dict[str, Role] = {name: role for role, name in self.forearm.joints.items()}
        return "wrist" if joint in self.wrist else roles.get(joint, other)


def find_hand(hand: str | os.PathLike[str] = DEFAULT_HAND) -> HandSpec:
    """Find a hand by its name, such as ``"shadow"``, or by the path of its folder.

    Raises:
        ConfigError: If it does not exist, or its ``hand.yml`` is damaged.
    """
    text = os.fspath(hand)
    return _read(text if text.isidentifier() else str(Path(text).resolve()))


@functools.lru_cache(maxsize=32)
def _read(source: str) -> HandSpec:
    file = _HANDS / source / SPEC_FILE  # an absolute path stays one
    if not file.is_file():
        known = sorted(found.parent.name for found in _HANDS.glob(f"*/{SPEC_FILE}"))
        raise ConfigError(
            f"hand is {source!r}, which has no {SPEC_FILE}.{near_names(source, known)} Expected "
            f"one of {', '.join(map(repr, known))}, or the path of a hand's folder."
        )
    entries = read_yaml_mapping(file)
    with naming(f"'{file}'"):
        return HandSpec(**{**entries, "source": source})
