"""Where a polynomial changes its sign along chords, found by its Bernstein form on each; for kernels alone.

A chord's polynomial is one in u from 0 to 1, of the same degree. Its values at as many Chebyshev nodes give its
Bernstein form, and that its roots (`surfel.roots.bernstein`). Beyond degree 20 rounding would grow too large on the
way: then the chord is cut until pieces of lower degree follow the polynomial to eleven digits.

What rounding cannot tell from zero counts as zero, and zero as positive, that is outside: at the ends of a chord (the
surface lies on the boundary of the shape around) and along a whole chord (the line lies in the surface).
"""

from __future__ import annotations

from surfel._numba import inlined, inner
from surfel.roots.bernstein import roots_of
from surfel.shapes.primitives.polynomial_values import evaluate, fill_powers, magnitude

_EPS = 2.220446049250313e-16
_SUSPECT = 1e-11  # smaller values are looked at closely: are they rounding?
_LIKE = 1e-11  # how near a piece of lower degree must follow the polynomial
_SHORTEST = 2.0**-8  # piece of a chord
_EXACT = 1e-13  # how well roots are found before they are polished


@inner
def find_roots(form, chords, block, scratch):
    """Find the roots on the first ``chords`` chords of a block, ascending, and the signs at their ends."""
    for b in range(chords):
        block.number[b] = 0
        _wait(scratch.pieces, b, chords - 1 - b, 0.0, 1.0)
    waiting = chords
    at_once = len(scratch.values) // len(form.nodes)
    while waiting > 0:
        done = min(waiting, at_once)
        waiting -= done
        _evaluate_pieces(form, waiting, done, block, scratch)
        split = _solve_pieces(form, waiting, done, block, scratch)
        for s in range(split):
            _wait(scratch.pieces, waiting + s, scratch.halves[s, 0], scratch.halves[s, 1], scratch.halves[s, 2])
        waiting += split
    if form.degrees[3] != len(form.nodes) - 1:
        for b in range(chords):
            _in_order(block.roots[b], block.number[b])
            if block.number[b] % 2 != (block.negative[b, 0] != block.negative[b, 1]):
                block.number[b] -= 1  # only where more were found than there is room for


@inlined
def _wait(pieces, row, chord, low, high):
    pieces[row, 0], pieces[row, 1], pieces[row, 2] = chord, low, high


@inner
def _evaluate_pieces(form, first, count, block, scratch):
    """Evaluate the polynomial at the nodes of some pieces."""
    v = 0
    for row in range(first, first + count):
        b, low, high = int(scratch.pieces[row, 0]), scratch.pieces[row, 1], scratch.pieces[row, 2]
        for node in form.nodes:
            u = low + (high - low) * node
            for axis in range(3):
                scratch.points[axis, v] = block.ends[b, axis] + u * block.along[b, axis]
            v += 1
    fill_powers(form, scratch.points, v, scratch.powers)
    evaluate(form, 0, scratch.powers, v, scratch.group, scratch.values)


@inner
def _solve_pieces(form, first, count, block, scratch):
    """Note the roots of the pieces that are of low degree, and return how many halves of others there are to do."""
    size = len(form.nodes)
    whole = form.degrees[3] == size - 1
    split = 0
    for p in range(count):
        row = first + p
        b, low, high = int(scratch.pieces[row, 0]), scratch.pieces[row, 1], scratch.pieces[row, 2]
        values = scratch.values[p * size : (p + 1) * size]
        _clear_rounding(form, values, low, high, block.ends[b], block.along[b], block.tolerances[b])
        full = high - low <= _SHORTEST or first + split + 2 > len(scratch.pieces)
        if not (whole or full or _follows(form, values, low, high, block.ends[b], block.along[b])):
            middle = 0.5 * (low + high)
            _wait(scratch.halves, split, b, middle, high)
            _wait(scratch.halves, split + 1, b, low, middle)
            split += 2
            continue
        if low == 0.0:
            block.negative[b, 0] = values[0] < 0.0
        if high == 1.0:
            block.negative[b, 1] = values[size - 1] < 0.0
        _to_bernstein(form, values, scratch.parts[0])
        for k in range(roots_of(size - 1, scratch.parts, _EXACT, scratch.solved)):
            if block.number[b] < block.roots.shape[1]:
                block.roots[b, block.number[b]] = low + (high - low) * scratch.solved[k]
                block.number[b] += 1
    return split


@inlined
def _clear_rounding(form, values, low, high, end, along, tolerance):
    """Set to zero what rounding cannot tell from it, at the ends of a chord and where a line lies in the surface."""
    last = len(values) - 1
    share = 2.0 * tolerance * (form.degrees[3] + 4)
    first = abs(values[0])
    if low == 0.0 and first < _SUSPECT and first <= share * magnitude(form, end[0], end[1], end[2]):
        values[0] = 0.0
    final = abs(values[last])
    if high == 1.0 and final < _SUSPECT:
        x, y, z = end[0] + along[0], end[1] + along[1], end[2] + along[2]
        if final <= share * magnitude(form, x, y, z):
            values[last] = 0.0
    if low == 0.0 and high == 1.0 and values[0] == 0.0 and values[last] == 0.0:
        largest = 0.0
        for value in values:
            largest = max(largest, abs(value))
        x, y, z = end[0] + along[0], end[1] + along[1], end[2] + along[2]
        x, y, z = max(abs(end[0]), abs(x)), max(abs(end[1]), abs(y)), max(abs(end[2]), abs(z))
        if largest < _SUSPECT and largest <= share * magnitude(form, x, y, z):
            for k in range(last + 1):
                values[k] = 0.0


@inlined
def _follows(form, values, low, high, end, along):
    """Tell whether the piece's highest Chebyshev coefficients have died out, or drown in rounding.

    A long piece may pass by mistake, as T_21 has the values of T_11 at 17 nodes; it is halved whatever they are.
    """
    largest, tail = 0.0, 0.0
    for k in range(len(values)):
        largest = max(largest, abs(values[k]))
    if largest == 0.0:
        return True
    if high - low > min(0.5, len(values) / form.degrees[3]):
        return False
    for row in range(3):
        coefficient = 0.0
        for k in range(len(values)):
            coefficient += form.tails[row, k] * values[k]
        tail = max(tail, abs(coefficient))
    if tail <= _LIKE * largest:
        return True
    noise = 0.0
    for u in (low, high):
        noise = max(noise, magnitude(form, end[0] + u * along[0], end[1] + u * along[1], end[2] + u * along[2]))
    return tail <= 4.0 * _EPS * noise


@inlined
def _to_bernstein(form, values, out):
    for k in range(len(values)):
        total = 0.0
        for j in range(len(values)):
            total += form.to_bernstein[k, j] * values[j]
        out[k] = total


@inlined
def _in_order(items, count):
    """Sort by insertion."""
    for k in range(1, count):
        item = items[k]
        j = k
        while j > 0 and items[j - 1] > item:
            items[j] = items[j - 1]
            j -= 1
        items[j] = item
