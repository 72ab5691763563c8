"""Coordinate systems of LAS files: WKT and GeoTIFF keys as one text and back, and whether its unit is a degree."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterable
from typing import NamedTuple

from surfel.core.errors import InputError

PROJECTION = "LASF_Projection"
_WKT, _KEYS, _DOUBLES, _ASCII = 2112, 34735, 34736, 34737
_GEOTIFF = "GEOTIFF"
_MODEL, _GEOGRAPHIC, _ANGLE_UNITS, _PROJECTED, _USER_DEFINED = 1024, 2048, 2054, 3072, 32767
_DEGREE = 9102
_LENGTH_ROOTS = ("PROJCS", "PROJCRS", "PROJECTEDCRS", "GEOCCS", "ENGCRS", "ENGINEERINGCRS", "LOCAL_CS")
_ANGLE_ROOTS = ("GEOGCS", "GEOGCRS", "GEOGRAPHICCRS")


class Record(NamedTuple):
    """A variable-length record: whose, which, what it says it is, and its bytes."""

    user: str
    number: int
    description: str
    data: bytes


def crs_of(records: Iterable[Record]) -> str:
    """Return the coordinate system that the records of a LAS file tell, "" if none does.

    WKT as it is; else ``EPSG:n`` where the GeoTIFF keys say no more than that; else all keys in one line of text that
    :func:`records_of` turns back into the same keys.
    """
    own = {record.number: record.data for record in records if record.user == PROJECTION}
    wkt = own.get(_WKT, b"").split(b"\0")[0].decode("utf-8", "replace").strip()
    if wkt:
        return wkt
    keys = _keys(own.get(_KEYS, b""), own.get(_DOUBLES, b""), own.get(_ASCII, b""))
    if not keys:
        return ""
    code = keys.get(_PROJECTED, keys.get(_GEOGRAPHIC))
    if keys.keys() <= {_MODEL, 1025, _PROJECTED, _GEOGRAPHIC} and isinstance(code, int) and 0 < code < _USER_DEFINED:
        return f"EPSG:{code}"
    return _GEOTIFF + "".join(f" {number}={_word(value)}" for number, value in sorted(keys.items()))


def records_of(crs: str) -> list[Record]:
    """Return the records that carry a coordinate system: the inverse of :func:`crs_of`; any other text is WKT."""
    if not crs:
        return []
    epsg = re.fullmatch(r"EPSG:(\d{1,5})", crs.strip(), re.IGNORECASE)
    if epsg and 0 < int(epsg[1]) < _USER_DEFINED:
        geographic = in_degrees(crs)
        number = _GEOGRAPHIC if geographic else _PROJECTED
        return _key_records({_MODEL: 2 if geographic else 1, 1025: 1, number: int(epsg[1])})
    if crs.startswith(_GEOTIFF + " "):
        return _key_records(_parsed(crs[len(_GEOTIFF) :]))
    return [Record(PROJECTION, _WKT, "OGC coordinate system WKT", crs.encode() + b"\0")]


def in_degrees(crs: str) -> bool:
    """Tell whether the horizontal coordinates of a coordinate system are longitude and latitude in degrees.

    Parameters
    ----------
    crs : str
        WKT (1 or 2), ``EPSG:n`` or the keys that :func:`crs_of` writes; "" is not known and not in degrees.

    Examples
    --------
    >>> in_degrees('GEOGCS["WGS 84",UNIT["degree",0.0174532925199433]]'), in_degrees("EPSG:25832")
    (True, False)
    """
    text = crs.strip()
    epsg = re.fullmatch(r"EPSG:(\d+)", text, re.IGNORECASE)
    if epsg:  # EPSG keeps 4001-4999 for geographic systems; 4978 and its like, geocentric in meters, are few
        return 4001 <= int(epsg[1]) <= 4999 and int(epsg[1]) not in (4328, 4936, 4978, 4896, 4919, 4920)
    if text.startswith(_GEOTIFF + " "):
        keys = _parsed(text[len(_GEOTIFF) :])
        return keys.get(_MODEL) == 2 and keys.get(_ANGLE_UNITS, _DEGREE) == _DEGREE
    words = re.findall(r"([A-Z_]+)\s*[\[(]", re.sub(r'"[^"]*"', '""', text.upper()))
    for word in words:
        if word in _LENGTH_ROOTS:
            return False
        if word in _ANGLE_ROOTS:
            return True
        if word in ("GEODCRS", "GEODETICCRS"):  # WKT 2: geocentric where the axes are Cartesian
            return "CARTESIAN" not in text.upper()
    return False


def refuse_degrees(crs: str) -> None:
    """Raise an error that says what to do if areas and volumes in this coordinate system have no meaning.

    Raises
    ------
    InputError
        If its horizontal coordinates are in degrees.
    """
    if in_degrees(crs):
        raise InputError(
            "the coordinates are longitude and latitude in degrees, in which areas and volumes have no meaning; "
            "project the file to meters first, for example with: pdal translate in.laz out.laz reprojection "
            "--filters.reprojection.out_srs=EPSG:<code of your UTM zone>"
        )


def _keys(directory: bytes, doubles: bytes, text: bytes) -> dict[int, int | float | str]:
    """Return the GeoTIFF keys; entries that do not fit their records (they come damaged) are left out."""
    words = struct.unpack(f"<{len(directory) // 2}H", directory[: len(directory) // 2 * 2])
    values: dict[int, int | float | str] = {}
    for i in range(4, min(len(words) - 3, 4 + 4 * (words[3] if len(words) > 3 else 0)), 4):
        number, where, count, at = words[i : i + 4]
        if number == 0:
            continue
        if where == 0:
            values[number] = at
        elif where == _DOUBLES and count == 1 and 8 * at + 8 <= len(doubles):
            values[number] = float(struct.unpack_from("<d", doubles, 8 * at)[0])
        elif where == _ASCII and at + count <= len(text):
            values[number] = text[at : at + count].decode("latin-1").rstrip("|\0")
    return values


def _key_records(keys: dict[int, int | float | str]) -> list[Record]:
    directory = [1, 1, 0, len(keys)]
    doubles: list[float] = []
    text = b""
    for number, value in sorted(keys.items()):
        if isinstance(value, str):
            raw = value.encode("latin-1", "replace") + b"|"
            directory += [number, _ASCII, len(raw), len(text)]
            text += raw
        elif isinstance(value, float):
            directory += [number, _DOUBLES, 1, len(doubles)]
            doubles.append(value)
        else:
            directory += [number, 0, 1, value]
    records = [Record(PROJECTION, _KEYS, "GeoTIFF GeoKeyDirectoryTag", struct.pack(f"<{len(directory)}H", *directory))]
    if doubles:
        raw = struct.pack(f"<{len(doubles)}d", *doubles)
        records.append(Record(PROJECTION, _DOUBLES, "GeoTIFF GeoDoubleParamsTag", raw))
    if text:
        records.append(Record(PROJECTION, _ASCII, "GeoTIFF GeoAsciiParamsTag", text + b"\0"))
    return records


def _word(value: int | float | str) -> str:
    if isinstance(value, str):
        return '"' + "".join(c if c.isprintable() and c not in '"\\' else f"\\x{ord(c):02x}" for c in value) + '"'
    return repr(value)


def _parsed(text: str) -> dict[int, int | float | str]:
    keys: dict[int, int | float | str] = {}
    for number, word in re.findall(r'(\d+)=("[^"]*"|\S+)', text):
        if int(number) > 65535:
            continue
        if word.startswith('"'):
            keys[int(number)] = re.sub(r"\\x([0-9a-f]{2})", lambda m: chr(int(m[1], 16)), word[1:-1])
        elif word.isdigit() and int(word) <= 65535:
            keys[int(number)] = int(word)
        else:
            try:
                keys[int(number)] = float(word)
            except ValueError:
                continue
    return keys
