"""Execution is a policy, never a second algorithm: blocks, where they run, and how they are reduced."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any, Protocol, TypeVar

from surfel.core.errors import SurfelError

Task = TypeVar("Task")
Result = TypeVar("Result")

Progress = Callable[[float, str], None]
"""Called with the share done (0 to 1) and what is being done; may raise KeyboardInterrupt to stop the work."""


class Policy(Protocol):
    """Where blocks run: in this process, on a pool, on a cluster. Results come back in the order of the tasks."""

    def map(self, function: Callable[[Any], Any], tasks: Iterable[Any]) -> Iterable[Any]:
        """Apply ``function`` to each task and yield the results in order."""
        ...


class InProcess:
    """One block after another; the kernels inside use threads of their own."""

    def map(self, function: Callable[[Any], Any], tasks: Iterable[Any]) -> Iterator[Any]:
        """Apply ``function`` to each task in turn."""
        return map(function, tasks)


def blocks(items: int, size: int) -> list[tuple[int, int]]:
    """Cut ``items`` into (start, stop) runs of ``size``, the last one shorter."""
    return [(start, min(start + size, items)) for start in range(0, items, size)]


def run_blocks(
    function: Callable[[Task], Result],
    tasks: list[Task],
    policy: Policy | None = None,
    progress: Progress | None = None,
    label: str = "",
) -> list[Result]:
    """Apply ``function`` to each task and return the results in the order of the tasks.

    Because results are reduced in that order, the same tasks give the same bits wherever they ran.
    """
    results: list[Result] = []
    for result in (policy or InProcess()).map(function, tasks):
        results.append(result)
        if progress is not None:
            progress(len(results) / len(tasks), label)
    if len(results) != len(tasks):
        raise SurfelError(f"the execution policy gave {len(results)} results for {len(tasks)} tasks")
    return results
