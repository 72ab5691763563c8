"""Safe surfaces, beside what else gives one: least squares that is lifted, and the linear program.

``LSQBivariateSpline + lift`` fits by least squares on the same knots (SciPy) and raises all by the largest residual.
The linear program is the yardstick for tightness: of all splines on the same grid that lie above all points, with
coefficients within ten ranges of the heights, it has the smallest mean gap. HiGHS solves it through SciPy, by its
interior-point method and without presolving, which is faster here than its other ways.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

import surfel
from benchmarks.heights import RANDOM, bunny
from benchmarks.shapes import NoDataError
from benchmarks.tables import busy, made_on, seconds, table

GRID = (20, 20)
POINTS = 30_000
RANGES = 10.0
TARGETS = {"fast": 2.0, "tight": 1.03}
FASTER = 100.0
APART = "clumps"
"""A cloud for which no aim was set: five clumps on a smooth surface with nothing between them."""

Points = np.ndarray


@dataclass(frozen=True)
class Answer:
    """What one method gave on one cloud: gaps in the units of the heights, NaN where it failed."""

    case: str
    method: str
    gap_mean: float
    gap_max: float
    above: int
    seconds: float
    note: str = ""


@dataclass(frozen=True, eq=False)
class Domain:
    """The grid of a surfel fit, on which the peers work too: coordinates in cells, heights, and the basis there."""

    uv: Points
    heights: Points

    @classmethod
    def of(cls, points: Points) -> Domain:
        """Take the grid that surfel lays over the points."""
        return cls(*surfel.bound(points, shape=GRID).to_domain(points))

    def basis(self):
        """Return the sparse matrix of the bicubic B-splines at the points: (n, 22 * 22), open ends."""
        from scipy.sparse import csr_array

        n = len(self.uv)
        weights, first = [], []
        for k in (0, 1):
            cell = np.minimum(self.uv[:, k].astype(int), GRID[k] - 2)
            t = self.uv[:, k] - cell
            q = 1.0 - t
            weights.append(
                np.stack([q**3, 4 + t * t * (3 * t - 6), 4 + q * q * (3 * q - 6), t**3], axis=1) / 6.0
            )  # fmt: skip
            first.append(cell)
        values = np.einsum("ki,kj->kij", *weights).reshape(n, 16)
        rows = first[0][:, None, None] + np.arange(4)[None, :, None]
        columns = (rows * (GRID[1] + 2) + first[1][:, None, None] + np.arange(4)[None, None, :]).reshape(n, 16)
        shape = (n, (GRID[0] + 2) * (GRID[1] + 2))
        return csr_array((values.ravel(), columns.ravel(), np.arange(0, 16 * n + 1, 16)), shape=shape)


def by_surfel(points: Points, mode: str) -> tuple[Points, float, str]:
    """Return the gaps, the time and a note."""
    start = time.process_time()
    fitted = surfel.bound(points, shape=GRID, mode=mode)
    spent = time.process_time() - start
    uv, heights = fitted.to_domain(points)
    bound = fitted.report.dual_bound
    note = "" if bound is None else f"no spline below {bound:.6g}"
    return fitted(uv) - heights, spent, note


def by_least_squares(points: Points) -> tuple[Points, float, str]:
    """Return the gaps of SciPy's least-squares spline on the same knots, raised by the largest residual."""
    import warnings

    from scipy.interpolate import LSQBivariateSpline

    domain = Domain.of(points)
    u, v = domain.uv.T
    start = time.process_time()
    inner = [np.arange(1.0, size - 1.0) for size in GRID]
    box = [0.0, GRID[0] - 1.0, 0.0, GRID[1] - 1.0]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # on clouds with holes it says that the system is rank deficient
        spline = LSQBivariateSpline(u, v, domain.heights, *inner, bbox=box)
        values = spline.ev(u, v)
    lifted = values + max(0.0, float((domain.heights - values).max()))
    return lifted - domain.heights, time.process_time() - start, ""


def by_linear_program(points: Points) -> tuple[Points, float, str]:
    """Return the gaps of the spline above all points that has the smallest mean gap."""
    from scipy.optimize import linprog

    domain = Domain.of(points)
    middle = 0.5 * (domain.heights.max() + domain.heights.min())
    half = 0.5 * float(np.ptp(domain.heights))
    z = (domain.heights - middle) / half
    basis = domain.basis()
    mean = np.asarray(basis.sum(axis=0)).ravel() / len(z)
    limits = (-1.0 - 2.0 * RANGES, 1.0 + 2.0 * RANGES)
    for method in ("highs-ipm", "highs-ds"):  # the fastest first; the presolver gives up on some clouds
        start = time.process_time()
        options = {"presolve": False}
        found = linprog(mean, A_ub=-basis, b_ub=-z, bounds=limits, method=method, options=options)
        if found.x is not None and found.status == 0:
            return (basis @ found.x - z) * half, time.process_time() - start, method
    raise RuntimeError(found.message)


METHODS: dict[str, Callable[[Points], tuple[Points, float, str]]] = {
    "surfel, paper": lambda points: by_surfel(points, "paper"),
    "surfel, fast": lambda points: by_surfel(points, "fast"),
    "surfel, tight": lambda points: by_surfel(points, "tight"),
    "LSQBivariateSpline + lift": by_least_squares,
    "linear program (HiGHS)": by_linear_program,
}
YARDSTICK = "linear program (HiGHS)"


