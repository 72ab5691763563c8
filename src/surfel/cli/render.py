"""``surfel render``: a picture of one file, or of several in one Boolean expression."""

from __future__ import annotations

import re
from functools import reduce
from typing import TYPE_CHECKING, Annotated

import typer

from surfel.cli.options import AsJson, Quiet, ReadAs, as_form
from surfel.cli.seeing import AXES, Up, as_axis, read_to_see

if TYPE_CHECKING:
    from surfel.rendering.camera import Camera
    from surfel.rendering.scene import Scene
    from surfel.shapes.base import Shape

OPERATIONS = ("union", "intersection", "difference")
_FROM = {"x": (0.6, 0.5, -0.75), "y": (0.5, 0.6, 0.75)}  # as the camera stands when z is up, turned
_SIZE = re.compile(r"(\d+)[xX](\d+)")


def render(
    files: Annotated[list[str], typer.Argument(metavar="FILE ...", help="Clouds, meshes, CSG trees, safe surfaces.")],
    out: Annotated[str, typer.Option("--out", "-o", metavar="PNG", help="The picture; the suffix tells the format.")],
    size: Annotated[str, typer.Option(metavar="WxH", help="Width and height in pixels.")] = "1024x768",
    op: Annotated[
        str | None,
        typer.Option(metavar="|".join(OPERATIONS), help="Combine the files; by default they are shown together."),
    ] = None,
    as_: ReadAs = None,
    eye: Annotated[
        tuple[float, float, float] | None, typer.Option(metavar="X Y Z", help="Where the camera is.")
    ] = None,
    target: Annotated[
        tuple[float, float, float] | None,
        typer.Option(metavar="X Y Z", help="What it looks at, if not the middle."),
    ] = None,
    up: Up = "z",
    orthographic: Annotated[bool, typer.Option("--orthographic", help="Parallel lines of sight.")] = False,
    curve: Annotated[bool, typer.Option("--curve", help="Draw where the operands of a tree meet.")] = False,
    reference: Annotated[bool, typer.Option("--reference", help="Cast every line of sight: slow, the truth.")] = False,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Take a picture: of a file, of several together, or of what a Boolean operation makes of them."""
    from surfel.cli.output import Output

    form, measures, up = as_form(as_), _size_of(size), as_axis(up)
    _check_operation(op, len(files))
    _check_format(out)
    import surfel

    with Output(as_json, quiet) as output:
        with output.work() as progress:
            progress(0.0, "reading")
            shapes = [read_to_see(file, form) for file in files]
            shown = [_combined(op, shapes)] if op is not None else shapes
            progress(0.5, "drawing")
            camera = _camera_of(shown, measures, eye, target, up, orthographic)
            image = surfel.render(shown, camera, measures, orthographic=orthographic, reference=reference, curve=curve)
            image.save(out)
        if not image.covered:
            output.note("nothing is to be seen: the solid is empty, or the camera looks elsewhere")
        data = {"size": list(image.size), "covered": image.covered, "seconds": image.seconds}
        output.facts(data, out)


def _size_of(text: str) -> tuple[int, int]:
    from surfel.core.errors import InputError
    from surfel.rendering.camera import as_size

    found = _SIZE.fullmatch(text)
    if found is None:
        raise InputError(f"--size must be width x height, as in 1024x768; got {text!r}")
    return as_size((int(found[1]), int(found[2])))


def _check_operation(op: str | None, files: int) -> None:
    """Refuse a wrong operation before large files are read."""
    from surfel.core.cast import as_choice
    from surfel.core.errors import InputError

    if op is not None:
        as_choice(op, "--op", OPERATIONS)
        if files < 2:
            raise InputError(f"--op {op} needs at least two files; got {files}")


def _check_format(out: str) -> None:
    """Refuse a picture of an unknown kind before anything is drawn."""
    from pathlib import Path

    from PIL import Image

    from surfel.core.errors import InputError

    suffix = Path(out).suffix.lower()
    if suffix and Image.registered_extensions().get(suffix) not in Image.SAVE:
        raise InputError(f"no picture format is known by {suffix}; take .png")


def _combined(op: str, shapes: list[Shape]) -> Shape:
    from operator import and_, or_, sub

    function = {"union": or_, "intersection": and_, "difference": sub}[op]
    result: Shape = reduce(function, shapes)
    return result


def _camera_of(
    shapes: list[Shape],
    size: tuple[int, int],
    eye: tuple[float, float, float] | None,
    target: tuple[float, float, float] | None,
    up: str,
    orthographic: bool,
) -> Camera | None:
    """Return the camera that was asked for; None for the fitted one."""
    if eye is None and target is None and up == "z":
        return None
    from surfel.core.errors import InputError
    from surfel.rendering.camera import Camera
    from surfel.rendering.scene import Scene

    if eye is None and target is None:
        return Camera.around(Scene(shapes).outline, size, _FROM[up], AXES[up], orthographic=orthographic)
    if eye is None:
        raise InputError("--target needs --eye: where the camera is")
    return Camera(eye, target if target is not None else _middle_of(Scene(shapes)), AXES[up], orthographic=orthographic)


def _middle_of(scene: Scene) -> tuple[float, float, float]:
    x, y, z = scene.middle.tolist()
    return x, y, z
