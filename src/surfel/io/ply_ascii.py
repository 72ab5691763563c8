"""The body of an ascii PLY file."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from surfel.core.cast import Floats, Integers
from surfel.io.columns import as_type
from surfel.io.ply_header import Columns, Element, Group, Header, Property
from surfel.io.rows import RowError, Rows, parse_rows
from surfel.io.source import Source
from surfel.io.table_rows import TableRows, Text

_RUN = 1 << 16


class AsciiBody:
    """Reads element after element; one record a line. Where it has got to is the position of the source."""

    def __init__(self, source: Source, header: Header) -> None:
        self._source = source
        self._newline = header.newline

    def scalars(self, element: Element, groups: list[Group]) -> Columns:
        """Return the values of each group of properties."""
        if element.lists:
            return self._sorted(element, groups, self._records(element, None, keep=True).values)
        rows = self._table(element)
        found = self._grouped(element, groups, rows, element.count)
        rows.finish()
        return found

    def runs(self, element: Element, groups: list[Group], size: int) -> Iterator[Columns]:
        """Yield the same for run after run of an element without lists, at least one."""
        rows = self._table(element)
        for first in range(0, max(1, element.count), size):
            yield self._grouped(element, groups, rows, min(size, element.count - first))
        rows.finish()

    def lists(self, element: Element, wanted: Property) -> tuple[Integers, Integers]:
        """Return the items of one list property laid end to end, and how many each record has."""
        rows = self._records(element, wanted, keep=False)
        return rows.items, rows.lengths

    def skip(self, element: Element) -> None:
        """Read past an element; its records have to be there all the same."""
        if element.lists or not element.properties:
            self._records(element, None, keep=False)
            return
        rows = self._table(element)
        left = element.count
        while left > 0:
            left -= len(rows.read(min(left, _RUN), all_of_them=left <= _RUN))
        rows.finish()

    def finish(self) -> None:
        """Refuse what comes after the last record."""
        at = self._source.position
        rest = self._source.rest()
        more = np.flatnonzero(rest > 32)
        if len(more):
            line = self._source.line_at(at + int(more[0]), self._newline)
            raise self._source.error(
                "there are more lines than the header announces", f"line {line}", "its counts are wrong; write it again"
            )

    def _table(self, element: Element) -> TableRows:
        return TableRows(self._source, len(element.properties), Text(self._newline), element.name)

    def _records(self, element: Element, wanted: Property | None, keep: bool) -> Rows:
        """Read records with lists among their values, from the rest of the file."""
        layout = tuple(0 if p.count_type is None else 2 if p is wanted else 1 for p in element.properties)
        start = self._source.position
        data = self._source.rest()
        try:
            rows = parse_rows(data, 0, layout, rows=element.count, keep=keep, newline=self._newline)
        except RowError as error:
            line = self._source.line_at(start + error.position, self._newline)
            raise self._source.error(
                error.problem, f"line {line}, {element.name} {error.row}", "the file was cut or changed; fetch it again"
            ) from None
        self._source.stream.seek(start + rows.end)
        return rows

    def _grouped(self, element: Element, groups: list[Group], rows: TableRows, count: int) -> Columns:
        """Read the next records of a plain element into an array for each group."""
        place = {p.name: i for i, p in enumerate(element.properties)}
        arrays = rows.read_groups(count, [[place[name] for name in group] for group in groups], all_of_them=True)
        found: Columns = {}
        for group, values in zip(groups, arrays, strict=True):
            kind = element.properties[place[group[0]]].type
            found[group] = (
                values if len(group) > 1 else as_type(self._source, element.name, group[0], values[:, 0], kind)
            )
        return found

    def _sorted(self, element: Element, groups: list[Group], values: Floats) -> Columns:
        """Sort the columns of a table into groups."""
        scalars = [p for p in element.properties if p.count_type is None]
        column = {p.name: i for i, p in enumerate(scalars)}
        found: Columns = {}
        for group in groups:
            chosen = values[:, [column[name] for name in group]]
            kind = scalars[column[group[0]]].type
            found[group] = (
                chosen if len(group) > 1 else as_type(self._source, element.name, group[0], chosen[:, 0], kind)
            )
        return found
