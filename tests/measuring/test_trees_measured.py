"""Trees against closed forms and against manifold3d: regularised Booleans, sheets, clouds, axioms, refusals."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import surfel
from surfel import Box, Cylinder, Difference, HalfSpace, Intersection, Sphere, Union

PI = np.pi
CUBE = Box(2)


def close(estimate, truth, size=None):
    """Tell whether an estimate is within four of its errors, and not so vague that this says nothing."""
    scale = truth if size is None else size
    assert abs(estimate.value - truth) <= 4.0 * estimate.standard_error + 1e-9 * scale
    assert estimate.standard_error < 0.02 * scale


def shifted(x, y=0.0, z=0.0, shape=CUBE):
    return shape.translated((x, y, z))


TOUCHING = {
    "shared face": (CUBE | shifted(2), 40.0, 16.0),
    "shared face, three": (CUBE | shifted(2) | shifted(4), 56.0, 24.0),
    "part of a face": (CUBE | Box((2, 1, 1)).translated((2, 0, 0)), 24.0 + 8.0, 10.0),
    "nested on a face": (CUBE - Box((1, 1, 1)).translated((0.5, 0, 0)), 24.0 + 4.0, 7.0),
    "equal boxes": (CUBE | Box(2), 24.0, 8.0),
    "equal boxes, shared part": (CUBE & Box(2), 24.0, 8.0),
    "equal spheres, turned": (Sphere(1) | Sphere(1).rotated((1, 2, 3), 50), 4 * PI, 4 / 3 * PI),
    "spheres that touch": (Sphere(1) | shifted(2, shape=Sphere(1)), 8 * PI, 8 / 3 * PI),
    "a plug in its hole": ((Box((4, 4, 2)) - Cylinder(1, 4)) | Cylinder(1, 2), 64.0, 32.0),
    "a plane along a face": (CUBE & HalfSpace((0, 0, 1), 1), 24.0, 8.0),
    "a plane along a face, cut there": (CUBE - HalfSpace((0, 0, 1), -1), 24.0, 8.0),
    "half": (CUBE & HalfSpace((1, 0, 0), 0), 16.0, 4.0),
    "one object twice": ((CUBE | Sphere(0.5)) - Union(shifted(9)), 24.0, 8.0),
}


@pytest.mark.parametrize("method", ["patches", "lines"])
@pytest.mark.parametrize("name", TOUCHING)
def test_coincident_faces_are_those_of_the_regularised_solid(name, method):
    tree, area, volume = TOUCHING[name]
    m = surfel.measure(tree, method=method, lines=32_768)
    close(m.area, area)
    close(m.volume, volume)
    assert m.closed
    assert sum(float(part.value) for part in m.areas) == pytest.approx(float(m.area.value), rel=1e-9)


@pytest.mark.parametrize(
    "tree",
    [
        CUBE - CUBE,
        CUBE - Box(2),
        Sphere(1) - Sphere(1).rotated((0, 1, 0), 33),
        CUBE & shifted(2),
        CUBE & shifted(5),
        Union(),
        CUBE - Box(3),
    ],
    ids=["itself", "an equal one", "a turned one", "touching", "apart", "of nothing", "swallowed"],
)
def test_what_is_empty_has_no_area_and_is_no_error(tree):
    for method in ("patches", "lines"):
        m = surfel.measure(tree, method=method, lines=4096)
        assert abs(m.area.value) < 1e-12
        assert abs(m.volume.value) < 1e-12


def test_a_mesh_and_a_box_share_faces():
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    mesh = surfel.Mesh(corners, [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    for method in ("patches", "lines"):
        close(surfel.measure(mesh | shifted(2), method=method).area, 40.0)
        close(surfel.measure(mesh - Box((1, 1, 1)).translated((0.5, 0, 0)), method=method).volume, 7.0)
        assert abs(surfel.measure(mesh - CUBE, method=method).area.value) < 1e-9


def test_a_tetrahedron_of_four_planes_is_bounded():
    planes = [(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)]
    solid = Intersection(*(HalfSpace(normal, 1.0) for normal in planes))
    edge = 2.0 * np.sqrt(2.0)
    m = surfel.measure(solid)
    close(m.area, np.sqrt(3.0) * edge**2)
    close(m.volume, edge**3 / (6.0 * np.sqrt(2.0)))


@pytest.mark.parametrize(
    "tree",
    [
        HalfSpace((0, 0, 1), 0),
        CUBE | HalfSpace((0, 0, 1), 0),
        HalfSpace((0, 0, 1), 0) - CUBE,
        surfel.Quadric(np.diag([1.0, 1.0, 0.0, -1.0])),
    ],
)
def test_an_unbounded_tree_is_refused_with_the_cure(tree):
    with pytest.raises(surfel.InputError, match=r"no end along .* intersect it with a bounded shape"):
        surfel.measure(tree)


def cloud_of_a_ball(n=20_000, seed=0):
    rng = np.random.default_rng(seed)
    points = rng.standard_normal((n, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


BALL = surfel.Surfels(cloud_of_a_ball())
BOWL = surfel.Surfels(cloud_of_a_ball(seed=1) * [1, 1, -1])[np.flatnonzero(cloud_of_a_ball(seed=1)[:, 2] > 0)]


@pytest.mark.parametrize("method", ["patches", "lines"])
def test_a_scan_is_a_leaf_like_any_other(method):
    half = np.sqrt(1 - 0.3**2)
    m = surfel.measure(BALL - Cylinder(0.3, 4), method=method)
    close(m.area, 4 * PI * half + 4 * PI * 0.3 * half)
    close(m.areas[1], 4 * PI * 0.3 * half)
    close(m.volume, 4 / 3 * PI * half**3)
    close(surfel.measure(BALL & HalfSpace((0, 0, 1), 0.2), method=method).area, 2 * PI * 1.2 + PI * (1 - 0.04))
    close(surfel.measure(CUBE - BALL, method=method).volume, 8 - 4 / 3 * PI)
    two = BALL | surfel.Surfels(cloud_of_a_ball(seed=5)).translated((1, 0, 0))
    close(surfel.measure(two, method=method).volume, 8 / 3 * PI - PI * 5 / 12)


@pytest.mark.parametrize("method", ["patches", "lines"])
def test_sheets_in_trees(method):
    rod = Cylinder(0.5, 4)
    cap = 2 * PI * (1 - np.sqrt(0.75))
    inside = surfel.measure(BOWL & rod, method=method)
    close(inside.area, cap)
    assert inside.volume is None and not inside.closed
    close(surfel.measure(BOWL - rod, method=method).area, 2 * PI - cap)
    both = surfel.measure(BOWL | rod, method=method)
    close(both.area, 2 * PI + 2 * PI * 0.5 * 4 + 0.5 * PI)
    close(both.volume, PI)
    plane = surfel.Mesh([[-3, -3, 0], [3, -3, 0], [3, 3, 0], [-3, 3, 0]], [[0, 1, 2], [0, 2, 3]])
    close(surfel.measure(plane & Sphere(1), method=method).area, PI)
    close(surfel.measure((plane & Sphere(2)) - Sphere(1), method=method).area, 3 * PI)


def test_a_sheet_cannot_be_subtracted_nor_two_be_intersected():
    with pytest.raises(surfel.InputError, match="cannot be subtracted"):
        surfel.measure(CUBE - BOWL)
    with pytest.raises(surfel.InputError, match="cannot be subtracted"):
        surfel.measure(Box(9) - (CUBE - (Sphere(1) | BOWL)))
    with pytest.raises(surfel.InputError, match="two sheets"):
        surfel.measure(BOWL & surfel.Surfels(BOWL.points + 0.1, solid=False))
    with pytest.raises(surfel.InputError, match="takes shapes"):
        Union(CUBE, [[1, 2, 3]])
    with pytest.raises(TypeError):
        CUBE | 3


numbers = st.integers(0, 10_000)


@settings(max_examples=15, deadline=None)
@given(numbers)
def test_axioms(number):
    rng = np.random.default_rng(number)
    a = Sphere(rng.uniform(0.5, 1)).translated(rng.uniform(-0.5, 0.5, 3))
    b = Box(tuple(rng.uniform(0.6, 1.6, 3))).rotated(rng.standard_normal(3), rng.uniform(0, 90))
    space = Box(6)

    def volume(tree):
        return surfel.measure(tree, lines=8192).volume

    def area(tree):
        return surfel.measure(tree, lines=8192).area

    def same(one, other):
        error = np.hypot(one.standard_error, other.standard_error)
        assert abs(one.value - other.value) <= 5.0 * error + 1e-6

    one, other = volume(a | b), volume(a & b)
    total = a.shape.volume + b.shape.volume
    error = np.hypot(one.standard_error, other.standard_error)
    assert abs(one.value + other.value - total) <= 5.0 * error  # inclusion and exclusion
    same(area(space - (a | b)), area((space - a) & (space - b)))  # De Morgan
    same(area(space - (a & b)), area((space - a) | (space - b)))
    turn = (rng.standard_normal(3), 70.0)
    same(area(a - b), area((a - b).rotated(*turn).translated((3, -1, 2))))
    same(area(a - b), area((a - b).mirrored((1, 2, 0.5))))
    bigger = area((a - b).scaled(2.0))
    same(area(a - b), surfel.Estimate(bigger.value / 4.0, bigger.standard_error / 4.0))


def test_an_affine_image_of_a_tree():
    egg = (Sphere(1) & HalfSpace((0, 0, 1), 0)).scaled((1, 2, 3))
    half = 0.5 * surfel.Ellipsoid((1, 2, 3)).area + 2 * PI
    for method in ("patches", "lines"):
        m = surfel.measure(egg, method=method)
        close(m.area, half)
        close(m.volume, 4 * PI)


def test_the_bits_do_not_depend_on_threads():
    from surfel._numba import threads_for

    tree = Union(*(Sphere(0.3).translated((0.4 * k, 0, 0)) for k in range(9))) - Cylinder(0.1, 9)
    results = []
    for threads in (1, 2):
        with threads_for(10**9, threads):
            m = surfel.measure(tree, method="lines", lines=16_384)
            results.append((m.area.value, m.volume.value, surfel.measure(tree, lines=16_384).area.value))
    assert results[0] == results[1]


def test_very_deep_and_shared_expressions():
    tree = CUBE
    for k in range(10_000):
        tree = (tree | shifted(0.0)) if k % 2 else tree - shifted(50.0 + k)
    assert len(tree.leaves) == 10_001
    assert tree.contains([[0.0, 0.0, 0.0]])[0]
    shared = CUBE | Sphere(1.2)
    for _ in range(40):
        shared = shared | shared
    assert len(shared.leaves) == 2
    drilled = CUBE
    for k in range(300):
        drilled = drilled - Cylinder(0.01, 4).translated((0.005 * k - 0.75, 0, 0))
    assert type(drilled) is Difference and len(drilled.leaves) == 301
    again = pickle.loads(pickle.dumps(CUBE - Sphere(1.2)))
    close(surfel.measure(again, lines=16_384).volume, float(surfel.measure(CUBE - Sphere(1.2)).volume.value))


def test_points_are_drawn_from_what_the_tree_keeps():
    tree = CUBE - Sphere(1.2)
    for kind in ("random", "blue"):
        points, normals, leaf = surfel.sample(tree, 3000, kind=kind)
        radius, largest = np.linalg.norm(points, axis=1), np.abs(points).max(axis=1)
        assert np.abs(radius[leaf == 1] - 1.2).max() < 1e-12 and np.abs(largest[leaf == 0] - 1.0).max() < 1e-12
        assert (np.einsum("ij,ij->i", points, normals)[leaf == 1] < 0.0).all()  # out of the solid, into the hole
        share = float(surfel.measure(tree).areas[0].value) / float(surfel.measure(tree).area.value)
        assert abs((leaf == 0).mean() - share) < 4.0 * np.sqrt(share * (1 - share) / 3000)


def _against_manifold(number):
    manifold = pytest.importorskip("manifold3d")
    rng = np.random.default_rng((77, number))

    def leaf():
        place = rng.uniform(-0.6, 0.6, 3)
        if rng.random() < 0.5:
            size = tuple(rng.uniform(0.4, 1.4, 3))
            return Box(size).translated(place), manifold.Manifold.cube(size, True).translate(tuple(place))
        ball = manifold.Manifold.sphere(rng.uniform(0.3, 0.8), 24).translate(tuple(place))
        mesh = ball.to_mesh()
        return surfel.Mesh(mesh.vert_properties[:, :3].astype(float), mesh.tri_verts), ball

    tree, theirs = leaf()
    for _ in range(int(rng.integers(1, 5))):
        other, other_theirs = leaf()
        pick = rng.integers(3)
        tree = (tree | other, tree & other, tree - other)[pick]
        theirs = (theirs + other_theirs, theirs ^ other_theirs, theirs - other_theirs)[pick]
    m = surfel.measure(tree, lines=16_384)
    if theirs.is_empty() or theirs.volume() < 1e-4:
        assert m.volume.value < 1e-3
        return 0.0, 0.0
    size = float(np.abs(tree.bounds).max())
    rounding = 1e-5 * size**2  # their vertices are kept in single precision
    return (
        abs(m.area.value - theirs.surface_area()) / (m.area.standard_error + rounding),
        abs(m.volume.value - theirs.volume()) / (m.volume.standard_error + rounding),
    )


def test_random_trees_of_boxes_and_meshes_agree_with_manifold3d():
    off = np.array([_against_manifold(number) for number in range(40)])
    assert off.max() < 6.0
    assert (off < 2.2).mean() > 0.9


@pytest.mark.slow
def test_a_thousand_random_trees_agree_with_manifold3d():
    off = np.array([_against_manifold(number) for number in range(1000)])
    assert off.max() < 8.0
    assert (off < 2.2).mean() > 0.92
