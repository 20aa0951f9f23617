"""The stage: a scene for pictures, with a piano around the keys and rounded hands.

It has the joints of the scene, so that joint positions fit both. All shapes are generated from
numbers. None of them collides, and the simulated scene has none of them.
"""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np

from sb3_piano.arrays import FloatArray
from sb3_piano.engine import mujoco
from sb3_piano.hands import HandSpec, find_hand
from sb3_piano.hands.spec import Ball
from sb3_piano.music.hands import Hand
from sb3_piano.simulation import PianoScene
from sb3_piano.simulation.compiling import assemble_scene, scene_parts

_Vector = tuple[float, float, float]
_BOX, _MESH = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_MESH

_FELT, _LANE = (0.55, 0.05, 0.08, 1.0), (0.13, 0.13, 0.15, 1.0)
_INVISIBLE = (0.0, 0.0, 0.0, 0.0)

_ENDS = 0.66
"""Distance of the piano's ends from its middle, m; for the keys it is 0.61."""

PANEL = -0.0925
"""Front of the panel above the keys, x in m; notes fall in front of it."""
PANEL_FOOT, PANEL_TOP = 0.045, 0.62
"""Lower and upper edge of the visible panel, m."""

# The keys start at A: the panel has a line before each C, where octaves begin.
_FIRST_C, _OCTAVE = 3, 12
_HALF_WHITE = 0.01175
"""Half the width of a white key, m."""
_LANES = range(_FIRST_C, 88, _OCTAVE)
"""Keys at whose left edge an octave begins."""
_FAR_END, _FELT_TOP = (-0.075, 0.0, 0.0225), (-0.082, 0.0, 0.0417)
"""Far end of a key, and the felt behind the keys, on which notes fall in pictures, m."""

_LACQUER = "lacquer"

_ROWS, _FEW_ROWS, _WIDE = 7, 5, 0.016
"""Rows of points on the ellipsoids of hands, on those of fingers, and the radius between, m."""
_LARGER = 1.05
"""Size of the links before the fingertips, times that of others."""

KEYS, HANDS, FURNITURE, HIDDEN = 0, 1, 2, 5
"""Groups of geoms: keys with the felt behind them, hands, all else, and what no picture shows."""

FIELD_OF_VIEW = 16.0
"""Vertical field of view of a picture, degrees: small, so that bars above the keys are almost
parallel."""

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
    """Return the stage of a scene, with the same joints; equal scenes share one."""
    return _staged(**scene.options)


@functools.lru_cache(maxsize=8)
def _staged(**options: Any) -> PianoScene:
    world, piano, *hands = scene_parts(**options)
    _light(world)
    _furnish(world, [body.pos[1] for body in piano.bodies if "_key_" in body.name])
    for side, hand in zip(options["sides"], hands, strict=True):
        _dress(hand, find_hand(options["hand"]), side)
        for geom in hand.geoms:
            geom.group = HANDS
    return assemble_scene([world, piano, *hands], options)


def sheet_points(key_y: FloatArray) -> FloatArray:
    """Return the places, (n, 3) m, of the felt, the keys' far ends, and the lanes' left ends."""
    points = np.array([_FELT_TOP, *[_FAR_END] * (len(key_y) + len(_LANES))])
    points[1:, 1] = [*key_y, *(key_y[list(_LANES)] - _HALF_WHITE)]
    return points


def _light(world: mujoco.MjSpec) -> None:
    """Dim the room, and add one lamp that casts shadows."""
    world.visual.global_.fovy = FIELD_OF_VIEW
    # Shapes with fewer triangles look the same, and take less time without a GPU.
    quality = world.visual.quality
    quality.numquads, quality.numslices, quality.numstacks = 1, 12, 4
    head = world.visual.headlight
    head.ambient, head.diffuse, head.specular = [0.28] * 3, [0.34] * 3, [0.05] * 3
    for light in list(world.lights):
        world.delete(light)
    world.worldbody.add_light(
        name="lamp",
        pos=[0.8, -0.35, 1.5],
        dir=[-0.8, 0.35, -1.5],
        cutoff=32,
        diffuse=[0.44, 0.42, 0.38],
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
    floor.group = FURNITURE


def _furnish(world: mujoco.MjSpec, keys: list[float]) -> None:
    """Add an upright piano around keys at given positions along the keyboard, m."""
    world.add_material(name=_LACQUER, rgba=[0.035, 0.033, 0.037, 1.0], specular=0.6, shininess=0.7)
    for name, (centre, half) in _FURNITURE.items():
        _add_box(world, name, centre, half, material=_LACQUER)
    _add_box(world, "felt", (-0.079, 0.0, 0.0405), (0.003, 0.61, 0.0012), rgba=_FELT, group=KEYS)
    height = (PANEL_TOP - PANEL_FOOT) / 2
    for key in (keys[lane] for lane in _LANES):
        centre = (PANEL, key - _HALF_WHITE, PANEL_FOOT + height)
        half = (0.0007, 0.0006, height)
        _add_box(world, f"lane_{key:.3f}", centre, half, rgba=_LANE)


def _dress(hand: mujoco.MjSpec, spec: HandSpec, side: Hand) -> None:
    """Hide a hand's colliders, except the fingertips, under its rounded shapes, if it has any."""
    if not spec.look:
        return
    body = {spec.short(body.name): body for body in hand.bodies[1:]}
    for name, each in body.items():
        if name not in spec.tips:
            for geom in each.geoms:
                geom.rgba = _INVISIBLE
    mirror = np.ones(3)
    mirror["xyz".index(spec.mirror)] = 1.0 if side == "right" else -1.0
    before_tips = {spec.short(body[tip].parent.name) for tip in spec.tips}
    for shape in spec.look:
        # Two links share a ball at their joint: the larger one is seen whole.
        size = mirror * (_LARGER if shape.link in before_tips else 1.0)
        surface = [point for ball in shape.balls for point in _surface(ball, mirror, size)]
        mesh = hand.add_mesh(name=f"{shape.link}_{len(hand.meshes)}", uservert=surface)
        mesh.smoothnormal = True
        body[shape.link].add_geom(
            name=f"seen_{mesh.name}",
            type=_MESH,
            meshname=mesh.name,
            rgba=shape.color,
            contype=0,
            conaffinity=0,
        )


def _surface(ball: Ball, mirror: FloatArray, size: FloatArray) -> list[float]:
    """Return points on an ellipsoid as a flat list of coordinates; MuJoCo computes their hull."""
    rows = _ROWS if max(ball.radii) > _WIDE else _FEW_ROWS
    points = mirror * np.array(ball.centre) + size * np.array(ball.radii) * _sphere(rows)
    return [float(value) for value in points.ravel()]


@functools.cache
def _sphere(rows: int) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return nearly equidistant points on a sphere of radius 1, (n, 3)."""
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
    group: int = FURNITURE,
) -> None:
    look: dict[str, Any] = {"material": material} if rgba is None else {"rgba": rgba}
    look |= {"contype": 0, "conaffinity": 0, "group": group}
    world.worldbody.add_geom(name=name, type=_BOX, pos=centre, size=half, **look)
