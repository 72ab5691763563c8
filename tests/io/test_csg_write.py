"""A tree written to .csg and read again is the same solid; what has no counterpart is refused with the cure."""

import numpy as np
import pytest

import surfel
from surfel.core.errors import InputError
from surfel.io.csg import read_csg, write_csg
from surfel.shapes.mesh import Mesh
from surfel.shapes.primitives.box import Box
from surfel.shapes.primitives.cylinder import Cone, Cylinder
from surfel.shapes.primitives.ellipsoid import Ellipsoid, Sphere
from surfel.shapes.primitives.half_space import HalfSpace
from surfel.shapes.tree import Difference, Intersection, Union

RNG = np.random.default_rng(8)
POINTS = RNG.uniform(-6.0, 6.0, (20_000, 3))
TURN = np.array([[0.36, 0.48, -0.8, 1.0], [-0.8, 0.6, 0.0, 0.5], [0.48, 0.64, 0.6, -1.0], [0, 0, 0, 1.0]])
SKEW = np.array([[1.0, 0.3, 0, 0.1], [0, 0.7, 0, 0], [0.2, 0, -1.4, 1 / 3], [0, 0, 0, 1.0]])
CORNER = Mesh([[0, 0, 0], [3, 0, 0], [0, 3, 0], [0, 0, 3]], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])

TREES = {
    "box": Box((1.0, 2.0, 1 / 3)),
    "cube turned": Box(3).transformed(TURN),
    "sphere skewed": Sphere(2).transformed(SKEW),
    "ellipsoid": Ellipsoid((1, 2, 3)).transformed(TURN),
    "cylinder": Cylinder(1.1, 4),
    "cone": Cone(2, 0, 4).transformed(TURN),
    "frustum": Cone(0.5, 2, 4),
    "mesh": CORNER,
    "mesh turned inside out": Mesh(CORNER.vertices, CORNER.triangles[:, ::-1]),
    "tree": (Box(5) - Sphere(3)) | (Cylinder(1, 9) & Box(7).transformed(TURN)),
    "deep": Difference(Box(9), Difference(Box(7), Difference(Box(5), Sphere(3)))),
    "half-space": Sphere(4) & HalfSpace((1, 1, 0.2), 1.0),
    "half-space taken away": Sphere(4) - HalfSpace((0, 0, 2), 1.0).transformed(SKEW),
    "half-space far off": Sphere(4) - HalfSpace((0, 0, 1), -9.0),
    "half-space round all": Sphere(4) & HalfSpace((0, 0, 1), 9.0),
    "half-spaces alone": Intersection(*(HalfSpace(s * row, 2.0) for row in TURN[:3, :3] for s in (1, -1))),
    "wedge": Difference(Union(Box(3), Sphere(1.9)), HalfSpace((1, 0, 0), 0), HalfSpace((0, 1, 1), 0)),
    "empty": Union(),
}


@pytest.mark.parametrize("name", list(TREES))
def test_the_same_solid_comes_back(tmp_path, name):
    write_csg(tmp_path / "part.csg", TREES[name])
    again = read_csg(tmp_path / "part.csg")
    assert (again.contains(POINTS) == TREES[name].contains(POINTS)).all()


def test_numbers_come_back_to_the_last_bit(tmp_path):
    tree = Sphere(1 / 3).transformed(TURN) - Cylinder(0.1, 1e-7)
    write_csg(tmp_path / "part.csg", tree)
    again = read_csg(tmp_path / "part.csg")
    assert again.leaves[0].shape.radius == 1 / 3 and (again.leaves[0].matrix == TURN).all()
    assert again.leaves[1].height == 1e-7


def test_faces_of_a_mesh_are_clockwise_seen_from_outside(tmp_path):
    for name in ("mesh", "mesh turned inside out"):
        write_csg(tmp_path / "part.csg", TREES[name])
        again = read_csg(tmp_path / "part.csg")
        assert not again.inverted and again.volume == TREES[name].volume


def test_a_shape_used_twice_is_written_twice(tmp_path):
    box = Box(3)
    write_csg(tmp_path / "part.csg", (box - Sphere(1)) | (box & Sphere(1)))
    assert (tmp_path / "part.csg").read_text().count("cube(") == 2


def test_a_deep_tree_is_written_without_recursion(tmp_path):
    tree = Box(3)
    for k in range(1500):
        tree = Difference(Box(4), tree) if k % 2 else Union(tree, Sphere(1))
    write_csg(tmp_path / "part.csg", tree)
    assert len(read_csg(tmp_path / "part.csg").leaves) == 1501


@pytest.mark.parametrize(
    ("shape", "match"),
    [
        (surfel.Surfels(RNG.standard_normal((10, 3))), "import"),
        (Box(1) - HalfSpace((0, 0, 1), 0) | HalfSpace((1, 0, 0), 0), "unbounded"),
        (HalfSpace((0, 0, 1), 0), "unbounded"),
        (np.eye(3), "a tree of solids"),
    ],
)
def test_what_cannot_be_written_is_refused_and_nothing_is_left(tmp_path, shape, match):
    with pytest.raises(InputError, match=match):
        write_csg(tmp_path / "part.csg", shape)
    assert list(tmp_path.iterdir()) == []
