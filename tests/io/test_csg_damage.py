"""A damaged or unsupported .csg file is a FileFormatError that names the line, whatever it is; never a crash."""

import pytest

from surfel.core.errors import FileFormatError
from surfel.io.csg import read_csg

WHOLE = """group() {
\tmultmatrix([[1, 0, 0, -2.5e-05], [0, 1, 0, 0], [0, 0, 1, 5], [0, 0, 0, 1]]) {
\t\tdifference() {
\t\t\tcube(size = [20, 20, 20], center = true); // a comment
\t\t\tsphere($fn = 0, $fa = 12, $fs = 2, r = 13); /* another */
\t\t\tpolyhedron(points = [[0, 0, 0], [1, 0, 0], [0, 1, 0]], faces = [[0, 1, 2]], convexity = 1);
\t\t\tcolor("red") cylinder(h = 4, r1 = 1, r2 = 2, center = false);
\t\t}
\t}
}"""


@pytest.fixture
def refused(tmp_path):
    def refuse(text, match, **options):
        path = tmp_path / "part.csg"
        path.write_bytes(text.encode() if isinstance(text, str) else text)
        with pytest.raises(FileFormatError, match=match) as caught:
            read_csg(path, **options)
        assert "part.csg" in str(caught.value)
        return caught.value

    return refuse


def test_the_whole_file_is_read(tmp_path):
    path = tmp_path / "part.csg"
    path.write_text(WHOLE)
    assert len(read_csg(path).leaves) == 4


@pytest.mark.parametrize("share", range(len(WHOLE)))
def test_a_file_cut_anywhere_is_refused(refused, share):
    refused(WHOLE[:share], "[(](line|byte) ")


def test_any_byte_changed_is_read_or_refused(tmp_path):
    path = tmp_path / "part.csg"
    for place in range(len(WHOLE)):
        for byte in (b"\x00", b"[", b"}", b"\xff", b'"'):
            path.write_bytes(WHOLE[:place].encode() + byte + WHOLE[place + 1 :].encode())
            try:
                read_csg(path)
            except FileFormatError as error:
                assert error.place.startswith("line ")


@pytest.mark.parametrize("mark", ["{", "[", "(", "}", ")", '"', "union(){", "union()", "cube([", "/*", "//", "* ", "-"])
def test_ten_megabytes_of_brackets(refused, mark):
    refused(mark * (10_000_000 // len(mark)), "[(]line ")
    refused("cube(size = " + mark * (1_000_000 // len(mark)), "[(]line ")


@pytest.mark.parametrize("nested", ["union() {", "difference() ", "multmatrix([[1,0,0,1],[0,1,0,0],[0,0,1,0]]) {"])
def test_nesting_of_ten_thousand(refused, nested):
    end = "cube();" + ("}" * 10_000 if nested.endswith("{") else "")
    refused(nested * 10_000 + end, "nested more than")


def test_nesting_of_a_thousand_is_read(tmp_path):
    path = tmp_path / "deep.csg"
    path.write_text("difference() { union() {" * 900 + "cube(9);" + "} sphere(1); cube(2); }" * 900)
    assert len(read_csg(path).leaves) == 1801
    path.write_text("difference() { cube(9); union() { sphere(1); " * 901 + "cube(3);" + "} }" * 901)
    tree = read_csg(path)
    assert tree.contains([[0.5, 0.5, 8.5], [20, 0, 0]]).tolist() == [True, False]


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("cube(1);\nhull() { cube(1); }", r"hull\(\) is not supported.*line 2"),
        ("cube(1);\n\nminkowski() { cube(1); }", r"minkowski.*line 3.*import"),
        ("linear_extrude(height = 3) { square(2); }", r"linear_extrude\(\) is not supported.*line 1"),
        ("translate([1, 2, 3]) cube(1);", "translate"),
        ("x = 3;", "no variables"),
        ("if (true) cube(1);", r"if\(\) is not supported"),
        ("include <a.scad>", "'<a.scad>'"),
        ("cube(1)", "the file ends"),
        ("cube(1) }", "closes nothing"),
        ("cube(sise = 1);", "no argument 'sise'"),
        ("cube(1, true, 3);", "3 arguments without a name"),
        ("cube(-1);", "negative"),
        ("cube([1, 2]);", "size must be 3 finite numbers"),
        ('cube("1");', "size must be a finite number"),
        ("cube(1, center = 1);", "center must be true or false"),
        ("cube(1e999);", "finite"),
        ("sphere(r = nan);", "'nan"),
        ("sphere(r = undef, d = [1]);", "d must be a finite number"),
        ("cylinder(h = -1);", "negative"),
        ("multmatrix([[1,0,0],[0,1,0],[0,0,1]]) cube(1);", "row 0 of m must be 4"),
        ("multmatrix() cube(1);", "m must be a matrix"),
        ("multmatrix([[1,0,0,0],[0,1,0,0],[0,0,1,0],[1,0,0,1]]) cube(1);", "perspective"),
        ("polyhedron(points = [[0,0,0]], faces = [[0, 0, 1]]);", "names point 1"),
        ("polyhedron(points = [[0,0,0]], faces = [[0, 0, -1]]);", "names point -1"),
        ("polyhedron(points = [[0,0,0]], faces = [[0, 0, 0.5]]);", "names point 0.5"),
        ("polyhedron(points = [[0,0,0]], faces = [[0, 0]]);", "at least three"),
        ("polyhedron(points = [[0,0]], faces = [[0, 0, 0]]);", "point 0 must be 3"),
        ('import("nowhere.stl");', "no such file"),
        ('import("flat.dxf");', "flat"),
        ("import();", "file must name a file"),
        ('import("a.stl", center = true);', "not supported"),
        ("// nothing but a comment\n", "no statement"),
        (b"\xff\xfe\x00c", "stands where a statement should be"),
    ],
)
def test_what_is_wrong_is_said_with_its_line(refused, text, match):
    error = refused(text, match)
    assert error.place.startswith("line ") and error.cure


def test_facets_without_end_are_refused(refused):
    refused("sphere(r = 1, $fn = 1e9);", "facets='exact'", facets="as written")
    refused("cylinder(r = 1, h = 1, $fn = 1e18);", "facets='exact'", facets="as written")
