"""The page in a real browser: it loads, shows the solids, follows a drag, survives bad files and clients that leave."""

from __future__ import annotations

import io
import re
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import surfel
from surfel.viewer import elements

sys.path.insert(0, str(Path(__file__).parent))
from chromium_page import CHROMIUM, Page

pytest.importorskip("viser", reason="needs the extra `view`")
pytest.importorskip("websockets")
pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium (Debian: apt install chromium)"),
]

NUMBERS = "document.body.innerText"
WINDOW = (900, 560)
SCENE = 540  # columns of the window that the panel leaves free
READY = "document.querySelector('canvas') !== null && /area [0-9]/.test(document.body.innerText)"


def solids():
    p = np.random.default_rng(0).standard_normal((1500, 3))
    p /= np.linalg.norm(p, axis=1, keepdims=True)
    return surfel.Surfels(10.0 * p, p) - surfel.Cylinder(4.0, 30.0)


@pytest.fixture(scope="module", autouse=True)
def few_disks():
    """A browser without a graphics card draws some thousands of disks in the time that a test has."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(elements, "_OF_SOLIDS", 1200)
        yield


@pytest.fixture(scope="module")
def viewer():
    with surfel.view(solids(), names=["ball", "drill"], port=0, draw="browser") as made:
        assert made.settled(300.0)
        yield made


@pytest.fixture(scope="module")
def page(viewer, tmp_path_factory):
    with Page(tmp_path_factory.mktemp("profile"), *WINDOW) as tab:
        tab.go(viewer.url)
        tab.wait_for(READY, 120.0)
        tab.rest()
        yield tab


def volume(page):
    return float(re.search(r"volume ([0-9.]+)", page.evaluate(NUMBERS)).group(1))


def arrow(picture):
    """Return where the handle along z is: what is clearly blue, at its upper end."""
    red, green, blue = (picture[..., k] for k in range(3))
    rows, columns = np.nonzero((blue > red + 90) & (blue > green + 40) & (np.arange(picture.shape[1]) < SCENE))
    assert len(rows) > 20, "no handle is to be seen"
    tip = rows.min() + 8
    return float(np.median(columns[rows < tip + 4])), float(tip)


def test_a_browser_without_a_graphics_card_gets_pictures_unasked(tmp_path):
    """Chromium draws by software here, as on any machine without a graphics card."""
    box = "document.getElementById([...document.querySelectorAll('label')].find(one => one.innerText.trim() === {!r})"
    box = box.format("draw on the server") + ".htmlFor)"
    with surfel.view(solids(), names=["ball", "drill"], port=0) as viewer:
        assert viewer.settled(300.0)
        with Page(tmp_path / "profile", *WINDOW) as page:
            page.go(viewer.url)
            page.wait_for(READY, 120.0)
            page.wait_for(f"{box}.checked")
            page.rest()
            (client,) = viewer._server.get_clients().values()
            drawn = np.asarray(Image.open(io.BytesIO(viewer.picture_file(client))).convert("RGB")).astype(int)
            shown = page.picture()[: len(drawn)]
            assert drawn.shape == shown.shape
            alike = np.abs(drawn - shown).max(axis=2) < 40
            assert alike[:, 330:SCENE].mean() > 0.9  # but for the handles; what is to the left are messages
            assert page.complaints == []
            before, start = volume(page), arrow(shown)
            page.drag(start, (start[0], start[1] - 120.0))
            assert viewer.settled(120.0)
            page.wait_for(f"!/volume {before:g}/.test({NUMBERS})")
            page.rest()
            moved = page.picture()[: len(drawn)]
            assert (np.abs(moved - shown).sum(axis=2) > 60)[:, 330:SCENE].mean() > 0.01
            page.evaluate(f"{box}.click()")
            page.wait_for(f"!{box}.checked")
            page.rest()
            own = page.picture()[: len(drawn)]
            assert (np.abs(own - moved).max(axis=2) > 12)[:, 330:SCENE].mean() > 0.02  # disks, in another light
            sand = (np.abs(own[:, :SCENE] - (214, 196, 168)).sum(axis=2) < 150) & (np.ptp(own[:, :SCENE], axis=2) > 4)
            assert sand.mean() > 0.05


@pytest.mark.parametrize("served", [True, False])
def test_a_browser_that_cannot_draw_at_all_is_told_so(viewer, served, tmp_path):
    from surfel.viewer.view import write_html

    file = tmp_path / "scene.html"
    write_html(surfel.Box(2) - surfel.Sphere(1.2), file)
    with Page(tmp_path / "profile", *WINDOW, draws=False) as page:
        page.go(viewer.url if served else file.as_uri())
        page.wait_for("/WebGL is unavailable/.test(document.body?.innerText)")
        assert page.evaluate("document.createElement('canvas').getContext('webgl2')") is None
        assert "check your browser settings" in page.evaluate(NUMBERS)


def test_it_loads_from_this_computer_alone_and_shows_the_solids(viewer, page):
    outside = [
        a for a in page.requests if not a.startswith((viewer.url, "data:", "blob:", viewer.url.replace("http", "ws")))
    ]
    assert outside == []
    assert page.complaints == []
    picture = page.picture()[:, :SCENE]
    sand = (np.abs(picture - (214, 196, 168)).sum(axis=2) < 150) & (np.ptp(picture, axis=2) > 4)
    assert sand.mean() > 0.05
    rows, columns = np.nonzero(sand)
    assert abs(np.median(columns) - 450) < 60  # the ball is in the middle of the window
    assert abs(np.median(rows) - picture.shape[0] / 2) < 60
    assert volume(page) == pytest.approx(4 / 3 * np.pi * 1000 * (1 - 0.16) ** 1.5, rel=0.03)


def test_a_drag_of_a_handle_changes_the_solid(viewer, page):
    before, picture = volume(page), page.picture()
    start = arrow(picture)
    page.drag(start, (start[0], start[1] - 160.0))
    assert viewer.settled(120.0)
    moved = max(float(np.abs(part.pose - np.eye(4)).max()) for part in viewer.stage.parts)
    assert moved > 1.0
    page.wait_for(f"!/volume {before:g}/.test({NUMBERS})")
    assert (np.abs(page.picture() - picture).sum(axis=2) > 60).mean() > 0.01
    for number in range(2):
        viewer.reset(number)
    assert viewer.settled(120.0)


def test_a_broken_file_gives_a_message_and_the_page_lives_on(viewer, page, tmp_path):
    bad = tmp_path / "broken.ply"
    bad.write_bytes(b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nend_header\n1\n")
    page.upload(bad)
    page.wait_for(f"/That did not work/.test({NUMBERS})")
    assert "broken.ply" in page.evaluate(NUMBERS)
    assert len(viewer.stage.parts) == 2
    good = tmp_path / "extra.xyz"
    points = np.random.default_rng(1).standard_normal((500, 3))
    good.write_text("\n".join(" ".join(map(str, 3.0 * p / np.linalg.norm(p))) for p in points))
    page.upload(good)
    page.wait_for(f"/put extra back/.test({NUMBERS})", 120.0)
    assert viewer.settled(120.0)
    assert len(viewer.stage.parts) == 3


def test_the_python_is_shown(page):
    page.click_button("show the Python")
    page.wait_for(f"/drill = surfel.Cylinder/.test({NUMBERS})")


def test_two_clients_see_the_same_and_one_may_leave_in_the_middle(viewer, page, tmp_path):
    with Page(tmp_path / "second", *WINDOW) as second:
        second.go(viewer.url)
        second.wait_for(READY, 120.0)
        second.rest()
        start = arrow(second.picture())
        second.drag(start, (start[0], start[1] - 120.0), release=False)
    assert viewer.settled(120.0)
    moved = [float(np.abs(part.pose - np.eye(4)).max()) for part in viewer.stage.parts]
    assert max(moved) > 1.0  # the hand that left counts as having let go
    now = surfel.measure(viewer.tree(), lines=16_384).volume
    told = str(now).split()[0]
    page.wait_for(f"{NUMBERS}.includes('volume {told} ')")
    for number in range(len(viewer.stage.parts)):
        viewer.reset(number)


def test_a_page_without_a_server(tmp_path):
    from surfel.viewer.view import write_html

    path = tmp_path / "scene.html"
    write_html(surfel.Box(2) - surfel.Sphere(1.2), path)
    with Page(tmp_path / "profile", 800, 600) as page:
        page.go(path.as_uri())
        page.wait_for("document.querySelector('canvas') !== null")
        time.sleep(3.0)
        picture = page.picture()
        assert page.complaints == []
        assert (np.ptp(picture, axis=2) > 8).mean() > 0.01
