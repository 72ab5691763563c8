"""A .csg file gives the tree that OpenSCAD means: sizes, places, emptiness, modifiers, facets, imports."""

import math

import numpy as np
import pytest

import surfel
from surfel.core.errors import FileFormatError, InputError
from surfel.io import csg_build
from surfel.io.csg import read_csg
from surfel.shapes.mesh import Mesh
from surfel.shapes.tree import Difference, Intersection, Tree, Union

RNG = np.random.default_rng(5)
POINTS = RNG.uniform(-12.0, 12.0, (4000, 3))
X, Y, Z = POINTS.T


@pytest.fixture
def reading(tmp_path):
    def read(text, **options):
        path = tmp_path / "part.csg"
        path.write_text(text)
        return read_csg(path, **options)

    return read


def inside(shape):
    return shape.contains(POINTS)


def in_box(low, high):
    return ((low < POINTS) & (high > POINTS)).all(axis=1)


SOLIDS = {
    "cube(size = [4, 6, 8], center = true);": in_box([-2, -3, -4], [2, 3, 4]),
    "cube(size = [4, 6, 8], center = false);": in_box([0, 0, 0], [4, 6, 8]),
    "cube([4, 6, 8]);": in_box([0, 0, 0], [4, 6, 8]),
    "cube(4, true);": in_box([-2, -2, -2], [2, 2, 2]),
    "cube();": in_box([0, 0, 0], [1, 1, 1]),
    "sphere($fn = 0, $fa = 12, $fs = 2, r = 7);": X**2 + Y**2 + Z**2 < 49,
    "sphere(7);": X**2 + Y**2 + Z**2 < 49,
    "sphere(d = 14, r = 3);": X**2 + Y**2 + Z**2 < 49,
    "cylinder($fn=0, $fa=12, $fs=2, h = 9, r1 = 5, r2 = 5, center = false);": (X**2 + Y**2 < 25) & (Z > 0) & (Z < 9),
    "cylinder(h = 9, r = 5, center = true);": (X**2 + Y**2 < 25) & (abs(Z) < 4.5),
    "cylinder(9, 5, 2);": (X**2 + Y**2 < (5 - Z / 3) ** 2) & (Z > 0) & (Z < 9),
    "cylinder(h = 9, d1 = 10, d2 = 0);": (X**2 + Y**2 < (5 * (1 - Z / 9)) ** 2) & (Z > 0) & (Z < 9),
    "multmatrix([[1,0,0,3],[0,1,0,-2],[0,0,1,1],[0,0,0,1]]) cube(4);": in_box([3, -2, 1], [7, 2, 5]),
    "multmatrix([[0,-1,0,0],[1,0,0,0],[0,0,1,0]]) { cube([4, 6, 8]); }": in_box([-6, 0, 0], [0, 4, 8]),
    "multmatrix([[1,0,0,5],[0,1,0,0],[0,0,1,0]]) multmatrix([[2,0,0,0],[0,2,0,0],[0,0,2,0]]) cube(2);": in_box(
        [5, 0, 0], [9, 4, 4]
    ),
    "multmatrix([[2,0,0,2],[0,2,0,0],[0,0,2,0],[0,0,0,2]]) cube(4);": in_box([1, 0, 0], [5, 4, 4]),
    "multmatrix([[2,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]) sphere(r = 4);": X**2 / 64 + Y**2 / 16 + Z**2 / 16 < 1,
    "cube(4); multmatrix([[1,0,0,-4],[0,1,0,0],[0,0,1,0],[0,0,0,1]]) cube(4);": in_box([-4, 0, 0], [4, 4, 4]),
    "color([1, 0, 0, 0.5]) { render(convexity = 2) { group() { cube(4); } } }": in_box([0, 0, 0], [4, 4, 4]),
    'color("red") cube(4);': in_box([0, 0, 0], [4, 4, 4]),
    "difference() { sphere(9); cube(6, true); sphere(r = 3.5); }": (
        (X**2 + Y**2 + Z**2 < 81) & ~in_box([-3, -3, -3], [3, 3, 3]) & (X**2 + Y**2 + Z**2 > 3.5**2)
    ),
    "intersection() { sphere(9); cube(12, true); cube(10); }": (X**2 + Y**2 + Z**2 < 81) & in_box([0, 0, 0], [6, 6, 6]),
    "union() { cube(3); /* a } comment */ // and { another\n sphere(r = +2.5e0); }": (
        in_box([0, 0, 0], [3, 3, 3]) | (X**2 + Y**2 + Z**2 < 6.25)
    ),
    "polyhedron(points = [[0,0,0],[9,0,0],[0,9,0],[0,0,9]], faces = [[0,1,2],[0,3,1],[0,2,3],[1,3,2]]);": (
        (X > 0) & (Y > 0) & (Z > 0) & (X + Y + Z < 9)
    ),
    "#cube(4);": in_box([0, 0, 0], [4, 4, 4]),
    "cube(4); %sphere(9); *sphere(11);": in_box([0, 0, 0], [4, 4, 4]),
    "*hull() { minkowski() { cube(9); } } cube(4);": in_box([0, 0, 0], [4, 4, 4]),
    "difference() { %cube(9); cube(4); sphere(2); }": in_box([0, 0, 0], [4, 4, 4]) & (X**2 + Y**2 + Z**2 > 4),
    "sphere(11); multmatrix([[5,0,0,0],[0,1,0,0],[0,0,1,0]]) { !cube(4); sphere(9); }": in_box([0, 0, 0], [4, 4, 4]),
    "group(); union() { } cube(4); group() { group(); }": in_box([0, 0, 0], [4, 4, 4]),
    "difference() { cube(4); group(); }": in_box([0, 0, 0], [4, 4, 4]),
}


