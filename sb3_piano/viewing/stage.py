"""The stage: a scene as it is shown, with a piano around the keys and hands with rounded shapes.

It has the joints of the scene, so that joint positions of one are those of the other. All shapes
are made from numbers; none of them collides, and the scene that is simulated has none of them.
"""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np

from sb3_piano.engine import mujoco
from sb3_piano.music.hands import Hand
from sb3_piano.simulation import PianoScene
from sb3_piano.simulation.compiling import assemble_scene, scene_parts

_Vector = tuple[float, float, float]
_Ball = tuple[_Vector, float | _Vector]
"""Centre of an ellipsoid and its radius, or its three, m."""

_Shape = tuple[str, tuple[float, ...], list[_Ball]]
"""Body, colour and ellipsoids: what is shown is the hull of these."""

_BOX, _MESH = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_MESH

_SKIN, _CUFF, _SLEEVE = (0.80, 0.80, 0.82, 1.0), (0.93, 0.93, 0.95, 1.0), (0.10, 0.12, 0.20, 1.0)
_FELT, _LANE = (0.55, 0.05, 0.08, 1.0), (0.13, 0.13, 0.15, 1.0)
_INVISIBLE = (0.0, 0.0, 0.0, 0.0)

_ENDS = 0.66
"""Distance of the piano's ends from its middle, m; that of the keys' is 0.61."""

PANEL = -0.0925
"""Front of the panel above the keys, x in m: before it the notes come down."""
PANEL_FOOT, PANEL_TOP = 0.045, 0.62
"""Heights between which the panel is seen, m."""

# The least A, and with it the beginnings of octaves: a line on the panel before each C.
_FIRST_C, _OCTAVE = 3, 12
_HALF_WHITE = 0.01175

_LACQUER = "lacquer"

FIELD_OF_VIEW = 16.0
"""Angle between the lower and the upper edge of a picture, degrees: small, so that bars above the
keys are almost parallel."""

# Box, centre, half size (m): x towards the player, y to the treble, z up.
_FURNITURE: dict[str, tuple[_Vector, _Vector]] = {
    "bed": ((0.0, 0.0, -0.060), (0.125, _ENDS, 0.055)),
    "slip": ((0.094, 0.0, -0.012), (0.014, _ENDS, 0.024)),
    "panel": ((PANEL - 0.012, 0.0, 0.30), (0.012, _ENDS, 0.32)),
    "top": ((-0.16, 0.0, 0.632), (0.09, 0.68, 0.012)),
    "cheek_bass": ((0.0, -0.636, 0.018), (0.108, 0.024, 0.034)),
    "cheek_treble": ((0.0, 0.636, 0.018), (0.108, 0.024, 0.034)),
    "leg_bass": ((0.02, -0.62, -0.4), (0.03, 0.03, 0.36)),
    "leg_treble": ((0.02, 0.62, -0.4), (0.03, 0.03, 0.36)),
}


def staged(scene: PianoScene) -> PianoScene:
    """Return a scene for the eye with the joints of ``scene``; equal scenes share one."""
    return _staged(**scene.options)


@functools.lru_cache(maxsize=8)
def _staged(**options: Any) -> PianoScene:
    world, piano, *hands = scene_parts(**options)
    _light(world)
    _furnish(world, [body.pos[1] for body in piano.bodies if "_key_" in body.name])
    for side, hand in zip(options["sides"], hands, strict=True):
        _dress(hand, side)
    return assemble_scene([world, piano, *hands], options)


def _light(world: mujoco.MjSpec) -> None:
    """Dim the room, and let one lamp cast shadows."""
    world.visual.global_.fovy = FIELD_OF_VIEW
    # Boxes of fewer triangles look alike, and pictures take a fifth less time without a GPU.
    world.visual.quality.numquads = 1
    world.visual.quality.shadowsize = 768
    head = world.visual.headlight
    head.ambient, head.diffuse, head.specular = [0.28] * 3, [0.20] * 3, [0.05] * 3
    for light in list(world.lights):
        world.delete(light)
    world.worldbody.add_light(
        name="lamp",
        pos=[0.8, -0.35, 1.5],
        dir=[-0.8, 0.35, -1.5],
        cutoff=32,
        diffuse=[0.56, 0.54, 0.50],
        specular=[0.25] * 3,
    )
    world.worldbody.add_light(
        name="fill",
        pos=[0.6, 0.9, 1.2],
        dir=[-0.5, -0.7, -1.0],
        diffuse=[0.20, 0.22, 0.28],
        castshadow=False,
    )
    sky = world.texture("sky")
    sky.rgb1, sky.rgb2 = [0.10, 0.11, 0.14], [0.02, 0.02, 0.03]
    floor = world.geom("floor")
    floor.rgba, floor.pos, floor.size = [0.04, 0.04, 0.045, 1.0], [0.0, 0.0, -0.76], [4, 4, 0.05]


def _furnish(world: mujoco.MjSpec, keys: list[float]) -> None:
    """Add an upright piano around keys, given where they are along the keyboard, m."""
    world.add_material(name=_LACQUER, rgba=[0.035, 0.033, 0.037, 1.0], specular=0.6, shininess=0.7)
    for name, (centre, half) in _FURNITURE.items():
        _add_box(world, name, centre, half, material=_LACQUER)
    _add_box(world, "felt", (-0.079, 0.0, 0.0405), (0.003, 0.61, 0.0012), rgba=_FELT)
    height = (PANEL_TOP - PANEL_FOOT) / 2
    for key in keys[_FIRST_C::_OCTAVE]:
        centre = (PANEL, key - _HALF_WHITE, PANEL_FOOT + height)
        _add_box(world, f"lane_{key:.3f}", centre, (0.0007, 0.0006, height), rgba=_LANE)


