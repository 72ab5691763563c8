"""read and write: a whole file as a cloud or a mesh, and back."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from os import PathLike, fsdecode
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from surfel.core.cast import as_choice
from surfel.core.errors import InputError, SurfelWarning
from surfel.io.atomic import replacing
from surfel.io.content import Content, content_of
from surfel.io.loading import load_content
from surfel.io.options import options_from
from surfel.io.registry import format_for_writing
from surfel.io.source import open_source

if TYPE_CHECKING:
    from surfel.shapes.base import Shape

Path = str | PathLike[str]


def read(
    path: Path,
    as_: str | None = None,
    *,
    bounds: ArrayLike | None = None,
    every: int = 1,
    classes: int | Iterable[int] | None = None,
    resolution: float | None = None,
    level: int | None = None,
) -> Shape:
    """Read a cloud or a mesh from a file.

    What the file begins with decides its format, then its suffix. One rule holds for every format: points whose
    coordinates are not finite are dropped, and so are the triangles that use one; duplicates stay; a normal that is
    zero or not finite means "not known here" and is kept as zero. ``provenance`` counts what was dropped;
    ``surfel.info(path, full=True)`` counts all three.

    Parameters
    ----------
    path : str or path-like
        The file; "-" is the standard input.
    as_ : {None, "points", "mesh"}
        ``None`` gives a mesh where the file has faces, else a cloud. "points" of a mesh are its used vertices with
        their area-weighted normals (zero where they are undefined).
    bounds : array_like, shape (2, 3), optional
        Only points in this box, in the file's units. Of a mesh, the triangles that lie in it.
    every : int
        Only rows 0, every, 2 every, ... of the file, counted before anything else is left out.
    classes : int or iterable of int, optional
        Only points whose attribute ``classification`` is one of these.
    resolution : float, optional
        Of a COPC file, the coarsest levels whose points together lie this close.
    level : int, optional
        Of a COPC file, the levels from 0, the coarsest, to this one.

    Returns
    -------
    Surfels or Mesh
        In double precision. ``provenance`` of a cloud tells the format, the file, how many points were not finite
        (``non_finite``), in ``notes`` what was left out, and, where the file has one, its ``frame`` (scale, offset and
        reference system; :func:`write` uses it again) and its ``crs``.

    Raises
    ------
    InputError
        If there is no such file, it cannot be opened, its format is not known, it has no faces for "mesh", no
        classification for ``classes``, or no levels for ``resolution`` and ``level``.
    FileFormatError
        If the file is empty, cut, garbled or lying.
    MissingExtraError
        If its format needs a package that is not installed.

    Examples
    --------
    >>> import tempfile, numpy as np, surfel
    >>> folder = tempfile.TemporaryDirectory()
    >>> surfel.write(folder.name + "/three.ply", np.eye(3))
    >>> len(surfel.read(folder.name + "/three.ply"))
    3
    >>> len(surfel.read(folder.name + "/three.ply", bounds=((0, 0, 0), (0.5, 1, 1))))
    2
    >>> folder.cleanup()
    """
    if as_ is not None:
        as_choice(as_, "as_", ("points", "mesh"))
    options = options_from(bounds, every, classes, resolution, level)
    with open_source(path) as source:
        content, found, (dropped, _) = load_content(source, options, as_)
    if not isinstance(content, Content):
        return content  # type: ignore[no-any-return]
    if as_ == "mesh" and content.triangles is None:
        raise InputError(f"{fsdecode(path)!r} has no faces to read as a mesh; read it as points")
    if as_ != "points" and content.triangles is not None:
        return content.to_mesh()
    provenance = {"format": found.name, "path": fsdecode(path), "non_finite": dropped}
    return content.as_points().to_surfels(provenance)


def write(path: Path, thing: object, *, ascii: bool = False, to: str | None = None) -> None:
    """Write a cloud, a mesh, an array of points or a tree; the suffix of ``path`` says in which format.

    The file is written beside its target and renamed, so that on any failure an old file is whole. What the format
    cannot keep (an attribute, the colors) is said by a warning. A cloud that was read from a format with scaled whole
    numbers (LAS) is written with the same scale and offset, to the last stored digit.

    Parameters
    ----------
    path : str or path-like
        The target; its folder has to exist. "-" is the standard output.
    thing : Surfels, Mesh, array_like of shape (n, 3), or a tree of solids
        What to write; a tree as ``.csg``.
    ascii : bool
        Write PLY, PCD and STL as text.
    to : str, optional
        The format by its suffix, such as "pcd", where ``path`` does not say it; for "-" it is "ply" by default.

    Raises
    ------
    InputError
        If the target cannot be written, its suffix is not known, or the format cannot hold such a thing at all.

    Examples
    --------
    >>> import tempfile, numpy as np, surfel
    >>> folder = tempfile.TemporaryDirectory()
    >>> surfel.write(folder.name + "/cloud.xyz", surfel.Surfels(np.eye(3)))
    >>> print(open(folder.name + "/cloud.xyz").readlines()[1].strip())
    0.0 1.0 0.0
    >>> folder.cleanup()
    """
    target, suffix = format_for_writing(path, to)
    if "tree" in target.holds and _is_shape(thing):
        with replacing(path) as stream:
            target.codec.save_shape(stream, thing)
        return
    content = content_of(thing)
    kind = "points" if content.triangles is None else "mesh"
    if kind not in target.holds:
        raise InputError(f"{target.name} holds no {kind}; write {fsdecode(path)!r} as .ply, which holds both")
    with replacing(path) as stream:
        lost: list[str] = target.codec.save(stream, content, ascii=ascii, suffix=suffix)
    if lost:
        warnings.warn(f"{target.name} cannot keep: {'; '.join(lost)}", SurfelWarning, stacklevel=2)


def _is_shape(thing: object) -> bool:
    from surfel.shapes.base import Shape

    return isinstance(thing, Shape)