@pytest.mark.parametrize("text", list(SOLIDS))
def test_holds_the_points_that_it_should(reading, text):
    expected = SOLIDS[text]
    assert (inside(reading(text)) == expected).all()


@pytest.mark.parametrize(
    "text",
    [
        "group();",
        "union() { }",
        "difference() { group(); cube(4); }",
        "intersection() { cube(4); group(); }",
        "intersection() { cube(4); difference() { group() {} cube(1); } }",
        "cube(0);",
        "cube([1, 0, 1]);",
        "sphere(r = 0);",
        "cylinder(h = 0, r = 1);",
        "cylinder(h = 1, r1 = 0, r2 = 0);",
        "multmatrix([[1,0,0,0],[0,1,0,0],[0,0,0,0],[0,0,0,1]]) cube(4);",
        "polyhedron(points = [], faces = []);",
        "%cube(3);",
        "difference() { union() { *cube(4); } sphere(1); }",
    ],
)
def test_what_is_empty_is_the_empty_union(reading, text):
    shape = reading(text)
    assert isinstance(shape, Union) and shape.leaves == () and not inside(shape).any()


def test_nested_operations_become_one_tree_without_changing_it(reading):
    text = "union() { union() { cube(1); cube(2); } group() { cube(3); } }"
    assert len(reading(text).children) == 3
    assert len(reading("difference() { difference() { cube(9); cube(1); } cube(2); }").children) == 3
    assert isinstance(reading("intersection() { cube(9); intersection() { cube(1); cube(2); } }"), Intersection)
    kept = reading("difference() { cube(9); difference() { cube(2); cube(1); } }")
    assert isinstance(kept, Difference) and isinstance(kept.children[1], Difference)


def test_few_facets_are_meant_and_many_are_a_circle(reading):
    nut = reading("cylinder($fn = 6, h = 2, r = 1, center = true);")
    assert isinstance(nut, Mesh) and nut.closed and not nut.inverted
    assert nut.volume == pytest.approx(2.0 * 1.5 * math.sqrt(3.0))
    assert not isinstance(reading("cylinder($fn = 100, h = 2, r = 1);"), Mesh)
    assert not isinstance(reading("cylinder($fn = 6, h = 2, r = 1);", facets="exact"), Mesh)
    assert isinstance(reading("$fn = 6; cylinder(h = 2, r = 1, center = true);"), Mesh)
    assert isinstance(reading("union($fn = 6) { cylinder(h = 2, r = 1, center = true); }"), Mesh)
    assert not isinstance(reading("union() { $fn = 6; } cylinder(h = 2, r = 1, center = true);"), Mesh)


@pytest.mark.parametrize(
    ("text", "vertices", "area"),
    [
        ("sphere(r = 10, $fn = 0, $fa = 12, $fs = 2);", 30 * 15, None),
        ("sphere(r = 10, $fn = 5);", 15, None),
        ("sphere(r = 1, $fn = 0, $fa = 12, $fs = 2);", 5 * 3, None),
        ("cylinder(h = 3, r = 10, $fn = 0, $fa = 12, $fs = 2);", 60, None),
        ("cylinder(h = 2, r = 1, $fn = 4);", 8, 4.0 + 8.0 * math.sqrt(2.0)),
        ("cylinder(h = 2, r1 = 1, r2 = 0, $fn = 4);", 5, 2.0 + 2.0 * math.sqrt(2.0) * math.sqrt(4.5)),
        ("cylinder(h = 2, r1 = 0, r2 = 1, $fn = 4);", 5, 2.0 + 2.0 * math.sqrt(2.0) * math.sqrt(4.5)),
        ("cylinder(h = 2, r = 1, $fn = 1);", 6, None),
    ],
)
def test_facets_as_written_are_openscads(reading, text, vertices, area):
    shape = reading(text, facets="as written")
    assert isinstance(shape, Mesh) and shape.closed and not shape.inverted
    assert len(shape.vertices) == vertices
    if area is not None:
        assert shape.area == pytest.approx(area)


