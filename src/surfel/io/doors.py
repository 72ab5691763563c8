"""read, write, info and convert: the four doors to every format."""

from __future__ import annotations

import warnings
from os import PathLike, fspath
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

import numpy as np

from surfel.core.cast import as_choice
from surfel.core.errors import InputError, SurfelWarning
from surfel.io.atomic import replacing
from surfel.io.content import Content, content_of
from surfel.io.registry import Format, format_for_reading, format_for_writing
from surfel.io.source import Source, open_source

if TYPE_CHECKING:
    from surfel.shapes.base import Shape

Path = str | PathLike[str]


def read(path: Path, as_: str | None = None) -> Shape:
    """Read a cloud or a mesh from a file.

    What the file begins with decides its format, then its suffix. Points that are not finite are dropped, and so are
    the triangles that use one; ``provenance`` of a cloud counts them.

    Parameters
    ----------
    path : str or path-like
        The file.
    as_ : {None, "points", "mesh"}
        ``None`` gives a mesh where the file has faces, else a cloud. "points" of a mesh are its used vertices with
        their area-weighted normals (zero where they are undefined).

    Returns
    -------
    Surfels or Mesh
        In double precision. ``provenance`` of a cloud tells the format, the file, how many points were not finite
        (``non_finite``), and in ``notes`` what was left out.

    Raises
    ------
    InputError
        If there is no such file, it cannot be opened, its format is not known, or it has no faces for "mesh".
    FileFormatError
        If the file is empty, cut, garbled or lying.

    Examples
    --------
    >>> import tempfile, numpy as np, surfel
    >>> folder = tempfile.TemporaryDirectory()
    >>> surfel.write(folder.name + "/three.ply", np.eye(3))
    >>> len(surfel.read(folder.name + "/three.ply"))
    3
    >>> folder.cleanup()
    """
    if as_ is not None:
        as_choice(as_, "as_", ("points", "mesh"))
    content, found = _load(path)
    if not isinstance(content, Content):
        return content  # type: ignore[no-any-return]
    content, dropped, fewer = content.finite()
    _note_dropped(content, dropped, fewer)
    if as_ == "mesh" and content.triangles is None:
        raise InputError(f"{fspath(path)!r} has no faces to read as a mesh; read it as points")
    if as_ != "points" and content.triangles is not None:
        return content.to_mesh()
    provenance = {"format": found.name, "path": fspath(path), "non_finite": dropped}
    return content.as_points().to_surfels(provenance)


