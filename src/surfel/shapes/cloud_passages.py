"""Passages of lines through a closed cloud: moved onto its curved sheets, and found anew where a line leaks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Booleans, Floats
from surfel.core.crossings import Crossings
from surfel.core.execute import blocks
from surfel.core.lines import Lines
from surfel.inside.classify import Classifier
from surfel.inside.decision import SHEETS
from surfel.inside.sheets import judge as over_sheets

if TYPE_CHECKING:
    from surfel.shapes.surfels import Surfels

_STEP = 0.5  # how far apart, in spacings, a line that leaks is asked
_HALVINGS = 10
_PLACES = 1 << 20  # asked at a time
_STEEP = 0.2  # least cosine at which a passage is moved along its line
_NEWTON = 2
_FARTHEST = 0.5  # spacings that a passage is moved by at most


def closed_events(cloud: Surfels, lines: Lines, raw: Crossings) -> Crossings:
    """Return the passages of lines through a closed cloud, an even number on each line.

    Triangles between the points cut edges off. Where the points lie on their surface, each passage is moved along its
    line onto the curved sheets through the points nearest to it. Where a line leaks, the cloud is asked what lies
    inside all along it.

    Parameters
    ----------
    cloud : Surfels
        Closed, or said to be a solid.
    lines : Lines
        The lines.
    raw : Crossings
        Their hits on the cloud.
    """
    events = cloud._sheets(raw)
    inside = cloud._inside
    local = cloud.surface.local
    if local is None:
        return events
    if inside.decision.judge == SHEETS and not local.projected:
        events = _on_sheets(inside, lines, events, _FARTHEST * cloud.surface.spacing)
    return mended(cloud, lines, events)


def mended(cloud: Surfels, lines: Lines, events: Crossings) -> Crossings:
    """Return events of which those of leaking lines are replaced by what the cloud says all along these lines."""
    odd = np.flatnonzero(events.counts % 2 == 1)
    if not len(odd):
        return events
    return _replaced(
        events, odd, _asked_along(cloud, Lines(lines.origins[odd], lines.directions[odd], lines.weights[odd]))
    )


def _on_sheets(inside: Classifier, lines: Lines, events: Crossings, farthest: float) -> Crossings:
    """Move passages onto the curved sheets by Newton's method; seldom do two change places."""
    line = events.lines
    place = np.arange(len(line)) - events.offsets[line]
    slope = np.where(place % 2 == 0, -1.0, 1.0) * np.maximum(np.abs(events.cosine), _STEEP)
    t = events.t
    for _ in range(_NEWTON):
        value = over_sheets(inside.operand, lines.origins[line] + t[:, None] * lines.directions[line]).value
        t = np.clip(t - value / slope, events.t - farthest, events.t + farthest)
    order = np.lexsort((t, line)) if len(t) else np.empty(0, np.int64)
    return Crossings(events.offsets, t[order], events.cosine[order], events.weight[order], events.leaf[order])


def _asked_along(cloud: Surfels, lines: Lines) -> Crossings:
    """Return where lines go in and out of a cloud, from what lies inside at places all along them."""
    spacing = cloud.surface.spacing
    low, high = cloud.bounds + np.array([[-spacing], [spacing]])
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = (np.stack([low, high])[:, None] - lines.origins) / lines.directions
    enter = np.nanmax(np.where(np.isfinite(ends), ends, np.nan).min(axis=0), axis=1)
    leave = np.nanmin(np.where(np.isfinite(ends), ends, np.nan).max(axis=0), axis=1)
    longest = float(np.maximum(leave - enter, 0.0).max(initial=0.0))
    count = int(longest / (_STEP * spacing)) + 2
    steps = np.arange(count) * (longest / (count - 1))
    found = []
    for start, stop in blocks(len(lines), max(1, _PLACES // count)):
        rows = np.arange(start, stop)
        t = enter[start:stop, None] + steps
        held = _inside_at(cloud, lines, np.repeat(rows, count), t.ravel()).reshape(t.shape)
        held[:, 0] = held[:, -1] = False
        row, before = np.nonzero(held[:, 1:] != held[:, :-1])
        found.append((rows[row], t[row, before], t[row, before + 1], held[row, before]))
    line, one, other, first = (np.concatenate(column) for column in zip(*found, strict=True))
    for _ in range(_HALVINGS):
        middle = 0.5 * (one + other)
        same = _inside_at(cloud, lines, line, middle) == first
        one, other = np.where(same, middle, one), np.where(same, other, middle)
    offsets = np.concatenate([[0], np.cumsum(np.bincount(line, minlength=len(lines)))])
    ones = np.ones(len(line))
    return Crossings(offsets, 0.5 * (one + other), np.where(first, 1.0, -1.0), ones, np.zeros(len(line), np.int32))


def _inside_at(cloud: Surfels, lines: Lines, line: NDArray[np.int64], t: Floats) -> Booleans:
    return cloud._inside.classify(lines.origins[line] + t[:, None] * lines.directions[line]).inside


def _replaced(events: Crossings, rows: NDArray[np.int64], others: Crossings) -> Crossings:
    """Return crossings with those of some lines replaced."""
    stays = np.ones(len(events), bool)
    stays[rows] = False
    counts = np.where(stays, events.counts, 0)
    counts[rows] = others.counts
    offsets = np.concatenate([[0], np.cumsum(counts)])
    kept = stays[events.lines]
    line = np.concatenate([events.lines[kept], rows[others.lines]])
    order = np.argsort(line, kind="stable")

    def joined(one: NDArray[Any], other: NDArray[Any]) -> NDArray[Any]:
        return np.concatenate([one[kept], other])[order]

    return Crossings(
        offsets, joined(events.t, others.t), joined(events.cosine, others.cosine),
        joined(events.weight, others.weight), joined(events.leaf, others.leaf),
    )  # fmt: skip
