"""The body of a binary PLY file, of either byte order."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Integers
from surfel.io.parts import in_parts
from surfel.io.ply_header import Columns, Element, Group, Header, Property
from surfel.io.source import Bytes, Source

_BLOCK = 1 << 18  # bytes: a block and its columns stay in the cache
_CUT = "the file was cut or its header is wrong; fetch it again"


class BinaryBody:
    """Reads element after element; records without lists in blocks, records with lists by a view or by a walk."""

    def __init__(self, source: Source, header: Header) -> None:
        self._source = source
        self._little = header.order == "<"

    def scalars(self, element: Element, groups: list[Group]) -> Columns:
        """Return the values of each group of properties."""
        self._check_room(element)
        if element.lists:
            return self._scalars_between_lists(element, groups)
        return self._records(element, groups, element.count)

    def runs(self, element: Element, groups: list[Group], size: int) -> Iterator[Columns]:
        """Yield the same for run after run of an element without lists, at least one."""
        self._check_room(element)
        for first in range(0, max(1, element.count), size):
            yield self._records(element, groups, min(size, element.count - first))

    def _records(self, element: Element, groups: list[Group], count: int) -> Columns:
        """Read records block by block into their columns; of a file with a name, on several threads."""
        record = np.dtype([(p.name, p.type) for p in element.properties])
        found: Columns = {}
        for group in groups:
            if len(group) > 1:
                found[group] = np.empty((count, len(group)))
            else:
                found[group] = np.empty(count, record[group[0]].newbyteorder("="))
        start, size = self._source.position, record.itemsize
        step = max(1, _BLOCK // size)
        buffers = threading.local()

        def read(first: int, last: int) -> None:
            if not hasattr(buffers, "block"):
                buffers.block = np.empty(min(step, count) * size, np.uint8)
            block = buffers.block[: (last - first) * size]
            if self._source.positional:
                self._source.fill_from(start + first * size, block)
            else:
                self._source.fill(block)
            rows = block.view(record)
            for group, out in found.items():
                _scatter(rows, group, out[first:last])

        if self._source.positional:
            in_parts(read, count, step)
            self._source.stream.seek(start + count * size)
        else:
            for first in range(0, count, step):
                read(first, min(first + step, count))
        return found

    def lists(self, element: Element, wanted: Property) -> tuple[Integers, Integers]:
        """Return the items of one list property laid end to end, and how many each record has."""
        self._check_room(element)
        uniform = self._uniform_lists(element, wanted)
        if uniform is not None:
            return uniform
        data, starts, lengths, _ = self._walk(element, wanted)
        size = wanted.type.itemsize
        items = np.empty(int(lengths.sum()), np.int64)
        if wanted.type.kind == "f":
            raise self._source.error(
                f"the list {wanted.name!r} of {element.name!r} holds {wanted.type.name}, not whole numbers", "header",
                "write its indices as integers",
            )  # fmt: skip
        from surfel.io.ply_lists import gather

        gather(data, starts, lengths, size, wanted.type.kind == "i", self._little, items)
        return items, lengths

    def skip(self, element: Element) -> None:
        """Read past an element; its records have to be there all the same."""
        self._check_room(element)
        if element.lists:
            self._walk(element, None)
        else:
            self._source.stream.seek(element.count * element.least_size, 1)

    def finish(self) -> None:
        """Refuse what comes after the last record (line ends at the very end are let pass)."""
        at = self._source.position
        left = self._source.remaining
        if left > 4096 or self._source.stream.read(4096).strip(b"\r\n"):
            raise self._source.error(
                f"there are {left} bytes more than the header announces", f"byte {at}",
                "its counts are wrong or the file was changed; write it again",
            )  # fmt: skip

    def _check_room(self, element: Element) -> None:
        """Refuse a count that the bytes left cannot hold, before anything is allocated."""
        need, left = element.count * element.least_size, self._source.remaining
        if element.count and not element.properties:
            raise self._source.error(f"{element.count} records of {element.name!r} have no properties", "header", _CUT)
        if need > left:
            raise self._source.error(
                f"{element.count} records of {element.name!r} need {need} bytes, {left} are left",
                f"byte {self._source.position}, {element.name} {left // element.least_size}", _CUT,
            )  # fmt: skip

    def _uniform_lists(self, element: Element, wanted: Property) -> tuple[Integers, Integers] | None:
        """Read the usual case, where the only list has the same count in every record, as one structured view."""
        if element.lists != [wanted] or element.count == 0 or wanted.type.kind == "f":
            return None
        start = self._source.position
        counts = np.dtype(wanted.count_type)
        before = sum(p.type.itemsize for p in element.properties[: element.properties.index(wanted)])
        self._source.stream.seek(before, 1)
        count = int(self._source.take(counts.itemsize).view(counts)[0])
        self._source.stream.seek(start)
        size = element.least_size + count * wanted.type.itemsize
        if count <= 0 or size * element.count > self._source.remaining:
            return None
        record = np.dtype(
            {"names": ["count", "items"], "formats": [counts, (wanted.type, (count,))],
             "offsets": [before, before + counts.itemsize], "itemsize": size}
        )  # fmt: skip
        items = np.empty((element.count, count), np.int64)
        step = max(1, _BLOCK // size)
        buffer = np.empty(min(step, element.count) * size, np.uint8)
        for first in range(0, element.count, step):
            rows = min(step, element.count - first)
            self._source.fill(buffer[: rows * size])
            block = buffer[: rows * size].view(record)
            if not (block["count"] == count).all():
                self._source.stream.seek(start)
                return None
            if count < rows:
                for i in range(count):  # a column at a time: long inner loops
                    items[first : first + rows, i] = block["items"][:, i]
            else:
                items[first : first + rows] = block["items"]
        return items.reshape(-1), np.full(element.count, count, np.int64)

    def _walk(self, element: Element, wanted: Property | None) -> tuple[Bytes, Integers, Integers, Integers]:
        """Step through records of unequal length; return the bytes and the places of lists and scalars."""
        from surfel.io.ply_lists import step_over

        start = self._source.position
        data = self._source.rest()
        counts = np.array([0 if p.count_type is None else p.count_type.itemsize for p in element.properties], np.int64)
        signed = np.array([p.count_type is not None and p.count_type.kind == "i" for p in element.properties], np.bool_)
        sizes = np.array([p.type.itemsize for p in element.properties], np.int64)
        chosen = -1 if wanted is None else element.properties.index(wanted)
        rows = element.count
        starts, lengths = np.zeros(rows, np.int64), np.zeros(rows, np.int64)
        places = np.empty((rows if element.name == "vertex" else 0, int((counts == 0).sum())), np.int64)
        row, at = step_over(data, rows, counts, signed, sizes, chosen, self._little, starts, lengths, places)
        if row < rows:
            raise self._source.error(
                f"the file ends in record {row} of {rows}, or a list in it has a wrong count",
                f"byte {start + at}, {element.name} {row}", _CUT,
            )  # fmt: skip
        self._source.stream.seek(start + at)
        return data, starts, lengths, places

    def _scalars_between_lists(self, element: Element, groups: list[Group]) -> Columns:
        data, _, _, places = self._walk(element, None)
        scalars = [p for p in element.properties if p.count_type is None]
        columns = {}
        for i, p in enumerate(scalars):
            octets = data[places[:, i][:, None] + np.arange(p.type.itemsize)]
            columns[p.name] = np.ascontiguousarray(octets).view(p.type)[:, 0].astype(p.type.newbyteorder("="))
        return {
            g: columns[g[0]] if len(g) == 1 else np.stack([columns[n] for n in g], axis=1).astype(np.float64)
            for g in groups
        }


def _scatter(block: NDArray[Any], group: Group, out: NDArray[Any]) -> None:
    """Copy one group of properties of a block into its rows of the result, a column at a time: long inner loops."""
    if len(group) == 1:
        out[:] = block[group[0]]
        return
    for i, name in enumerate(group):
        out[:, i] = block[name]
