"""What a command prints: one table or one JSON object on the standard output, notes and progress on the other."""

from __future__ import annotations

import json
import math
import os
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any

from surfel import _notice
from surfel._notice import announce_compilation
from surfel.cli import warm

if TYPE_CHECKING:
    from subprocess import Popen

    from rich.console import RenderableType
    from rich.progress import Progress as Bar

    from surfel.core.execute import Progress

_BAR_AFTER_SECONDS = 0.5
_WIDTH_OF_A_PIPE = 160


_COLD = {
    "measure": "about 20 s on two cores, 30 s on one",
    "report": "about 80 s on two cores, two minutes on one",
}
"""What compiling takes for the jobs that a second process helps with."""


class Output:
    """Where one command's result, notes, warnings and progress go; use it as a context.

    Parameters
    ----------
    as_json : bool
        Print the result as one JSON object.
    quiet : bool
        Neither notes nor progress.
    measures : bool
        The command measures: where that has to be compiled first, a second process helps.
    """

    def __init__(self, as_json: bool, quiet: bool, *, measures: bool = False) -> None:
        self._as_json = as_json
        self._job = "measure" if measures else None
        self._helper: Popen[bytes] | None = None
        self._quiet = quiet
        self._bar: Bar | None = None
        self._heard: list[warnings.WarningMessage] = []
        self._listening = ExitStack()

    def __enter__(self) -> Output:
        """From here on compiling is told, warnings of surfel are collected, and those of other packages go unheard."""
        from surfel.core.errors import SurfelWarning

        self._heard = self._listening.enter_context(warnings.catch_warnings(record=True)) or []
        warnings.simplefilter("ignore")
        warnings.simplefilter("always", SurfelWarning)
        announce_compilation(self._compiling)
        return self

    def __exit__(self, *reason: object) -> None:
        """Warnings go their usual way again."""
        announce_compilation(None)
        self._listening.close()
        if self._helper is not None:
            warm.stop(self._helper)

    def _compiling(self) -> None:
        """Say that it takes a while, and have a second process help, unless this one belongs to other code."""
        how_long = _COLD.get(self._job or "", "some seconds")
        self.note(f"compiling kernels, once after installing, {how_long}")
        if self._job and _notice.own_process:
            self._helper = warm.start(self._job)

    def go_on_with(self, job: str) -> None:
        """Turn to another job, for which other kernels may have to be compiled."""
        warm.stop(self._helper)
        self._helper, self._job = None, job
        announce_compilation(self._compiling)

    def result(self, data: Mapping[str, Any], table: Callable[[], RenderableType]) -> None:
        """Print the result, for programs or for people, and each warning once: in the object if that has a place."""
        heard = [str(warning.message) for warning in self._heard]
        told = list(dict.fromkeys([*heard, *data.get("warnings", ())]))
        in_object = self._as_json and "warnings" in data
        if in_object:
            data = {**data, "warnings": told}
        text = json.dumps(plain(data), allow_nan=False) + "\n" if self._as_json else _rendered(table())
        encoding = getattr(sys.stdout, "encoding", None) or "utf-8"
        sys.stdout.write(text.encode(encoding, "backslashreplace").decode(encoding))
        sys.stdout.flush()
        for warning in () if in_object else told:
            self.note(f"warning: {warning}")

    def facts(self, data: Mapping[str, Any], title: str) -> None:
        """Print a flat result, as an object or as a table of two columns."""

        def table() -> RenderableType:
            from surfel.cli.tables import fact_table

            return fact_table(title, data)

        self.result(data, table)

    def note(self, text: str) -> None:
        """Say something on the standard error, unless quiet."""
        if self._quiet:
            return
        if self._bar is not None:
            self._bar.console.print(f"surfel: {text}", markup=False, highlight=False)
        else:
            print(f"surfel: {shown(text)}", file=sys.stderr, flush=True)

    @contextmanager
    def work(self) -> Iterator[Progress]:
        """Give a progress callback, shown as a bar once the work gets long."""
        started = time.monotonic()
        task: Any = None

        def advance(share: float, label: str) -> None:
            nonlocal task
            if self._bar is None:
                if self._quiet or not sys.stderr.isatty() or time.monotonic() - started < _BAR_AFTER_SECONDS:
                    return
                self._bar = _new_bar()
                self._bar.start()
                task = self._bar.add_task(label, total=1.0)
            self._bar.update(task, completed=share, description=label)

        try:
            yield advance
        finally:
            if self._bar is not None:
                self._bar.stop()
                self._bar = None


def plain(value: Any) -> Any:
    """Return plain Python objects that JSON can hold; what is not finite becomes None."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):  # an array or a scalar of numpy, without importing it
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, str):
        return value.encode("utf-8", "backslashreplace").decode("utf-8")
    return value if value is None or isinstance(value, bool | int | float) else str(value)


def shown(path: str | os.PathLike[str]) -> str:
    """Return a file name, or a text that holds one, as any terminal can print it."""
    return os.fspath(path).encode("utf-8", "backslashreplace").decode("utf-8")


def _new_bar() -> Bar:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn())
    return Progress(*columns, console=Console(stderr=True), transient=True)


def _rendered(table: RenderableType) -> str:
    """Draw into a string: rich leaves the process by itself when a pipe breaks, and that is for `main` to say."""
    from io import StringIO

    from rich.console import Console

    terminal = sys.stdout.isatty()
    console = Console(file=StringIO(), force_terminal=terminal, width=None if terminal else _WIDTH_OF_A_PIPE)
    console.print(table)
    drawn = console.file.getvalue()  # type: ignore[attr-defined]
    return "\n".join(line.rstrip() for line in drawn.splitlines()) + "\n"
