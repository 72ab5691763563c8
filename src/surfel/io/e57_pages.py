"""The paged file that an E57 is: 1,020 bytes and their checksum, again and again; every page read is verified.

Source: ASTM E2807-11, chapter 9 (file header, pages) and annex on checksums.
"""

from __future__ import annotations

import struct

import numpy as np

from surfel.io.source import Bytes, Source

PAGE, DATA, HEADER = 1024, 1020, 48
MAGIC = b"ASTM-E57"
CUT = "the file was cut or changed; fetch it again"


class Pages:
    """Reads an E57 file by the offsets of its pages; its header is checked first.

    Raises
    ------
    FileFormatError
        If the header does not fit the file.
    """

    def __init__(self, source: Source) -> None:
        self.source = source
        raw = source.head(HEADER)
        if len(raw) < HEADER or raw[:8] != MAGIC:
            raise source.error("it has no E57 header", "byte 0", "name an E57 file; it may be cut")
        major, minor, length, place, size, page = struct.unpack_from("<2I4Q", raw, 8)
        if major != 1:
            raise source.error(f"it is E57 {major}.{minor}", "byte 8", "version 1 is read")
        if page != PAGE:
            raise source.error(f"its pages have {page} bytes", "byte 40", f"pages of {PAGE} are read")
        if length != source.size or length % PAGE:
            raise source.error(
                f"its header announces {length} bytes in pages of {PAGE}, the file has {source.size}",
                f"byte {min(source.size, length)}", CUT,
            )  # fmt: skip
        self.logical = source.size // PAGE * DATA
        self.xml = self.read(self.from_physical(place, "the description"), size, "the description").tobytes()

    def from_physical(self, offset: int, what: str) -> int:
        """Return an offset that counts the checksums as one that does not."""
        page, rest = divmod(offset, PAGE)
        if offset >= self.source.size or rest >= DATA or offset < HEADER:
            raise self.source.error(f"{what} should lie at byte {offset}", f"byte {offset}", CUT)
        return page * DATA + rest

    def read(self, start: int, count: int, what: str) -> Bytes:
        """Return bytes from a logical offset on.

        Raises
        ------
        FileFormatError
            If there are fewer, or a page does not match its checksum.
        """
        from surfel.io.e57_bits import checksums  # on first use, because it has kernels

        if start + count > self.logical:
            raise self.source.error(f"{what} ends beyond the file", f"byte {self.source.size}", CUT)
        first, last = start // DATA, -(-(start + count) // DATA)
        self.source.stream.seek(first * PAGE)
        pages = self.source.take((last - first) * PAGE).reshape(-1, PAGE)
        stored = pages[:, DATA:].copy().view(">u4")[:, 0]
        wrong = np.flatnonzero(checksums(pages[:, :DATA]) != stored)
        if len(wrong):
            page = first + int(wrong[0])
            raise self.source.error(
                f"a page of {what} does not match its checksum", f"page {page}, byte {page * PAGE}", CUT
            )
        return pages[:, :DATA].reshape(-1)[start - first * DATA :][:count]


def paged(data: bytes) -> bytes:
    """Return bytes as pages with their checksums, the last filled up with zeros."""
    from surfel.io.e57_bits import checksums

    filled = np.zeros(-(-len(data) // DATA) * DATA, np.uint8)
    filled[: len(data)] = np.frombuffer(data, np.uint8)
    rows = filled.reshape(-1, DATA)
    return np.concatenate([rows, checksums(rows).astype(">u4")[:, None].view(np.uint8)], axis=1).tobytes()