def test_vertices_of_a_faceted_sphere_lie_where_openscad_puts_them(reading):
    sphere = reading("sphere(r = 10, $fn = 8);", facets="as written")
    assert np.allclose(np.linalg.norm(sphere.vertices, axis=1), 10.0)
    assert sphere.vertices[0] == pytest.approx([10 * math.sin(math.pi / 8), 0, 10 * math.cos(math.pi / 8)])
    assert set(np.round(sphere.vertices[:, 2], 9)) == set(np.round(10 * np.cos(np.pi * (np.arange(4) + 0.5) / 4), 9))


def test_polygons_of_a_polyhedron_are_cut_right_also_where_they_are_not_convex(reading):
    profile = [(0, 0), (6, 0), (6, 2), (2, 2), (2, 8), (0, 8)]  # an L, as OpenSCAD writes a prism
    points = [[x, y, z] for z in (0, 3) for x, y in profile]
    sides = [[k, k + 6, (k + 1) % 6 + 6, (k + 1) % 6] for k in range(6)]
    faces = [[0, 1, 2, 3, 4, 5], [11, 10, 9, 8, 7, 6], *sides]
    shape = reading(f"polyhedron(points = {points}, faces = {faces}, convexity = 2);")
    assert shape.closed and not shape.inverted
    assert shape.volume == pytest.approx(24 * 3) and shape.area == pytest.approx(48 + 28 * 3)
    turned = [list(np.roll(face, 3)) for face in faces]
    again = reading(f"polyhedron(points = {points}, faces = {[[int(i) for i in f] for f in turned]});")
    assert again.area == pytest.approx(48 + 28 * 3)
    assert not reading(f"polyhedron(points = {points}, faces = {faces[:-1]});").closed


def test_import_gives_a_leaf_beside_the_file(tmp_path):
    (tmp_path / "parts").mkdir()
    mesh = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    surfel.write(tmp_path / "parts" / "corner.stl", mesh)
    surfel.write(tmp_path / "scan.ply", RNG.standard_normal((500, 3)))
    (tmp_path / "parts" / "both.csg").write_text('union() { import("corner.stl"); cube(1, true); }')
    main = tmp_path / "main.csg"
    moved = "multmatrix([[1,0,0,5],[0,1,0,0],[0,0,1,0]])"
    main.write_text(
        'difference() { import(file = "parts/both.csg"); import(file = "scan.ply", layer = "", origin = [0, 0], '
        f'scale = 1, center = false, convexity = 1); {moved} {{ import("parts/corner.stl"); }} }}'
    )
    tree = read_csg(main)
    assert isinstance(tree, Tree) and [type(leaf).__name__ for leaf in tree.leaves] == [
        "Mesh",
        "Box",
        "Surfels",
        "Mesh",
    ]
    assert tree.leaves[3].bounds[0, 0] == 5.0


def test_files_that_import_themselves_are_refused(tmp_path):
    (tmp_path / "a.csg").write_text('import("b.csg");')
    (tmp_path / "b.csg").write_text('union() { cube(1);\nimport("a.csg"); }')
    (tmp_path / "self.csg").write_text('import("./self.csg");')
    for name in ("a.csg", "self.csg"):
        with pytest.raises(FileFormatError, match="imports itself"):
            read_csg(tmp_path / name)
    for k in range(100):
        (tmp_path / f"c{k}.csg").write_text(f'import("c{k + 1}.csg");')
    with pytest.raises(FileFormatError, match="in a chain"):
        read_csg(tmp_path / "c0.csg")


def test_imports_cannot_multiply_without_end(tmp_path, monkeypatch):
    monkeypatch.setattr(csg_build, "MOST_LEAVES", 1000)
    (tmp_path / "d0.csg").write_text("cube(1); sphere(1);")
    assert len(read_csg(tmp_path / "d0.csg").leaves) == 2
    for k in range(1, 40):
        (tmp_path / f"d{k}.csg").write_text(
            f'import("d{k - 1}.csg"); multmatrix([[1,0,0,{k}],[0,1,0,0],[0,0,1,0]]) import("d{k - 1}.csg");'
        )
    with pytest.raises(FileFormatError, match="more than 1,000 solids"):
        read_csg(tmp_path / "d39.csg")


def test_surfel_reads_it_by_its_suffix(tmp_path):
    path = tmp_path / "part.csg"
    path.write_text("difference() { cube(20, center = true); sphere(13); }")
    assert isinstance(surfel.read(path), Difference)


def test_bad_argument(tmp_path):
    with pytest.raises(InputError, match="facets"):
        read_csg(tmp_path / "part.csg", facets="some")
    with pytest.raises(InputError, match="no such file"):
        read_csg(tmp_path / "part.csg")
