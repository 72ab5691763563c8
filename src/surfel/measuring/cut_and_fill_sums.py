"""From differences of height to volumes: which places rose and which sank, and how sure the sums are.

Noise must not count as cut and fill. Taking the positive part of noisy differences would: of an unchanged place half
the noise is positive. So the points are halved. One half says whether a place rose or sank, the other one by how much,
and then the other way round: where nothing changed the two do not know of each other, and their product is nothing.
The sign is that of the finest surroundings of a place that are sure of theirs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from surfel.core.cast import Booleans, Floats, Integers
from surfel.core.estimate import Estimate
from surfel.measuring.cut_and_fill_region import Lattice

_SURE = 2.0  # standard deviations that make a sign sure
_WIDER, _WIDEST_OF_CELLS = 4, 8  # deviations are means over 16 blocks squared, and at the least 256 cells squared
_MISSED = 0.17  # of its standard deviation: what an unsure difference loses at the most where its sign is a guess
_SOME = 0.7  # share of what signs may lose that they lose in the mean
_COARSE = 5.0  # spacings of a block in which noise cancels
_SMOOTH = 2.5  # spacings over which a difference is taken that may be lost
_SHARED = 1.5  # spacings: points at the edge of a block count for two, which hides this share of a block's variance
_LEFT = 0.3  # share of a corrected bias that may be left


class Differences(NamedTuple):
    """Heights after minus heights before, at the cells of a lattice that lie in its polygon.

    Parameters
    ----------
    whole, first, second : Floats, shape (m,)
        From all points, and from either half.
    missed : Floats, shape (m,)
        What straight lines between the points may miss.
    seen : Booleans, shape (m,)
        Where both surveys have points nearby.
    """

    whole: Floats
    first: Floats
    second: Floats
    missed: Floats
    seen: Booleans


@dataclass(frozen=True, eq=False)
class Sums:
    """Volumes with their errors, and the area that was not seen."""

    cut: Estimate
    fill: Estimate
    net: Estimate
    unseen: float


def add_up(lattice: Lattice, cells: Integers, change: Differences, spacing: float, block: float) -> Sums:
    """Add up differences over a region.

    The errors come from blocks that are large against the spacing: what the two halves say of them differs by chance.

    Parameters
    ----------
    lattice : Lattice
        The region.
    cells : Integers, shape (m,)
        The flat numbers of the cells in it.
    change : Differences
        There.
    spacing : float
        Of the points.
    block : float
        Side of the blocks, in spacings.
    """
    share = lattice.share.ravel()[cells]
    wide = max(0, round(float(np.log2(_COARSE * spacing / lattice.step))))
    rose = [_rose(lattice, cells, change, half, wide) for half in (change.first, change.second)]
    rest = change.whole - 0.5 * (change.first + change.second)
    number = _block_numbers(lattice, cells, block * spacing)
    gap, unseen = _gap_error(lattice, cells, change)

    def estimate(first: Floats, second: Floats, where: Floats, lost: float, doubt: float) -> Estimate:
        halves = [_by_number(number, share * part) for part in (first, second)]
        missed = _by_number(number, share * change.missed * where)
        more = float(np.sum(share * rest * where)) + lost
        return _estimate(halves, more, missed, float(np.hypot(doubt, gap)), block)

    rising = 0.5 * (rose[0].coarse + rose[1].coarse)
    sinking = rising - 1.0
    most, guessed = _lost(lattice, cells, change, rose, spacing)
    lost, doubt = _SOME * most, float(np.hypot((1.0 - _SOME) * most, guessed))
    fill = estimate(change.first * rose[1].mask, change.second * rose[0].mask, rising, lost, doubt)
    cut = estimate(change.first * (rose[1].mask - 1.0), change.second * (rose[0].mask - 1.0), sinking, lost, doubt)
    net = estimate(change.first, change.second, np.ones(len(cells)), 0.0, 0.0)
    return Sums(_not_negative(cut), _not_negative(fill), net, unseen)


def _by_number(number: Integers, values: Floats) -> Floats:
    """Add up the values of each number."""
    return np.asarray(np.bincount(number, values), np.float64)


class _Rose(NamedTuple):
    """Where the ground rose (1), sank (0) or neither (1/2), by fine and by coarse blocks, and how unsure guesses are.

    What all points say beyond either half holds the noise of both: it must not meet signs that this noise has made, but
    those of blocks in which it cancels.
    """

    mask: Floats
    coarse: Floats
    guess: Floats


def _rose(lattice: Lattice, cells: Integers, change: Differences, half: Floats, wide: int) -> _Rose:
    """Tell from one half where the ground rose: by the finest blocks of 1, 2, 4, ... cells that are sure of it."""
    weight = lattice.share
    value, apart = (
        _dense(lattice, cells, weight.ravel()[cells] * each) for each in (half, change.first - change.second)
    )
    levels: list[tuple[Floats, Booleans, Floats]] = []
    while True:
        mean, difference = _over(value, weight), _over(apart, weight)
        error = np.sqrt(0.5 * _around(difference**2, weight, max(_WIDER, _WIDEST_OF_CELLS - len(levels))))
        levels.append((np.sign(mean), np.abs(mean) > _SURE * error, error))
        if max(mean.shape) <= 4:
            break
        weight, value, apart = _coarser(weight), _coarser(value), _coarser(apart)
    sign, sure, error = levels[-1]
    coarse, guess = sign, np.where(sure, 0.0, error)
    for level in range(len(levels) - 2, -1, -1):
        here, sure, _ = levels[level]
        sign = np.where(sure, here, _finer(sign, here.shape))
        coarse = sign if level >= wide else _finer(coarse, here.shape)
        guess = np.where(sure, 0.0, _finer(guess, here.shape))
    fine, coarse = (0.5 * (1.0 + each.ravel()[cells]) for each in (sign, coarse))
    return _Rose(fine, coarse, guess.ravel()[cells])


def _dense(lattice: Lattice, cells: Integers, values: Floats) -> Floats:
    full = np.zeros(lattice.shape)
    full.ravel()[cells] = values
    return full


def _over(total: Floats, weight: Floats) -> Floats:
    return np.divide(total, weight, out=np.zeros_like(total), where=weight > 0.0)


def _around(value: Floats, weight: Floats, steps: int) -> Floats:
    """Return the mean over blocks of ``2^steps`` squared: so many that no place decides its own."""
    total, shapes = value * weight, []
    for _ in range(steps):
        shapes.append(total.shape)
        total, weight = _coarser(total), _coarser(weight)
    mean = _over(total, weight)
    for shape in reversed(shapes):
        mean = _finer(mean, shape)
    return mean


def _half(shape: tuple[int, ...]) -> tuple[int, int]:
    return (shape[0] + 1) // 2, (shape[1] + 1) // 2


def _coarser(array: Floats) -> Floats:
    """Add up two by two cells; the last ones may be fewer."""
    rows, columns = _half(array.shape)
    if (2 * rows, 2 * columns) != array.shape:
        array = np.pad(array, ((0, 2 * rows - array.shape[0]), (0, 2 * columns - array.shape[1])))
    pairs = array[::2] + array[1::2]
    return np.asarray(pairs[:, ::2] + pairs[:, 1::2])


def _finer(array: Floats, shape: tuple[int, ...]) -> Floats:
    """Give each of two by two cells the value of their block."""
    return np.repeat(np.repeat(array, 2, axis=0), 2, axis=1)[: shape[0], : shape[1]]


def _lost(
    lattice: Lattice, cells: Integers, change: Differences, rose: list[_Rose], spacing: float
) -> tuple[float, float]:
    """Return what wrong signs lose, half of the difference where the halves contradict each other, and may lose beyond.

    How large it is there is told by the product of both, which is nothing in the mean where nothing changed.
    """
    steps = max(0, round(float(np.log2(_SMOOTH * spacing / lattice.step))))
    first, second = (
        _around(_dense(lattice, cells, half), lattice.share, steps).ravel()[cells]
        for half in (change.first, change.second)
    )
    share = lattice.share.ravel()[cells]
    parted = share * np.abs(rose[0].mask - rose[1].mask)
    area = float(parted.sum())
    usual = np.sqrt(max(0.0, float(np.sum(parted * first * second)) / area)) if area > 0.0 else 0.0
    guessed = float(np.sum(share * (rose[0].guess + rose[1].guess)))
    return 0.5 * area * float(usual), 0.5 * _MISSED * guessed


def _block_numbers(lattice: Lattice, cells: Integers, block: float) -> Integers:
    """Return the number of the block that each cell lies in."""
    width = max(1, round(block / lattice.step))
    u, v = np.divmod(cells, lattice.shape[1])
    return np.asarray((u // width) * (lattice.shape[1] // width + 1) + v // width)


def _estimate(halves: list[Floats], rest: float, missed: Floats, doubt: float, block: float) -> Estimate:
    """Join the mean of both halves, what all points tell beyond it, and the errors, from sums over blocks.

    What straight lines miss is added where it is more than chance.
    """
    mean, apart = 0.5 * (halves[0] + halves[1]), 0.5 * (halves[0] - halves[1])
    squares = apart**2
    variance = float(squares.sum()) * (1.0 + _SHARED / block)
    bias, chance = float(missed.sum()), float(np.sum(missed**2))
    trust = max(0.0, 1.0 - 2.0 * chance / bias**2) if bias != 0.0 else 0.0
    value = float(mean.sum()) + rest + trust * bias
    left = (_LEFT * trust + (1.0 - trust)) * abs(bias)
    error = float(np.sqrt(variance + trust**2 * chance + left**2 + doubt**2))
    freedom = max(3.0, 3.0 * float(squares.sum()) ** 2 / float(np.sum(squares**2)) - 2.0) if variance > 0.0 else np.inf
    return Estimate(value, error, freedom=freedom)


def _gap_error(lattice: Lattice, cells: Integers, change: Differences) -> tuple[float, float]:
    """Return what may be wrong where a survey saw nothing, and the area of that.

    A straight line across a gap errs by about what differences vary by within places of twice the width of the gap.
    """
    share, seen = lattice.share.ravel()[cells], change.seen
    unseen = float(share[~seen].sum())
    if unseen == 0.0:
        return 0.0, 0.0
    from scipy.ndimage import label

    there = _dense(lattice, cells, (~seen).astype(np.float64)) > 0.0
    areas = np.bincount(label(there)[0].ravel(), lattice.share.ravel() * there.ravel())[1:]
    steps = np.ceil(np.log2(np.maximum(1.0, 2.0 * np.sqrt(areas) / lattice.step))).astype(np.int64)
    variation = _variation(lattice, cells, change.whole, int(steps.max()))
    return float(np.sqrt(np.sum((areas * variation[steps]) ** 2))), unseen


def _variation(lattice: Lattice, cells: Integers, values: Floats, most: int) -> Floats:
    """Return the standard deviation within blocks of 1, 2, 4, ... cells squared."""
    weight = lattice.share
    middle = float(np.average(values, weights=weight.ravel()[cells]))  # first, so that squares lose no digits
    value = _dense(lattice, cells, values - middle) * weight
    total, square = float(weight.sum()), float(np.sum(_over(value, weight) ** 2 * weight))
    found = []
    for _ in range(most + 1):
        found.append(np.sqrt(max(0.0, square - float(np.sum(_over(value, weight) * value))) / total))
        value, weight = _coarser(value), _coarser(weight)
    return np.array(found)


def _not_negative(estimate: Estimate) -> Estimate:
    """Return a volume that noise took below nothing as nothing."""
    if float(estimate.value) >= 0.0:
        return estimate
    return Estimate(0.0, estimate.standard_error, estimate.reliable, estimate.reason, estimate.freedom)