def _dress(hand: mujoco.MjSpec, side: Hand) -> None:
    """Hide a hand's colliders, but for the fingertips, under rounded shapes."""
    body = {body.name.partition("_")[2]: body for body in hand.bodies[1:]}
    for name, each in body.items():
        if not name.endswith("distal"):
            for geom in each.geoms:
                geom.rgba = _INVISIBLE
    for name, color, balls in _shapes(1.0 if side == "right" else -1.0):
        mesh = hand.add_mesh(name=f"{name}_{len(hand.meshes)}", uservert=_surface(balls))
        mesh.smoothnormal = True
        body[name].add_geom(
            name=f"seen_{mesh.name}",
            type=_MESH,
            meshname=mesh.name,
            rgba=color,
            contype=0,
            conaffinity=0,
        )


def _shapes(out: float) -> list[_Shape]:
    """Return the shapes of a hand.

    Coordinates are the bodies': x to the thumb's side times ``out`` (1 for the right hand), y to
    the palm, z towards the fingertips. Bones are as long as the simulated ones.
    """
    knuckles: list[_Ball] = [
        ((x * out, 0.0, z), (0.0105, 0.0115, 0.010))
        for x, z in ((0.033, 0.093), (0.011, 0.097), (-0.011, 0.093))
    ]
    palm: list[_Ball] = [
        ((0.0, 0.0, -0.028), (0.023, 0.015, 0.012)),
        ((0.018 * out, -0.002, 0.0), (0.016, 0.015, 0.014)),
        ((-0.02 * out, 0.0, 0.004), (0.013, 0.014, 0.014)),
        ((-0.026 * out, 0.0, 0.060), (0.010, 0.012, 0.012)),
        *knuckles,
    ]
    arm: list[_Ball] = [
        ((0.0, -0.01, -0.10), (0.052, 0.045, 0.02)),
        ((0.0, -0.01, 0.060), (0.046, 0.040, 0.03)),
        ((0.0, -0.01, 0.165), (0.034, 0.028, 0.012)),
    ]
    cuff: list[_Ball] = [
        ((0.0, -0.01, 0.168), (0.036, 0.030, 0.006)),
        ((0.0, -0.01, 0.182), (0.035, 0.029, 0.006)),
    ]
    wrist: list[_Ball] = [
        ((0.0, -0.01, 0.180), (0.027, 0.020, 0.010)),
        ((0.0, -0.01, 0.213), (0.025, 0.017, 0.012)),
    ]
    metacarpal: list[_Ball] = [
        ((0.004 * out, 0.0, 0.0), (0.011, 0.0125, 0.012)),
        ((0.0, 0.0, 0.0645), (0.0105, 0.0115, 0.010)),
    ]
    thenar: list[_Ball] = [((0.0, 0.0, 0.0), 0.014), ((-0.012 * out, 0.002, 0.012), 0.010)]
    bones = [("thproximal", 0.0135, 0.038, 0.0115), ("thmiddle", 0.0112, 0.032, 0.0095)]
    for finger in ("ff", "mf", "rf", "lf"):
        bones.append((f"{finger}proximal", 0.0102, 0.045, 0.0090))
        bones.append((f"{finger}middle", 0.0090, 0.025, 0.0076))
    shapes: list[_Shape] = [
        ("forearm", _SLEEVE, arm),
        ("forearm", _CUFF, cuff),
        ("forearm", _SKIN, wrist),
        ("palm", _SKIN, palm),
        ("lfmetacarpal", _SKIN, metacarpal),
        ("thbase", _SKIN, thenar),
    ]
    for name, near, length, far in bones:
        shapes.append((name, _SKIN, [((0.0, 0.0, 0.0), near), ((0.0, 0.0, length), far)]))
    return shapes


def _surface(balls: list[_Ball]) -> list[float]:
    """Return points on ellipsoids, one coordinate after the other; MuJoCo takes their hull."""
    sphere = _sphere()
    points = [np.array(centre) + np.array(radius) * sphere for centre, radius in balls]
    return [float(value) for value in np.concatenate(points).ravel()]


@functools.cache
def _sphere(rows: int = 7) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return points on a sphere of radius 1, (n, 3), about equally far apart."""
    points = []
    for row in range(rows):
        polar = math.pi * (row + 0.5) / rows
        count = max(4, round(2 * rows * math.sin(polar)))
        for step in range(count):
            angle = 2 * math.pi * step / count
            sine = math.sin(polar)
            points.append((sine * math.cos(angle), sine * math.sin(angle), math.cos(polar)))
    return np.array(points)


def _add_box(
    world: mujoco.MjSpec,
    name: str,
    centre: _Vector,
    half: _Vector,
    rgba: tuple[float, ...] | None = None,
    material: str = "",
) -> None:
    look: dict[str, Any] = {"material": material} if rgba is None else {"rgba": rgba}
    world.worldbody.add_geom(
        name=name, type=_BOX, pos=centre, size=half, contype=0, conaffinity=0, **look
    )
