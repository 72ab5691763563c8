"""Which point format can hold a cloud, which of its values go into fields of that format, and which behind them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surfel.io.columns import flat_columns
from surfel.io.content import Content
from surfel.io.las_layout import COLORS, DESCRIPTOR, WAVES, Extra, Field, clipped, described, fields_of, length_of

NORMAL_NAMES = ("NormalX", "NormalY", "NormalZ")
_WAVES = frozenset(name for name, _ in WAVES)
_KNOWN = {field.name for number in range(11) for field in fields_of(number)} - set(COLORS)


@dataclass
class Plan:
    """How the columns of a cloud become records."""

    number: int
    fields: list[tuple[str, Field]]  # (attribute, field)
    extras: list[tuple[str, int | None, Extra]]  # (attribute, column of it or None for all, field)
    lost: list[str]

    @property
    def record(self) -> int:
        """Bytes of a record."""
        return length_of(self.number) + sum(extra.field.type.itemsize for _, _, extra in self.extras)

    @property
    def descriptors(self) -> bytes:
        """The descriptions of the extra fields."""
        return b"".join(extra.descriptor for _, _, extra in self.extras)


def plan_for(content: Content, whole: bool) -> Plan | None:
    """Return how to write this content.

    The point format of the file that it came from is kept where it holds everything; a cloud from elsewhere gets the
    least format that does. What no field holds goes into extra bytes.

    Parameters
    ----------
    content : Content
        Points and all that is known at them.
    whole : bool
        Whether these are all points. If they are only the first, what they are does not say that later ones fit; then
        the types alone decide.

    Returns
    -------
    Plan or None
        None if the types alone do not decide.
    """
    before = _before(content)
    known = [name for name in content.attributes if name in _KNOWN]
    numbers = [n for n in (before.get("format"), _least_format(content, known)) if isinstance(n, int)]
    for number in numbers:
        trusted = not whole and number == before.get("format")
        fields = [
            (f.name, f)
            for f in fields_of(number)
            if f.name in content.attributes and (trusted or _fits(content.attributes[f.name], f, whole))
        ]
        if len(fields) == len(known) and (content.colors is None or _holds_colors(number)):
            break
    else:
        if not whole:
            return None
    lost: list[str] = []
    held = {name for name, _ in fields}
    left = {name: values for name, values in content.attributes.items() if name not in held}
    return Plan(number, fields, _extras(content, left, number, before, whole, lost), lost)


def stored(values: NDArray[Any], extra: Extra) -> NDArray[Any]:
    """Return the raw numbers of an extra field."""
    if extra.scale is None:
        return values
    with np.errstate(invalid="ignore"):
        return np.rint((values - extra.offset) / extra.scale)


def fitting(values: NDArray[Any], dtype: str, largest: int | None = None) -> bool:
    """Tell whether all values can be kept in this type (whole numbers of at most ``largest`` if it is given)."""
    kind = np.dtype(dtype)
    if values.dtype.kind not in "fiub":
        return False
    if kind.kind == "f":
        return values.dtype.kind != "f" or bool(values.dtype.itemsize <= kind.itemsize)
    if len(values) == 0:
        return True
    low, high = values.min(), values.max()
    limits = np.iinfo(kind)
    if not (low >= limits.min and high <= (limits.max if largest is None else largest)):
        return False
    return values.dtype.kind != "f" or bool((values == np.floor(values)).all())


def _before(content: Content) -> Mapping[str, Any]:
    found = content.frame.extra.get("las") if content.frame is not None else None
    return found if isinstance(found, Mapping) else {}


def _least_format(content: Content, known: list[str]) -> int:
    names = set(known)
    colors, near = content.colors is not None, "nir" in names
    waves, timed = bool(names & _WAVES), "gps_time" in names
    if names <= {"intensity"} or ("scan_angle_rank" in names and not near):
        if waves:
            return 5 if colors else 4
        return 2 * colors + timed
    if waves:
        return 10 if colors or near else 9
    return 8 if near else 7 if colors else 6


def _holds_colors(number: int) -> bool:
    return any(field.name == COLORS[0] for field in fields_of(number))


def _fits(values: NDArray[Any], field: Field, whole: bool) -> bool:
    if values.ndim != 1:
        return False
    if whole:
        return fitting(values, field.dtype, field.largest if field.dtype[-2] != "f" else None)
    if np.dtype(field.dtype).kind == "f":
        return values.dtype.kind == "f" and values.dtype.itemsize <= np.dtype(field.dtype).itemsize
    return values.dtype.kind in "iu" and fitting(
        np.array([np.iinfo(values.dtype).min, np.iinfo(values.dtype).max], values.dtype), field.dtype, field.largest
    )


def _extras(
    content: Content,
    left: dict[str, NDArray[Any]],
    number: int,
    before: Mapping[str, Any],
    whole: bool,
    lost: list[str],
) -> list[tuple[str, int | None, Extra]]:
    """Return the extra fields, one behind the other."""
    at = length_of(number)
    names = {field.name for field in fields_of(number)}
    extras: list[tuple[str, int | None, Extra]] = []

    def append(attribute: str, column: int | None, extra: Extra) -> None:
        nonlocal at
        extras.append((attribute, column, replace(extra, field=replace(extra.field, offset=at))))
        at += extra.field.type.itemsize

    if content.normals is not None:
        for column, name in enumerate(NORMAL_NAMES):
            append("", column, _new(name, np.dtype(np.float64), 1, names))
    if content.radii is not None:
        append("", None, _new("radius", np.dtype(np.float64), 1, names))
    for name, values in left.items():
        kind = values.dtype
        known: Extra | None = before.get("extras", {}).get(name)
        if kind.kind not in "fiub" or kind.itemsize > 8 or flat_columns(values).shape[1] == 0:
            lost.append(f"attribute {name!r} of type {kind}")
            continue
        if known is not None and name not in names and _as_before(values, known, whole):
            names.add(name)
            append(name, None, known)
            continue
        if name in names:
            lost.append(f"the name {name!r}, whose values do not fit that field of LAS: it is '{name}_value' there")
        held = np.dtype(np.uint8) if kind.kind == "b" else np.dtype(np.float32) if kind == np.float16 else kind
        width = 1 if values.ndim == 1 else flat_columns(values).shape[1]
        bare = held == np.uint8 and 3 < width < 256
        if values.ndim <= 2 and (width <= 3 or bare):
            append(name, None, _new(name, held, width, names, bare))
            continue
        for column in range(width):
            append(name, column, _new(f"{name}_{column}", held, 1, names))
    return extras


def _as_before(values: NDArray[Any], known: Extra, whole: bool) -> bool:
    """Tell whether a field of the file that the values came from gives them back exactly."""
    if values.shape[1:] != known.field.type.shape or not known.descriptor:
        return False
    if not whole:
        return True
    raw = stored(values, known)
    if known.scale is not None and not np.array_equal(raw * known.scale + known.offset, values, equal_nan=True):
        return False
    return fitting(raw.reshape(-1), known.field.dtype)


def _new(name: str, kind: np.dtype[Any], width: int, names: set[str], bare: bool = False) -> Extra:
    """Return a new extra field under a name that is not in use."""
    text = clipped(name).decode()
    number = 1
    while text in names:
        end = "_value" if number == 1 else f"_value_{number}"
        text = clipped(name)[: 32 - len(end)].decode("utf-8", "ignore") + end
        number += 1
    names.add(text)
    dtype = kind.newbyteorder("<").str.lstrip("|")
    field = Field(text, dtype, 0, width=width)
    if bare:
        described_so = bytes([0, 0, 0, width]) + clipped(text)
        return Extra(field, descriptor=described_so.ljust(DESCRIPTOR, b"\0"))
    return Extra(field, descriptor=described(text, kind, width))


def colors_of(content: Content, lost: list[str]) -> NDArray[np.uint16]:
    """Return colors as the 16-bit words that LAS holds."""
    colors = content.colors
    if colors is None:
        return np.zeros((len(content.points), 3), np.uint16)
    if colors.shape[1] == 4:
        _once(lost, "alpha of the colors")
    rgb = colors[:, :3]
    if rgb.dtype == np.uint16:
        return rgb
    if rgb.dtype.kind in "iub":
        wide = rgb.astype(np.int64)
        bytes_alone = rgb.dtype.itemsize == 1 or (len(wide) and wide.max() <= 255)
        return np.clip(wide * 257 if bytes_alone else wide, 0, 65535).astype(np.uint16)
    words = np.rint(np.clip(np.nan_to_num(rgb.astype(np.float64)), 0.0, 1.0) * 65535.0)
    if (words / 65535.0 != rgb).any():
        _once(lost, "colors beyond 16 bits")
    return words.astype(np.uint16)


def _once(lost: list[str], what: str) -> None:
    if what not in lost:
        lost.append(what)


def column_of(content: Content, attribute: str, column: int | None, name: str) -> NDArray[Any]:
    """Return what an extra field holds: an attribute or one column of it, or (without a name) normals and radii."""
    values: Any = content.attributes[attribute] if attribute else content.radii if column is None else content.normals
    return np.asarray(values) if column is None else flat_columns(np.asarray(values))[:, column]