def write(path: Path, thing: object, *, ascii: bool = False) -> None:
    """Write a cloud, a mesh or an array of points; the suffix of ``path`` says in which format.

    The file is written beside its target and renamed, so that on any failure an old file is whole. What the format
    cannot keep (an attribute, the colors) is said by a warning.

    Parameters
    ----------
    path : str or path-like
        The target; its folder has to exist.
    thing : Surfels, Mesh or array_like of shape (n, 3)
        What to write.
    ascii : bool
        Write PLY and STL as text.

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
    content = content_of(thing)
    kind = "points" if content.triangles is None else "mesh"
    target = format_for_writing(path)
    if kind not in target.holds:
        raise InputError(f"{target.name} holds no {kind}; write {fspath(path)!r} as .ply, which holds both")
    lost = _save(path, target, content, ascii)
    if lost:
        warnings.warn(f"{target.name} cannot keep: {'; '.join(lost)}", SurfelWarning, stacklevel=2)


def info(path: Path, full: bool = False) -> dict[str, Any]:
    """Tell what a file holds.

    Parameters
    ----------
    path : str or path-like
        The file.
    full : bool
        Look at every point: spacing and duplicates too.

    Returns
    -------
    dict
        ``format``, ``points`` (how many; of a mesh its vertices), ``normals`` (whether there are any), ``bounds`` (two
        corners, or None where no point is finite), ``triangles`` where there are faces, ``radii``, ``colors``,
        ``attributes`` and ``notes``; with ``full`` also ``spacing`` (the median distance to the nearest other place, or
        None), ``duplicates`` (points at the place of an earlier one) and ``non_finite``.

    Raises
    ------
    InputError, FileFormatError
        As :func:`read` does.

    Examples
    --------
    >>> import tempfile, numpy as np, surfel
    >>> folder = tempfile.TemporaryDirectory()
    >>> surfel.write(folder.name + "/three.ply", np.eye(3))
    >>> surfel.info(folder.name + "/three.ply")["points"]
    3
    >>> folder.cleanup()
    """
    content, found = _load(path)
    if not isinstance(content, Content):
        return {"format": found.name, "points": 0, "normals": False, "bounds": np.asarray(content.bounds).tolist()}
    finite, dropped, _ = content.finite()
    corners = np.stack([finite.points.min(axis=0), finite.points.max(axis=0)]).tolist() if len(finite.points) else None
    answer: dict[str, Any] = {
        "format": found.name,
        "points": len(content.points),
        "normals": content.normals is not None,
        "bounds": corners,
    }
    if content.triangles is not None:
        answer["triangles"] = len(content.triangles)
    answer |= {"radii": content.radii is not None, "colors": content.colors is not None}
    answer |= {"attributes": list(content.attributes), "notes": content.notes}
    if full:
        places, duplicates = _distinct(finite.points)
        answer |= {"spacing": _spacing(places), "duplicates": duplicates, "non_finite": dropped}
    return answer


def convert(source: Path, target: Path, as_: str | None = None) -> dict[str, Any]:
    """Copy a file into another format, keeping what the target can hold.

    Parameters
    ----------
    source, target : str or path-like
        The file, and the new one; the suffix of the new one says its format.
    as_ : {None, "points", "mesh"}
        As in :func:`read`; by default triangles are kept where the target can hold them.

    Returns
    -------
    dict
        ``source`` and ``target`` (formats), ``points`` and ``triangles`` written, ``non_finite`` (dropped), ``lost``
        (what the target could not hold) and ``notes`` (what was decided while reading).

    Raises
    ------
    InputError, FileFormatError
        As :func:`read` and :func:`write` do.

    Examples
    --------
    >>> import tempfile, numpy as np, surfel
    >>> folder = tempfile.TemporaryDirectory()
    >>> surfel.write(folder.name + "/a.ply", surfel.Surfels(np.eye(3), colors=np.eye(3)))
    >>> surfel.convert(folder.name + "/a.ply", folder.name + "/a.npy")["lost"]
    ['colors of 3 points']
    >>> folder.cleanup()
    """
    if as_ is not None:
        as_choice(as_, "as_", ("points", "mesh"))
    wanted = format_for_writing(target)
    content, found = _load(source)
    if not isinstance(content, Content):
        raise InputError(
            f"{fspath(source)!r} is a {found.name} description, not points or faces; it cannot be converted"
        )
    content, dropped, fewer = content.finite()
    _note_dropped(content, dropped, fewer)
    if as_ == "points":
        content = content.as_points()
    kind = "mesh" if content.triangles is not None else "points"
    if as_ == "mesh" and kind != "mesh":
        raise InputError(f"{fspath(source)!r} has no faces to convert as a mesh")
    lost: list[str] = []
    if kind == "mesh" and "mesh" not in wanted.holds and as_ is None:
        lost.append(f"{len(content.triangles if content.triangles is not None else ())} triangles")
        content, kind = content.as_points(), "points"
    if kind not in wanted.holds:
        raise InputError(f"{wanted.name} holds no {kind}; convert {fspath(source)!r} to .ply, which holds both")
    lost += _save(target, wanted, content, False)
    return {
        "source": found.name,
        "target": wanted.name,
        "points": len(content.points),
        "triangles": 0 if content.triangles is None else len(content.triangles),
        "non_finite": dropped,
        "lost": lost,
        "notes": content.notes,
    }


def load_content(source: Source) -> tuple[Any, Format]:
    """Read an open source; return its content (or the shape that a room above makes of it) and its format."""
    found, notes = format_for_reading(source)
    with np.errstate(all="ignore"):  # a damaged file may hold any bits; what is not finite is counted later
        content = found.codec.load(source)
    if isinstance(content, Content):
        content.notes[:0] = notes
    return content, found


def _load(path: Path) -> tuple[Any, Format]:
    with open_source(path) as source:
        return load_content(source)


def _save(path: Path, target: Format, content: Content, ascii: bool) -> list[str]:
    with replacing(path) as stream:
        lost: list[str] = target.codec.save(stream, content, ascii=ascii, suffix=PurePath(path).suffix.lower())
    return lost


def _note_dropped(content: Content, points: int, triangles: int) -> None:
    if points:
        more = f" and {triangles} triangles that use them" if triangles else ""
        content.notes.append(f"{points} points that are not finite{more} were dropped")


def _distinct(points: np.ndarray[Any, np.dtype[np.float64]]) -> tuple[Any, int]:
    """Return the distinct places and how many points lie at the place of an earlier one."""
    if len(points) == 0:
        return points, 0
    order = np.lexsort(points.T)
    ordered = points[order]
    new = np.concatenate([[True], (ordered[1:] != ordered[:-1]).any(axis=1)])
    return ordered[new], int(len(points) - new.sum())


def _spacing(places: Any) -> float | None:
    """Return the median distance to the nearest other place."""
    if len(places) < 2:
        return None
    from scipy.spatial import cKDTree

    with np.errstate(over="ignore"):
        size = float(np.abs(places - places[0]).max())  # scaled, because the squares of FLT_MAX and more overflow
        scaled = (places - places[0]) / size
    distance, _ = cKDTree(scaled).query(scaled, k=2)
    spacing = float(np.median(distance[:, 1])) * size
    return spacing if np.isfinite(spacing) else None
