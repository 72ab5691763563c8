"""Recursive subdivision, then faceting: the scheme of the modeller svLis, as Li et al. describe it in section 6.

A box round the solid is halved again and again. Each half keeps only what of the set-theoretic expression matters in
it: functions whose range over the box has one sign are replaced by their truth value (interval and affine arithmetic:
Voiculescu, Berchtold, Bowyer, Martin and Zhang, *Interval and affine arithmetic for surface location of power- and
Bernstein-form polynomials*, 2000), and the expression is simplified. Halving stops where at most three functions are
left and the gradient of each turns by less than a limit; the cut goes across the side along which gradients turn most,
unless the box would become too long. What is left is cut into tetrahedra and faceted.
"""

from __future__ import annotations

import time

import numpy as np

from surfel._numba import inner, kernel
from surfel.core.cast import as_positive
from surfel.measuring.baselines.baseline import Reading
from surfel.measuring.baselines.facets import MOST_FUNCTIONS, TETRAHEDRA, Scratch, facet_box
from surfel.measuring.baselines.functions import bending, range_over
from surfel.measuring.baselines.implicit import AND, implicit_of
from surfel.shapes.base import Shape

_FEW = 3  # functions that a box may keep
_ASPECT = 8.0  # of the longest side to that which is halved
_FINEST = 1.0 / 64.0  # of the size of the solid times the limit: boxes of this size are faceted as they are
_LEVELS = 160
_MARGINS = np.array([[0.0103, 0.0171, 0.0139], [0.0227, 0.0119, 0.0193]])  # so that no cut falls onto a face
_OUT, _IN, _MIXED = 0, 1, 2


def subdivision(shape: Shape, effort: float) -> Reading:
    """Find the area of a tree by recursive subdivision and faceting.

    Parameters
    ----------
    shape : Shape
        A tree of half-spaces, boxes, spheres, ellipsoids, cylinders, cones, quadrics and tori.
    effort : float
        One over the angle, in radians, by which a gradient may turn in a box.

    Returns
    -------
    Reading
        Its elements are the facets.

    Raises
    ------
    InputError
        If the tree is unbounded, or a leaf has no implicit function here (a cloud, a mesh, a cyclide, a polynomial).

    Examples
    --------
    >>> import surfel
    >>> from surfel.measuring.baselines import subdivision
    >>> area, facets, seconds = subdivision(surfel.Box(20) - surfel.Sphere(13), 20)
    >>> abs(area / 1752.83 - 1) < 0.005
    True
    """
    limit = 1.0 / as_positive(effort, "effort")
    started = time.perf_counter()
    functions, tokens = implicit_of(shape)
    if not len(tokens):
        return Reading(0.0, 0, time.perf_counter() - started)
    low, high = np.asarray(shape.bounds)
    size = float((high - low).max())
    if size == 0.0:
        return Reading(0.0, 0, time.perf_counter() - started)
    low, high = low - size * _MARGINS[0], high + size * _MARGINS[1]
    scratch = Scratch.of(len(functions), len(tokens))
    centre, half, finest = 0.5 * (low + high), 0.5 * (high - low), _FINEST * limit * size
    area, facets = _subdivide(functions, tokens, centre, half, float(limit), finest, TETRAHEDRA, scratch)
    return Reading(float(area), int(facets), time.perf_counter() - started)


