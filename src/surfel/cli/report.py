"""The demo's report: one HTML page that needs nothing but itself, and the picture that it begins with."""

from __future__ import annotations

import base64
import html
import math
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from surfel.cli.part import BoredBlock
    from surfel.core.estimate import Estimate
    from surfel.core.execute import Progress
    from surfel.measuring.measurement import Measurement
    from surfel.rendering.camera import Camera
    from surfel.shapes.surfels import Surfels

REPORT, PICTURE = "report.html", "part.png"
_MARK = "made by surfel demo"
_SIZE = (560, 400)
_FROM = (0.55, -0.75, 0.6)
_NOTCH = 1.0  # radius of the ball that is taken off the corner nearest to the camera
_COEFFICIENTS = 12
_STYLE = (
    "body{font:16px/1.5 system-ui,sans-serif;max-width:46em;margin:2em auto;padding:0 1em;color:#222;background:#fff}"
    "h1,h2{line-height:1.2}img{max-width:100%;height:auto}code,pre{background:#f3f1ec;border-radius:4px}"
    "pre{padding:.7em 1em;overflow:auto}table{border-collapse:collapse}"
    "td,th{padding:.2em 1em .2em 0;text-align:left;border-bottom:1px solid #ddd}"
)


def refuse_foreign(folder: Path) -> None:
    """Make sure that nothing but an earlier report would be replaced.

    Raises
    ------
    InputError
        If a file stands there that no demo made.
    """
    from surfel.core.errors import InputError

    for name in (REPORT, PICTURE):
        path = folder / name
        if path.exists() and _MARK.encode() not in path.read_bytes()[:2000]:
            raise InputError(f"{path} exists and is not this demo's; give another folder: surfel demo DIR")


def write_report(
    folder: Path, scan: Surfels, found: Measurement, part: BoredBlock, seed: int, progress: Progress
) -> None:
    """Draw the scan, cut a corner off it, lay a surface over it, and write the page and the picture."""
    import surfel
    from surfel.io.atomic import replacing

    camera = surfel.Camera.fitted(scan.bounds, _SIZE, direction=_FROM)
    progress(0.0, "drawing the scan")
    whole = _png(scan, camera)
    progress(0.3, "cutting a corner off")
    corner = (part.width / 2, -part.depth / 2, part.height / 2)
    notched = scan - surfel.Sphere(_NOTCH).translated(corner)
    cut, left = _png(notched, camera), surfel.measure(notched, seed=seed)
    progress(0.7, "laying a surface over it")
    lid = surfel.bound(scan, direction=(0, 0, 1), shape=(_COEFFICIENTS, _COEFFICIENTS), mode="tight")
    beyond, _ = lid.verify(scan)
    top = scan.points[scan.points[:, 2] == scan.points[:, 2].max()]
    gap = float((lid(top) - top[:, 2]).mean())
    covered = _png([scan, lid], camera)

    area, volume = part.area - math.pi * _NOTCH**2 / 4, part.volume - math.pi * _NOTCH**3 / 6
    sections = [
        f"<p>{len(scan):,} random points with normals on a {part.width:g} x {part.depth:g} x {part.height:g} block "
        f"with a hole of radius {part.radius:g}: a scan whose truth is known in closed form.</p>{_image(whole)}",
        "<h2>What it measures</h2>"
        + _code("scan = surfel.read('part.ply')\nm = surfel.measure(scan)")
        + _table(("area", found.area, part.area), ("volume", found.volume, part.volume))
        + f"<p>Found in {found.seconds:.2f} s, without a mesh. What the points say about themselves: "
        f"{'closed' if found.closed else 'not closed'}, {found.spacing:.3f} between neighbours, noise of "
        f"{found.noise:.2f} of that.</p>",
        "<h2>A corner taken off</h2><p>A scan and an exact ball in one expression; the edge is sharp, and nothing was "
        "meshed.</p>"
        + _code(f"cut = scan - surfel.Sphere({_NOTCH:g}).translated({corner})\nsurfel.measure(cut)")
        + _image(cut)
        + _table(("area", left.area, area), ("volume", left.volume, volume)),
        f"<h2>A safe surface over it</h2><p>A smooth surface of {_COEFFICIENTS} x {_COEFFICIENTS} coefficients, below "
        f"which every point lies: {beyond} of {len(scan):,} points are above it. Over the block's top the mean gap is "
        f"{gap:.3f}; where there are no points, over the hole, it is free.</p>"
        + _code(f"surfel.bound(scan, direction=(0, 0, 1), shape=({_COEFFICIENTS}, {_COEFFICIENTS}), mode='tight')")
        + _image(covered),
    ]
    body = "\n".join(sections)
    page = (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><meta name="generator" content="{_MARK}">'
        '<meta name="viewport" content="width=device-width"><title>surfel: a bored block</title>'
        f"<style>{_STYLE}</style></head><body>\n<h1>A bored block, measured from its points</h1>\n{body}\n"
        "</body></html>\n"
    )
    for name, content in ((PICTURE, whole), (REPORT, page.encode())):
        with replacing(folder / name) as file:
            file.write(content)


def _png(shown: Any, camera: Camera) -> bytes:
    """Return a picture as a small PNG file that says where it comes from."""
    import numpy as np
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    import surfel

    note, stream = PngInfo(), BytesIO()
    note.add_text("Software", _MARK)
    image = Image.fromarray(np.asarray(surfel.render(shown, camera, _SIZE)))
    image.quantize(128, dither=Image.Dither.NONE).save(stream, format="PNG", optimize=True, pnginfo=note)
    return stream.getvalue()


def _image(png: bytes) -> str:
    width, height = _SIZE
    source = base64.b64encode(png).decode()
    return f'<p><img alt="" width="{width}" height="{height}" src="data:image/png;base64,{source}"></p>'


def _code(text: str) -> str:
    return f"<pre>{html.escape(text)}</pre>"


def _table(*rows: tuple[str, Estimate | None, float]) -> str:
    """Return estimates beside the truth."""
    lines = ["<tr><th></th><th>value &plusmn; error</th><th>truth</th><th>off by</th></tr>"]
    for name, estimate, truth in rows:
        if estimate is not None:
            told = html.escape(str(estimate)).replace("+-", "&plusmn;")
            off = (float(estimate.value) - truth) / truth
            lines.append(f"<tr><td>{name}</td><td>{told}</td><td>{truth:.6g}</td><td>{off:+.3%}</td></tr>")
    return f"<table>{''.join(lines)}</table>"
