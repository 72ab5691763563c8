"""What lies inside a closed cloud, by its coloured space; the signs of its normals are made sure of."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats
from surfel.core.crossings import Crossings
from surfel.inside.classes import IN, ON_OPPOSED, ON_SAME
from surfel.inside.classify import Classifier
from surfel.inside.operand import Operand
from surfel.shapes.surfels import CLOSED_BELOW, Surfels

OPEN_FROM = 0.15
"""A cloud is open where a larger share of the lines that hit than this is odd. Between that and what closed clouds have
it is open where its space leaks: lines that pass thin parts, of which the points lie too far apart to show both sides,
are odd though there is no hole."""

_DOUBTFUL = 1e-3  # share of surfels turned, or of votes against their colour, from which signs are looked for anew
_ASKED = 64  # surfels of each piece that are asked on which side of them the inside lies
_CLEARLY = 0.75  # share of the answers that settles it
_FEW_PIECES = 64
_STEP = 1.0  # how far beside a surfel, in spacings


def is_open(cloud: Surfels) -> bool:
    """Tell whether a cloud of which that was not said has no inside."""
    leak = cloud.surface.leak
    return leak >= CLOSED_BELOW and (leak >= OPEN_FROM or cloud._inside.leaky)


def classifier_of(cloud: Surfels) -> Classifier:
    """Return what tells the inside of a cloud: of what cleaning leaves of it, with the signs of normals made sure of.

    The space of a closed cloud with outward normals is coloured without a doubt. Where it is not, the signs are found
    anew, from neighbour to neighbour, and those are taken of which space is coloured with less doubt.
    """
    rows = cloud.surface.rows
    if not len(rows):
        return Classifier(Operand.of(np.empty((0, 3)), np.empty((0, 3))))
    part = cloud if len(rows) == len(cloud) else cloud[rows]
    believed = part.surface.trusted.normals
    if believed is not part.normals:
        part = part._like(normals=_signed_anew(part) if believed is None else believed)
    found = part.classifier
    if _doubt(found) < _DOUBTFUL:
        return found
    other = part._like(normals=_signed_anew(part)).classifier
    return other if _doubt(other) < _doubt(found) else found


def events_at(cloud: Surfels, points: Floats, normals: Floats | None) -> Crossings:
    """Return what the lines along the normals of some places pass at these (t = 0) and just behind them (t = -1).

    One passage behind says that the place, seen from there, is inside. One at the place says that the surface of the
    cloud lies there as well.
    """
    kind = cloud._inside.classify(points, normals).kind
    behind, here = (kind == IN) | (kind == ON_SAME), (kind == ON_SAME) | (kind == ON_OPPOSED)
    counts = behind.astype(np.int64) + here
    offsets = np.concatenate([[0], np.cumsum(counts)])
    t = np.zeros(int(offsets[-1]))
    t[offsets[:-1][behind]] = -1.0
    cosine = np.ones(len(t))
    return Crossings(offsets, t, cosine, cosine, np.zeros(len(t), np.int32))


def lies_on(cloud: Surfels, points: Floats, normals: Floats) -> NDArray[np.bool_]:
    """Tell which places lie on the surface of a closed cloud, facing as it does or the other way."""
    return cloud._inside.classify(points, normals).on


def _doubt(found: Classifier) -> float:
    """Return how much of a cloud contradicts how its space is coloured; more than 1 where space leaks."""
    return float(found.flipped.mean()) + found.conflict + float(found.leaky)


def _signed_anew(cloud: Surfels) -> Floats:
    """Return the normals of a cloud with signs that neighbours agree on; each piece is told by parity which is out."""
    surface, local = cloud.surface, cloud.surface.known[0]
    oriented, piece, _ = surface.orientation
    spacing = local.hood.spacing * surface.scale
    places = (local.hood.points + local.hood.index.origin) * surface.scale + surface.origin
    outward = _sides_of_pieces(cloud, places, oriented, spacing, piece)
    signed = np.zeros((len(cloud), 3))
    signed[local.hood.rows] = oriented * outward[piece][:, None]
    given = surface.trusted.normals
    if given is None:
        return signed
    side = np.where(np.einsum("ij,ij->i", given, signed) < 0.0, -1.0, 1.0)
    return np.where(np.any(given, axis=1)[:, None], given * side[:, None], signed)


def _sides_of_pieces(
    cloud: Surfels, places: Floats, normals: Floats, spacing: Floats, piece: NDArray[np.int32]
) -> Floats:
    """Return 1 for pieces whose normals point outward, and -1 for those, as of hollows, that are to be turned."""
    count = np.bincount(piece)
    outward = np.ones(len(count))
    order = np.argsort(piece, kind="stable")
    starts = np.concatenate([[0], np.cumsum(count)])
    for largest in np.argsort(-count, kind="stable")[:_FEW_PIECES]:
        rows = order[starts[largest] : starts[largest + 1]]
        rows = rows[(np.arange(min(_ASKED, len(rows))) * len(rows)) // min(_ASKED, len(rows))]
        step = _STEP * spacing[rows, None] * normals[rows]
        inner, outer = (cloud.surface.contains(places[rows] + side * step) for side in (-1.0, 1.0))
        turned = float((outer & ~inner).sum())
        if turned > _CLEARLY * float((outer != inner).sum()):
            outward[largest] = -1.0
    return outward