def clouds(*, quick: bool = False) -> Iterator[tuple[str, Callable[[], Points]]]:
    """Yield the cases: a label, and what makes its cloud."""
    n = 3_000 if quick else POINTS
    for name, make in RANDOM.items():
        yield f"{name}, {n:,}", lambda make=make: make(n, np.random.default_rng(0))
    if not quick:
        yield "bunny range scan, 40,256", bunny


def run(cases: Iterator[tuple[str, Callable[[], Points]]], *, repeats: int = 5) -> list[Answer]:
    """Ask every method about every cloud, printing each answer; surfel and least squares several times."""
    warm = RANDOM["smooth"](2_000, np.random.default_rng(1))
    for name in list(METHODS)[:4]:
        METHODS[name](warm)
    found = []
    for label, make in cases:
        try:
            points = make()
        except NoDataError as absent:
            print(f"{label} | skipped: {absent}", flush=True)
            continue
        for name, method in METHODS.items():
            answer = _asked(label, name, method, points, 1 if name == YARDSTICK else repeats)
            found.append(answer)
            print(
                f"{label:26s} | {name:26s} | mean gap {answer.gap_mean:.6f} | {seconds(answer.seconds):>8s}"
                f" | {answer.above} above | {answer.note}",
                flush=True,
            )
    return found


def _asked(
    label: str, name: str, method: Callable[[Points], tuple[Points, float, str]], points: Points, repeats: int
) -> Answer:
    from surfel._numba import threads_for

    try:
        with threads_for(0):
            runs = [method(points) for _ in range(repeats)]
    except Exception as error:  # a peer that fails on a cloud is a result
        return Answer(label, name, math.nan, math.nan, 0, math.nan, f"failed: {type(error).__name__}: {error}")
    gaps, _, note = runs[-1]
    return Answer(
        label, name, float(gaps.mean()), float(gaps.max()), int((gaps < 0.0).sum()),
        float(np.median([spent for _, spent, _ in runs])), note,
    )  # fmt: skip


def report(answers: list[Answer]) -> str:
    """Return the result as Markdown: gaps over the linear program's, times, and how much faster."""
    at = {(answer.case, answer.method): answer for answer in answers}
    labels = list(dict.fromkeys(answer.case for answer in answers))
    others = [name for name in METHODS if name != YARDSTICK]
    ratios = [
        [label, f"{at[label, YARDSTICK].gap_mean:.6f}", *(_ratio(at[label, n], at[label, YARDSTICK]) for n in others)]
        for label in labels
    ]
    largest = [[label, *(f"{at[label, name].gap_max:.5f}" for name in METHODS)] for label in labels]
    times = [[label, *(seconds(at[label, name].seconds) for name in METHODS)] for label in labels]
    above = [[label, *(str(at[label, name].above) for name in METHODS)] for label in labels]
    return f"""# Safe surfaces, beside peers

{made_on()} {busy()}

Coefficients of {GRID[0]} x {GRID[1]} (open ends: two more in each direction), the same grid for every method,
surface above the points. Processor time on one thread, medians of a few runs with kernels in the cache; the linear
program ran once. Its coefficients are kept within {RANGES:g} ranges of the heights, without which they run off wherever
there are no points.

## Mean gap, over that of the linear program

Aimed at: `fast` at most {TARGETS["fast"]:g}, `tight` at most {TARGETS["tight"]:g}.

{table(["cloud", "LP: mean gap", *others], ratios)}
{_verdicts(at, labels)}

## Time

Aimed at: {FASTER:g} times faster than the linear program at an equal gap.

{table(["cloud", *METHODS], times)}
## Largest gap

{table(["cloud", *METHODS], largest)}
## Points above the surface

By each method's own evaluation. The program meets its constraints to a tolerance of 1e-7, so it is not safe.

{table(["cloud", *METHODS], above)}"""


def _ratio(answer: Answer, yardstick: Answer) -> str:
    ratio = answer.gap_mean / yardstick.gap_mean
    return f"{ratio:.3f}" if math.isfinite(ratio) else "failed"


def _verdicts(at: dict[tuple[str, str], Answer], labels: list[str]) -> str:
    """Say which aims were met, on the clouds that they were set for; the others are told apart."""
    lines = []
    for mode, target in TARGETS.items():
        ratios = {label: at[label, f"surfel, {mode}"].gap_mean / at[label, YARDSTICK].gap_mean for label in labels}
        lines.append(f"- `{mode}`: {_judged({k: r <= target for k, r in ratios.items()}, ratios, '.3f')}.")
    gains = {label: at[label, YARDSTICK].seconds / at[label, "surfel, tight"].seconds for label in labels}
    told = _judged({k: gain >= FASTER for k, gain in gains.items()}, gains, ".0f")
    lines.append(f"- `tight` at least {FASTER:g} times faster than the program: {told}.")
    return "\n".join(lines) + "\n"


def _judged(met: dict[str, bool], values: dict[str, float], digits: str) -> str:
    aimed = [label for label in met if not label.startswith(APART)]
    missed = [f"{label} ({values[label]:{digits}})" for label in aimed if not met[label]]
    text = "met on every cloud that it was set for" if not missed else f"missed on {'; '.join(missed)}"
    apart = [f"{label} ({values[label]:{digits}})" for label in met if label.startswith(APART) and not met[label]]
    return text + (f"; not reached on {'; '.join(apart)}, for which it was not set" if apart else "")
