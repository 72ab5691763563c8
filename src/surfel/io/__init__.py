"""One file-format family a file, and the registry behind read, open, write, info and convert."""

from surfel.io.atomic import replacing
from surfel.io.chunks import Chunks, open
from surfel.io.conversion import convert
from surfel.io.doors import read, write
from surfel.io.facts import info
from surfel.io.registry import Format, register, suffixes

__all__ = ["Chunks", "Format", "convert", "info", "open", "read", "register", "replacing", "suffixes", "write"]

register(Format("csg", (".csg",), "surfel.io.csg", holds=frozenset({"tree"})))  # the doors hand trees on as they are