@kernel
def _subdivide(functions, tokens, centre, half, limit, finest, tetrahedra, scratch):
    """Return the area and the number of facets; the boxes still to be halved lie on a stack, the deepest last."""
    programs = np.empty((_LEVELS + 1, len(tokens)), np.int64)
    sizes = np.zeros(_LEVELS + 1, np.int64)
    boxes = np.empty((_LEVELS + 1, 6))
    axes = np.zeros(_LEVELS + 1, np.int64)
    halves = np.zeros(_LEVELS + 1, np.int64)
    truth = np.empty(len(tokens) + 1, np.int64)
    starts = np.empty(len(tokens) + 1, np.int64)
    here = np.empty(MOST_FUNCTIONS, np.int64)
    programs[0, :] = tokens
    sizes[0] = len(tokens)
    for k in range(3):
        boxes[0, k], boxes[0, 3 + k] = centre[k], half[k]
    area, facets, level = 0.0, 0, 0
    axes[0] = -1
    while level >= 0:
        box = boxes[level]
        if axes[level] < 0:  # met for the first time
            sizes[level], state = _pruned(functions, programs[level], sizes[level], box, truth, starts)
            count = _distinct(programs[level], sizes[level], here) if state == _MIXED else 0
            axis = _cut(functions, here, count, box, limit, finest) if state == _MIXED else -1
            if axis < 0 or level == _LEVELS:
                if state == _MIXED:
                    found, number = facet_box(
                        functions, programs[level], sizes[level], here, min(count, MOST_FUNCTIONS),
                        box[0], box[1], box[2], box[3], box[4], box[5], tetrahedra, scratch,
                    )  # fmt: skip
                    area += found
                    facets += number
                level -= 1
                continue
            axes[level], halves[level] = axis, 0
        if halves[level] == 2:
            level -= 1
            continue
        axis = axes[level]
        boxes[level + 1] = box
        boxes[level + 1, 3 + axis] = 0.5 * box[3 + axis]
        boxes[level + 1, axis] = box[axis] + (halves[level] - 0.5) * box[3 + axis]
        halves[level] += 1
        size = sizes[level]
        programs[level + 1, :size] = programs[level, :size]
        sizes[level + 1] = size
        axes[level + 1] = -1
        level += 1
    return area, facets


@inner
def _pruned(functions, program, size, box, truth, starts):
    """Simplify an expression in place to what matters in a box; return its size, and whether it is in, out or mixed.

    On the stack lie the operands: their truth, or ``_MIXED`` and where their tokens start.
    """
    top, written = -1, 0
    for k in range(size):
        token = program[k]
        if token >= 0:
            low, high = range_over(functions[token >> 1], box[0], box[1], box[2], box[3], box[4], box[5])
            top += 1
            starts[top] = written
            if low >= 0.0:
                truth[top] = _IN if token & 1 else _OUT
            elif high < 0.0:
                truth[top] = _OUT if token & 1 else _IN
            else:
                truth[top] = _MIXED
                program[written] = token
                written += 1
            continue
        top -= 1
        a, b = truth[top], truth[top + 1]
        decisive = _OUT if token == AND else _IN
        if a == decisive or b == decisive:
            truth[top], written = decisive, starts[top]
        elif a != _MIXED:
            truth[top] = b  # its tokens start where those of a would
        elif b == _MIXED:
            program[written] = token
            written += 1
    return written, truth[0]


@inner
def _distinct(program, size, here):
    """Write which functions an expression has, in the order of their first use; return how many, stopping if many."""
    count = 0
    for k in range(size):
        if program[k] < 0:
            continue
        function = program[k] >> 1
        known = False
        for i in range(min(count, len(here))):
            known = known or here[i] == function
        if not known:
            if count == len(here):
                return count + 1
            here[count] = function
            count += 1
    return count


@inner
def _cut(functions, here, count, box, limit, finest):
    """Return the axis across which a box is halved, or -1 where it is ready for faceting."""
    longest = 3
    for k in range(4, 6):
        if box[k] > box[longest]:
            longest = k
    if 2.0 * box[longest] <= finest:
        return -1
    most, axis = 0.0, -1
    flat = count <= _FEW
    for i in range(min(count, len(here))):
        turns = bending(functions[here[i]], box[0], box[1], box[2], box[3], box[4], box[5])
        if turns[0] + turns[1] + turns[2] > limit:
            flat = False
            for k in range(3):
                if turns[k] > most:
                    most, axis = turns[k], k
    if flat:
        return -1
    if axis < 0 or most == np.inf or box[longest] > _ASPECT * box[3 + axis]:
        return longest - 3
    return axis
