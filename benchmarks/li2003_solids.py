"""The solids of Li, Wang, Martin and Bowyer (2003), with their areas in closed form.

The dimensions of "L +- cylinder" and of the "gate" stood in figures that are lost. Both are made up here: the L so that
its area is the paper's 1557.08 and its bounding sphere the paper's 179.07 at a tenth of the scale (a sphere of radius
179.07 round a solid of area 1557 would hold next to nothing: the paper's two figures are of different scales).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import surfel
from surfel.lines.enclosing import Ball
from surfel.measuring.baselines.random_lines import enclosing_ball
from surfel.shapes.base import Shape

PAPER_RADIUS = 18.849
L_RADIUS = 17.907
L_AREA = 1557.08

_WALL, _LONG, _TALL = 4.0, 23.0, 20.0  # of the L: thickness, length of the foot, height of the wall
_HOLE, _BOSS, _REACH = 3.5, 3.0, 8.0  # radius of the hole, radius and length of the boss


@dataclass(frozen=True)
class Known:
    """A solid, its area, and the ball that lines are cast through."""

    name: str
    make: Callable[[], Shape]
    area: float
    radius: float | None = None

    def ball(self, shape: Shape) -> Ball:
        """Return the paper's reference sphere about the middle of the bounds, or one of its proportions."""
        if self.radius is None:
            return enclosing_ball(shape)
        return Ball(np.asarray(shape.bounds).mean(axis=0), self.radius)


def depth_of_l() -> float:
    """Return the depth of the L that gives it the paper's area; see :func:`area_of_l`."""
    return (L_AREA - area_of_l(0.0)) / (2.0 * (_LONG + _TALL))


def area_of_l(depth: float) -> float:
    """Return the area of the L: its profile twice, its outline times the depth, the hole's and the boss's sides.

    The hole takes two disks away and adds its wall; the boss hides a disk and shows one, and adds its side.
    """
    profile = _WALL * (_LONG + _TALL - _WALL)
    hole = 2.0 * math.pi * _HOLE * (_WALL - _HOLE)
    boss = 2.0 * math.pi * _BOSS * _REACH
    return 2.0 * profile + 2.0 * (_LONG + _TALL) * depth + hole + boss


def l_and_cylinders() -> Shape:
    """Return a foot and a wall, a hole through the foot, a boss on the wall."""
    depth = depth_of_l()
    foot = surfel.Box((_LONG, depth, _WALL)).translated((0.5 * _LONG, 0.0, 0.5 * _WALL))
    wall = surfel.Box((_WALL, depth, _TALL)).translated((0.5 * _WALL, 0.0, 0.5 * _TALL))
    hole = surfel.Cylinder(_HOLE, 2.0 * _WALL).translated((15.0, 0.0, 0.5 * _WALL))
    boss = surfel.Cylinder(_BOSS, _REACH).rotated((0, 1, 0), 90.0).translated((_WALL + 0.5 * _REACH, 0.0, 14.0))
    return (foot | wall | boss) - hole


def gate() -> Shape:
    """Return a wall with an arched passage, and two round towers with pointed roofs on it."""
    arch = surfel.Cylinder(4, 7).rotated((1, 0, 0), 90.0).translated((0, 0, 6))
    body = surfel.Box((20, 5, 16)).translated((0, 0, 8)) - (surfel.Box((8, 7, 8)).translated((0, 0, 2)) | arch)
    for x in (-7, 7):
        body = body | surfel.Cylinder(2, 5).translated((x, 0, 18.5)) | surfel.Cone(2, 0, 3).translated((x, 0, 22.5))
    return body


def area_of_gate() -> float:
    """Return its area: two fronts less the arch, two ends, the top, the bottom, the passage; the towers and roofs."""
    arch = 8.0 * 6.0 + 0.5 * math.pi * 16.0
    wall = 2.0 * (20.0 * 16.0 - arch) + 2.0 * 5.0 * 16.0 + 20.0 * 5.0 + 12.0 * 5.0 + 5.0 * (12.0 + 4.0 * math.pi)
    tower = 2.0 * math.pi * 2.0 * 5.0 + math.pi * 2.0 * math.hypot(2.0, 3.0) - math.pi * 4.0
    return wall + 2.0 * tower


def area_of_skeleton() -> float:
    """Return the area of Box(20) - Sphere(13): six faces less disks, and the sphere less six caps."""
    disk = math.pi * (13.0**2 - 10.0**2)
    cap = 2.0 * math.pi * 13.0 * 3.0
    return 6.0 * (400.0 - disk) + 4.0 * math.pi * 13.0**2 - 6.0 * cap


CUBE = Known("cube", lambda: surfel.Box(20), 2400.0, PAPER_RADIUS)
SPHERE = Known("sphere", lambda: surfel.Sphere(10), 400.0 * math.pi, PAPER_RADIUS)
CYLINDER = Known("cylinder", lambda: surfel.Cylinder(10, 20), 600.0 * math.pi, PAPER_RADIUS)
L = Known("L ± cylinder", l_and_cylinders, L_AREA, L_RADIUS)
SKELETON = Known("skeleton", lambda: surfel.Box(20) - surfel.Sphere(13), area_of_skeleton(), PAPER_RADIUS)
GATE = Known("gate", gate, area_of_gate())
SPHERE_20 = Known("sphere of radius 20", lambda: surfel.Sphere(20), 1600.0 * math.pi)
"""Only in Tables 2 and 3."""

SOLIDS = (CUBE, SPHERE, CYLINDER, L, SKELETON, GATE)
