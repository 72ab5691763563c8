"""The body of an ascii PLY file."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Integers
from surfel.core.errors import FileFormatError
from surfel.io.ply_header import Element, Header, Property
from surfel.io.rows import RowError, Rows, line_of, located, parse_rows
from surfel.io.source import Source


class AsciiBody:
    """Reads element after element; one record a line."""

    def __init__(self, source: Source, header: Header) -> None:
        self._source = source
        self._newline = header.newline
        start = source.position
        source.stream.seek(0)
        self._data = source.rest()  # with the header, so that line numbers are those of the file
        self._at = start

    def scalars(self, element: Element, groups: list[tuple[str, ...]]) -> dict[tuple[str, ...], NDArray[Any]]:
        """Return the values of each group of properties: (n, k) doubles for k > 1, else (n,) in the declared type."""
        rows = self._rows(element, None, keep=True)
        scalars = [p for p in element.properties if p.count_type is None]
        column = {p.name: i for i, p in enumerate(scalars)}
        kind = {p.name: p.type for p in scalars}
        found: dict[tuple[str, ...], NDArray[Any]] = {}
        for group in groups:
            chosen = [column[name] for name in group]
            if len(group) > 1 and chosen == list(range(chosen[0], chosen[0] + len(group))) and not found:
                found[group] = np.ascontiguousarray(rows.values[:, chosen[0] : chosen[0] + len(group)])
            elif len(group) > 1:
                found[group] = rows.values[:, chosen]
            else:
                found[group] = self._typed(element, group[0], rows.values[:, chosen[0]], kind[group[0]])
        return found

    def lists(self, element: Element, wanted: Property) -> tuple[Integers, Integers]:
        """Return the items of one list property laid end to end, and how many each record has."""
        rows = self._rows(element, wanted, keep=False)
        return rows.items, rows.lengths

    def skip(self, element: Element) -> None:
        """Read past an element; its records have to be there all the same."""
        self._rows(element, None, keep=False)

    def finish(self) -> None:
        """Refuse what comes after the last record."""
        rest = self._data[self._at :]
        more = np.flatnonzero(rest > 32)
        if len(more):
            line = line_of(self._data, self._at + int(more[0]), self._newline)
            raise self._source.error(
                "there are more lines than the header announces", f"line {line}", "its counts are wrong; write it again"
            )

    def _rows(self, element: Element, wanted: Property | None, keep: bool) -> Rows:
        layout = tuple(0 if p.count_type is None else 2 if p is wanted else 1 for p in element.properties)
        try:
            rows = parse_rows(
                self._data, self._at, layout, rows=element.count, keep=keep, newline=self._newline
            )  # fmt: skip
        except RowError as error:
            raise self._located(error, element) from None
        self._at = rows.end
        return rows

    def _typed(
        self, element: Element, name: str, values: NDArray[np.float64], kind: np.dtype[np.generic]
    ) -> NDArray[Any]:
        if kind.kind == "f":
            with np.errstate(over="ignore"):
                return values.astype(kind)
        limits = np.iinfo(kind)  # type: ignore[type-var]
        wrong = ~((values >= limits.min) & (values <= limits.max) & (values == np.floor(values)))
        if wrong.any():
            row = int(np.flatnonzero(wrong)[0])
            raise self._source.error(
                f"{name} is {values[row]:g}, which is no {kind.name}", f"{element.name} {row}", "the file was changed"
            )
        return values.astype(kind)

    def _located(self, error: RowError, element: Element) -> FileFormatError:
        return located(self._source, self._data, error, self._newline, element.name)
