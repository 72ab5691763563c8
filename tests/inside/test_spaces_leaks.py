"""Leaks: films over holes part inside and outside for good, and what the conflict says of holes and of flips."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from surfel.inside.classify import Classifier
from surfel.inside.colour import colour_space
from surfel.inside.grid import BORDER, IN, OUT, Grid
from surfel.inside.judges.winding import winding_numbers
from surfel.inside.leaks import in_doubt
from surfel.inside.operand import Operand

Floats = np.ndarray


def sphere(n: int, seed: int = 0) -> Floats:
    p = np.random.default_rng(seed).standard_normal((n, 3))
    return p / np.linalg.norm(p, axis=1, keepdims=True)


def places(n: int = 40_000) -> Floats:
    return np.random.default_rng(9).uniform(-1.2, 1.2, (n, 3))


def bowl(n: int, least: float) -> Operand:
    """Return a sphere without what lies below a height."""
    p = sphere(n)
    kept = p[p[:, 2] > least]
    return Operand.of(kept, kept)


def dense(grid: Grid) -> np.ndarray:
    """Return the colour of every cell."""
    colours = np.zeros(tuple(8 * s for s in grid.table.shape), int)
    for place in np.ndindex(*grid.table.shape):
        brick, box = grid.table[place], tuple(slice(8 * p, 8 * p + 8) for p in place)
        if brick < 0:
            colours[box] = -1 - brick
            continue
        shifts = np.arange(64, dtype=np.uint64)
        border, inside = (
            (words[brick][:, None] >> shifts & np.uint64(1)).reshape(8, 8, 8) for words in (grid.border, grid.inside)
        )
        colours[box] = np.where(border > 0, BORDER, np.where(inside > 0, IN, OUT))
    return colours


@pytest.mark.parametrize(("n", "least"), [(2000, -0.5), (2000, 0.0), (20_000, -0.95), (20_000, 0.3)])
def test_films_part_inside_from_outside(n: int, least: float) -> None:
    found = colour_space(bowl(n, least))
    colours = dense(found.grid)
    assert found.leaky and (colours == IN).any()
    for axis in range(3):
        a, b = np.moveaxis(colours, axis, 0)[1:], np.moveaxis(colours, axis, 0)[:-1]
        assert not ((a == IN) & (b == OUT)).any() and not ((a == OUT) & (b == IN)).any()
    _, parts = ndimage.label(colours == IN)
    assert parts <= 3


@pytest.mark.parametrize(("n", "least"), [(2000, -0.5), (20_000, 0.0)])
def test_free_cells_have_the_side_of_their_winding_number(n: int, least: float) -> None:
    cloud = bowl(n, least)
    found = colour_space(cloud)
    colours, grid = dense(found.grid), found.grid
    cells = np.argwhere(colours != BORDER)
    cells = cells[np.random.default_rng(0).permutation(len(cells))[:5000]]
    number = winding_numbers(cloud, grid.low + (cells + 0.5) * grid.step + cloud.origin)
    clear = np.abs(number - 0.5) > 0.05
    assert ((number > 0.5) == (colours[tuple(cells.T)] == IN))[clear].mean() > 0.999


def test_doubt_lies_over_the_hole_alone() -> None:
    cloud = bowl(20_000, -0.8)
    found = colour_space(cloud)
    q = places()
    assert found.doubt is not None
    doubtful = q[in_doubt(found.grid, found.doubt, q - cloud.origin)]
    assert len(doubtful) > 10
    assert (np.abs(doubtful[:, 2] + 0.8) < 3.0 * found.grid.step).all()
    assert (np.linalg.norm(doubtful[:, :2], axis=1) < 0.6 + 2.0 * found.grid.step).all()


@pytest.mark.parametrize("n", [3000, 30_000])
def test_every_one_of_many_holes_is_closed(n: int) -> None:
    p, golden = sphere(n), 0.5 * (1.0 + 5.0**0.5)
    middles = np.array([np.roll([0.0, a, b * golden], k) for k in range(3) for a in (-1, 1) for b in (-1, 1)])
    kept = p[(p @ middles.T).max(axis=1) < np.cos(0.3) * np.sqrt(1.0 + golden**2)]
    classifier = Classifier(Operand.of(kept, kept))
    q = places()
    clear = np.abs(np.linalg.norm(q, axis=1) - 1.0) > 0.1
    assert classifier.leaky
    assert (classifier.classify(q).inside != (np.linalg.norm(q, axis=1) < 1.0))[clear].mean() < 0.001


def test_a_hollow_with_a_hole_in_each_wall() -> None:
    p = sphere(20_000)
    outer = p[np.abs(p[:, 0] - 0.97) > 0.05]
    inner = p[np.abs(p[:, 1] + 0.97) > 0.05]
    classifier = Classifier(Operand.of(np.concatenate([outer, 0.6 * inner]), np.concatenate([outer, -inner])))
    q = places()
    far = np.linalg.norm(q, axis=1)
    clear = (np.abs(far - 1.0) > 0.12) & (np.abs(far - 0.6) > 0.12)
    assert classifier.leaky
    assert (classifier.classify(q).inside != ((far < 1.0) & (far > 0.6)))[clear].mean() < 0.002


def test_conflict_is_nothing_closed_little_open_and_more_with_flips() -> None:
    p = sphere(20_000)
    flip = np.random.default_rng(1).random(len(p)) < 0.1
    spoilt = np.where(flip[:, None], -p, p)
    kept = p[:, 2] > -0.9
    closed, flipped = Classifier(Operand.of(p, p)), Classifier(Operand.of(p, spoilt))
    open_, both = Classifier(Operand.of(p[kept], p[kept])), Classifier(Operand.of(p[kept], spoilt[kept]))
    assert closed.conflict == 0.0 and not closed.leaky
    assert flipped.conflict == pytest.approx(0.1, abs=0.03) and not flipped.leaky
    assert open_.leaky and 0.0 < open_.conflict < 0.03
    assert both.leaky and both.conflict > open_.conflict + 0.05


@pytest.mark.parametrize("least", [0.0, -0.5, -0.9])
def test_a_clean_open_cloud_has_little_conflict_however_wide_it_is_open(least: float) -> None:
    p = sphere(20_000)
    p = p[p[:, 2] > least]
    turned = np.random.default_rng(1).random(len(p)) < 0.1
    clean, flipped = Classifier(Operand.of(p, p)), Classifier(Operand.of(p, np.where(turned[:, None], -p, p)))
    assert clean.leaky and 0.0 < clean.conflict < 0.06
    assert flipped.conflict > clean.conflict + 0.05


def test_films_are_about_the_same_whatever_the_order_of_the_points() -> None:
    p = sphere(20_000)
    p = p[p[:, 2] > -0.8]
    mixed = np.random.default_rng(0).permutation(len(p))
    a, b = Classifier(Operand.of(p, p)), Classifier(Operand.of(p[mixed], p[mixed]))
    assert (a.classify(places()).kind != b.classify(places()).kind).mean() < 1e-4
    assert a.conflict == pytest.approx(b.conflict, abs=0.002)


@pytest.mark.parametrize("share", [0.1, 0.2])
def test_an_open_surface_with_flipped_surfels_is_closed_where_it_is_open(share: float) -> None:
    """Rims beside flipped surfels would be everywhere, and a film through their winding numbers lie off."""
    rng = np.random.default_rng(3)
    points = rng.standard_normal((50_000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    points = points[points[:, 2] > 0.0]
    normals = np.where(rng.random(len(points))[:, None] < share, -points, points)
    half = Classifier(Operand.of(points, normals))
    places = rng.uniform([-1.1, -1.1, -0.3], 1.1, (20_000, 3))
    places = places[np.abs(places[:, 2]) > 0.1]
    true = (np.linalg.norm(places, axis=1) < 1.0) & (places[:, 2] > 0.0)
    assert half.leaky
    assert (half.classify(places).inside != true).mean() < 0.003
