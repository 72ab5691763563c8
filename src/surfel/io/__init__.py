"""One file-format family a file, and the registry behind read, write, info and convert."""

from surfel.io.atomic import replacing
from surfel.io.doors import convert, info, read, write
from surfel.io.registry import Format, register, suffixes

__all__ = ["Format", "convert", "info", "read", "register", "replacing", "suffixes", "write"]
