"""OpenSCAD's ``.csg`` files: text of solids and what is done with them, read into a tree and written from one."""

from __future__ import annotations

import os
from os import PathLike
from typing import BinaryIO, NoReturn

from surfel.core.cast import as_choice
from surfel.core.errors import InputError
from surfel.io.atomic import replacing
from surfel.io.csg_build import build
from surfel.io.csg_parse import CURE, parse
from surfel.io.csg_solids import FACETS
from surfel.io.csg_write import csg_text
from surfel.io.source import Source, open_source
from surfel.shapes.base import Shape

MOST_FILES = 64
"""Files that import one another in a chain longer than this are refused."""


def read_csg(path: str | PathLike[str], facets: str = "auto") -> Shape:
    """Read a ``.csg`` file, the text that OpenSCAD exports, into a tree of exact solids.

    Read are ``union difference intersection group multmatrix color render cube sphere cylinder polyhedron import``,
    with arguments by name and by order. ``import()`` of a mesh, a scan or another ``.csg`` file gives what
    :func:`surfel.read` gives, looked for beside the file. Of the modifiers ``#`` changes nothing, ``*`` and ``%`` leave
    out what they stand before, and ``!`` leaves out all else, with the matrices round it.

    Emptiness is OpenSCAD's: a size of 0 is an empty solid, an empty child adds nothing to a union, and an intersection
    with something empty or a difference from something empty is empty. A file whose statements describe nothing gives
    ``Union()``.

    Parameters
    ----------
    path : str or path-like
        The file; "-" is the standard input.
    facets : {"auto", "exact", "as written"}
        What spheres and cylinders are. "auto" takes them as exact, but as a prism or polyhedron of ``$fn`` facets where
        ``$fn`` is at most 12: so few are meant. "exact" never makes facets. "as written" makes a mesh of the facets
        that OpenSCAD makes, for the file's ``$fn``, ``$fa`` and ``$fs``.

    Returns
    -------
    Shape
        A tree, or the one solid of the file.

    Raises
    ------
    InputError
        If there is no such file, or ``facets`` is not known.
    FileFormatError
        If the text is cut or garbled, nested too deep, or says something that is not supported: the line is named.

    Examples
    --------
    >>> import tempfile
    >>> from surfel.io.csg import read_csg
    >>> folder = tempfile.TemporaryDirectory()
    >>> text = "difference() { cube(size = 20, center = true); sphere(r = 13); }"
    >>> _ = open(folder.name + "/part.csg", "w").write(text)
    >>> read_csg(folder.name + "/part.csg")
    Difference(2 operands, 2 leaves)
    >>> folder.cleanup()
    """
    as_choice(facets, "facets", FACETS)
    with open_source(path) as source:
        return load(source, facets)


def write_csg(path: str | PathLike[str], shape: Shape) -> None:
    """Write a tree of solids as a ``.csg`` file, for OpenSCAD and for :func:`read_csg`.

    Parameters
    ----------
    path : str or path-like
        The target; its folder has to exist.
    shape : Shape
        A tree, primitive or mesh. Spheres and cylinders are written with ``$fn = 128``: that is how many facets
        OpenSCAD gives them; read back they are exact. A half-space becomes a cube larger than the rest of the tree.

    Raises
    ------
    InputError
        If a leaf cannot be written (a cloud, a torus, a quadric, ...), or a half-space leaves the tree unbounded.

    Examples
    --------
    >>> import tempfile, surfel
    >>> from surfel.io.csg import read_csg, write_csg
    >>> folder = tempfile.TemporaryDirectory()
    >>> write_csg(folder.name + "/part.csg", surfel.Box(20) - surfel.Sphere(13))
    >>> read_csg(folder.name + "/part.csg")
    Difference(2 operands, 2 leaves)
    >>> folder.cleanup()
    """
    with replacing(path) as stream:
        save_shape(stream, shape)


def load(source: Source, facets: str = "auto") -> Shape:
    """Read an open ``.csg`` file; see :func:`read_csg`."""
    return _Files(facets).load(source)


def save_shape(stream: BinaryIO, shape: Shape) -> None:
    """Write a tree into an open stream; see :func:`write_csg`."""
    stream.write(csg_text(shape).encode("utf-8", "surrogateescape"))


class _Files:
    """The file that is read and those that it imports, each once."""

    def __init__(self, facets: str) -> None:
        self.facets = facets
        self.known: dict[str, Shape] = {}
        self.open_ones: list[str] = []

    def load(self, source: Source) -> Shape:
        text = source.rest().tobytes().decode("utf-8", "surrogateescape").removeprefix("\ufeff")

        def fail(problem: str, place: int, cure: str) -> NoReturn:
            line = text.count("\n", 0, place) + 1
            raise source.error(problem, f"line {line}", cure) from None

        def import_file(name: str, place: int) -> Shape:
            try:
                return self.imported(os.path.join(os.path.dirname(source.path), name))
            except InputError as error:
                fail(f"import(): {error}", place, "mend that line, or put the file there")

        root = parse(text, fail)
        if not root.children:
            fail("there is no statement in it", len(text), CURE)
        self.open_ones.append(os.path.realpath(source.path))
        try:
            return build(root, self.facets, import_file, fail)
        finally:
            self.open_ones.pop()

    def imported(self, path: str) -> Shape:
        """Return the shape of another file; the same object for the same file."""
        key = os.path.realpath(path)
        if key in self.open_ones:
            raise InputError(f"{path!r} imports itself" + ("" if key == self.open_ones[-1] else " through others"))
        if len(self.open_ones) >= MOST_FILES:
            raise InputError(f"more than {MOST_FILES} files import one another in a chain")
        if key not in self.known:
            if path.lower().endswith(".csg"):
                with open_source(path) as source:
                    self.known[key] = self.load(source)
            else:
                from surfel.io.doors import read

                self.known[key] = read(path)
        return self.known[key]
