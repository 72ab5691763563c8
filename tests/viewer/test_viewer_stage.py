"""The stage without a browser: parts, poses, operations, drafts, the program that it writes, and its worker."""

from __future__ import annotations

import threading

import numpy as np
import pytest

import surfel
from surfel.viewer.draft import Draft
from surfel.viewer.elements import MOST, elements_of
from surfel.viewer.frame import Frame, quaternion, turned, upright
from surfel.viewer.script import script_of
from surfel.viewer.stage import Stage
from surfel.viewer.worker import Worker

BOX = np.array([[-3.0] * 3, [3.0] * 3])


def ball(n=3000, radius=1.0, **known):
    p = np.random.default_rng(5).standard_normal((n, 3))
    p /= np.linalg.norm(p, axis=1, keepdims=True)
    return surfel.Surfels(p * radius, p, **known)


def shifted(x, y, z):
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return pose


def test_leaves_become_parts_and_nodes_joins():
    a, b, c = surfel.Box(1), surfel.Sphere(1), ball()
    stage = Stage((a - b) | (c & a))
    assert [part.shape for part in stage.parts] == [a, b, c]  # one that occurs twice is one part
    assert [part.name for part in stage.parts] == ["box", "sphere", "cloud"]
    assert [join.operation for join in stage.joins] == ["union", "difference", "intersection"]
    assert [part.name for part in Stage((a - b) | (c & a), names=["block", "", "scan"]).parts] == [
        "block",
        "sphere",
        "scan",
    ]
    stage.switch(1, "union")
    assert stage.joins[1].operation == "union"


def test_several_shapes_are_joined_one_after_the_other():
    stage = Stage([surfel.Box(1), surfel.Sphere(1), surfel.Sphere(2)], names=["block", "hole"])
    assert [part.name for part in stage.parts] == ["block", "hole", "sphere"]
    assert [join.operation for join in stage.joins] == ["union", "union"]
    stage.add(surfel.Sphere(3), ["hole"])
    assert stage.parts[-1].name == "hole 2"


@pytest.mark.parametrize("nothing", [[], 3, "box", np.zeros((5, 3)), [surfel.Box(1), None]])
def test_what_is_no_shape_is_refused(nothing):
    with pytest.raises(surfel.InputError, match=r"shapes can be shown|nothing to see"):
        Stage(nothing)


def test_a_moved_part_moves_in_the_tree():
    stage = Stage(surfel.Box(2) | surfel.Sphere(1))
    stage.move(1, shifted(5, 0, 0))
    tree = stage.tree()
    assert tree.contains([[5.0, 0.0, 0.0], [0.0, 0.0, 0.0], [3.0, 0.0, 0.0]]).tolist() == [True, True, False]
    assert surfel.measure(tree).volume.value == pytest.approx(8.0 + 4.0 / 3.0 * np.pi, rel=1e-3)


@pytest.mark.parametrize("operation", ["union", "intersection", "difference"])
@pytest.mark.parametrize("pose", [np.eye(4), shifted(0.7, 0.2, -0.1)])
def test_a_draft_keeps_what_the_rule_keeps(operation, pose):
    stage = Stage([ball(), surfel.Sphere(0.8)])
    stage.switch(0, operation)
    stage.move(1, pose)
    elements = [elements_of(part.shape, BOX) for part in stage.parts]
    kept = Draft().kept(stage, elements)
    first, second = elements[0].points, elements[1].points + pose[:3, 3]
    first_in = np.linalg.norm(first - pose[:3, 3], axis=1) < 0.8
    second_in = np.linalg.norm(second, axis=1) < 1.0
    expected = {
        "union": (~first_in, ~second_in),
        "intersection": (first_in, second_in),
        "difference": (~first_in, second_in),
    }
    for found, wanted in zip(kept, expected[operation], strict=True):
        assert (found == wanted).mean() > 0.998  # a cloud knows its surface to a part of its spacing
    assert (kept[0] == expected[operation][0]).all()  # an exact solid knows it exactly


def test_a_draft_asks_only_what_has_moved(monkeypatch):
    from surfel.viewer import draft as module

    asked = []
    real = module._in_solid

    def noted(k, mine, solid, pose):
        asked.append(solid)
        return real(k, mine, solid, pose)

    monkeypatch.setattr(module, "_in_solid", noted)
    stage = Stage([surfel.Sphere(1), surfel.Box(1), surfel.Sphere(0.5)])
    elements = [elements_of(part.shape, BOX) for part in stage.parts]
    draft = Draft()
    draft.kept(stage, elements)
    assert len(asked) == 6
    draft.kept(stage, elements)
    assert len(asked) == 6
    stage.move(2, shifted(0.1, 0, 0))
    draft.kept(stage, elements)
    assert len(asked) == 10


def test_sheets_bound_nothing_in_a_draft():
    stage = Stage([ball(solid=False), surfel.Sphere(0.8)])
    stage.switch(0, "difference")
    elements = [elements_of(part.shape, BOX) for part in stage.parts]
    kept = Draft().kept(stage, elements)
    assert kept[0].all()
    assert not kept[1].any()


def test_what_has_no_end_is_shown_in_the_box():
    elements = elements_of(surfel.HalfSpace((0, 0, 1), 0.5), BOX)
    assert len(elements.points) > 1000
    assert np.abs(elements.points[:, 2] - 0.5).max() < 1e-9
    assert np.abs(elements.points).max() <= 3.0


def test_large_clouds_are_thinned_and_their_disks_grow():
    whole = elements_of(ball(5000), BOX)
    some = elements_of(ball(5000), BOX, most=1000)
    assert len(whole.points) == 5000 <= MOST
    assert len(some.points) == 1000
    assert np.median(some.radii) == pytest.approx(np.sqrt(5.0) * np.median(whole.radii), rel=0.1)


def test_frames_go_there_and_back():
    rng = np.random.default_rng(3)
    frame = Frame.of(np.array([[100.0, 200.0, -5.0], [108.0, 206.0, 0.0]]))
    for _ in range(20):
        wxyz = rng.standard_normal(4)
        pivot, position = rng.uniform(90, 210, 3), rng.uniform(-2, 2, 3)
        pose = frame.pose(position, wxyz, pivot)
        assert np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-12)
        again, turn = frame.control(pose, pivot)
        assert np.allclose(again, position, atol=1e-9)
        assert np.allclose(turned(turn), turned(wxyz), atol=1e-12)
        assert turn[0] >= 0.0
    assert np.allclose(quaternion(np.eye(3)), [1, 0, 0, 0])


def test_disks_face_their_normals():
    normals = np.random.default_rng(1).standard_normal((200, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals[0], normals[1] = (0, 0, -1), (0, 0, 1)
    for q, n in zip(upright(normals), normals, strict=True):
        assert np.allclose(turned(q)[:, 2], n, atol=1e-6)


def test_the_program_makes_the_same_tree(tmp_path):
    path = tmp_path / "ball.ply"
    surfel.write(path, ball())
    cloud = surfel.read(path)
    block, cone, ring = surfel.Box((1, 2, 3)).translated((0.5, 0, 0)), surfel.Cone(1, 0.5, 2), surfel.Torus(2, 1)
    stage = Stage((cloud | block) - (cone & ring))
    stage.move(1, shifted(0.25, 0, 0))
    text = script_of(stage)
    names = {}
    exec(text.split("m = surfel.measure")[0], names)
    places = np.random.default_rng(2).uniform(-1.5, 1.5, (500, 3))
    assert np.array_equal(names["tree"].contains(places), stage.tree().contains(places))


def test_the_program_says_what_it_cannot_make():
    stage = Stage([ball(), surfel.Sphere(1)], names=["import me", "2nd"])
    text = script_of(stage)
    assert "import_me = ...  # Surfels that was handed over" in text
    assert "part_2nd = surfel.Sphere(radius=1.0)" in text


def test_a_worker_follows_and_settles_once():
    followed, settled, failed = [], [], []
    worker = Worker(lambda: followed.append(1), lambda stale: settled.append(stale()), failed.append)
    for _ in range(5):
        worker.moved()
    worker.rest()
    worker.start()
    assert worker.wait(10.0)
    assert (len(followed), settled, failed) == (1, [False], [])  # moves that come together are taken together
    worker.moved()  # a hand that left without letting go
    assert worker.wait(10.0)
    assert len(settled) == 2
    worker.end()


def test_what_is_out_of_date_is_done_anew():
    gate, entered = threading.Event(), threading.Event()
    seen = []

    def settle(stale):
        entered.set()
        gate.wait(10.0)
        seen.append(stale())

    worker = Worker(lambda: None, settle, lambda error: None)
    worker.start()
    worker.rest()
    assert entered.wait(10.0)
    worker.rest()
    gate.set()
    assert worker.wait(10.0)
    assert seen == [True, False]
    worker.end()


def test_a_failure_is_told_and_the_worker_lives_on():
    failed, done = [], threading.Event()

    def follow():
        if not failed:
            raise surfel.InputError("no such thing")
        done.set()

    worker = Worker(follow, lambda stale: None, failed.append)
    worker.start()
    worker.rest()
    assert worker.wait(10.0)
    assert str(failed[0]) == "no such thing"
    worker.rest()
    assert done.wait(10.0)
    worker.end()
    worker.end()  # twice is no harm


class Scene:
    """A scene that notes what is in it: by name, the props of each node."""

    def __init__(self):
        self.nodes = {}

    def _added(self, name, **known):
        from unittest.mock import MagicMock

        node = MagicMock(**{"visible": True, **known})
        node.remove.side_effect = lambda: self.nodes.pop(name)
        self.nodes[name] = node
        return node

    def add_frame(self, name, **known):
        return self._added(name, **known)

    def add_batched_meshes_simple(self, name, *given, **known):
        return self._added(name, **known)

    def __getattr__(self, name):
        from unittest.mock import MagicMock

        return MagicMock()


def a_page():
    from unittest.mock import MagicMock

    from surfel.viewer.page import Page

    page = Page(MagicMock(scene=Scene()))
    elements = elements_of(ball(200), BOX)
    page.add_part(0, elements, Frame.of(BOX), np.zeros(3), lambda *moved: None)
    return page, elements


def test_the_result_takes_the_place_of_the_parts_and_the_other_way_round():
    page, elements = a_page()
    disks = page.server.scene.nodes["/parts/0/drawn/disks"]
    page.show_parts([np.arange(200) < 50])
    assert disks.visible and np.count_nonzero(disks.batched_scales) == 50
    page.show_result(elements, np.zeros(200, int), Frame.of(BOX))
    result = page.server.scene.nodes["/exact/result"]
    assert result.visible and not disks.visible
    page.show_parts([np.ones(200, bool)])
    assert disks.visible and not result.visible


@pytest.mark.parametrize(("up", "axis"), [("x", 0), ("y", 1), ("z", 2)])
def test_cameras_are_above_whatever_axis_is_up(up, axis):
    from surfel.viewer.page import SEEN_FROM

    assert SEEN_FROM[up][axis] == 1.6
    assert np.linalg.norm(SEEN_FROM[up]) == pytest.approx(np.linalg.norm(SEEN_FROM["z"]))


@pytest.mark.parametrize("wrong", [{"up": "w"}, {"draw": "me"}])
def test_wrong_choices_are_refused_before_anybody_listens(wrong, monkeypatch):
    from surfel.viewer import viewer

    monkeypatch.setattr(viewer, "start_server", lambda *given: pytest.fail("a server was started"))
    with pytest.raises(surfel.InputError, match=next(iter(wrong))):
        surfel.view(surfel.Sphere(1), port=0, **wrong)


@pytest.mark.parametrize("host", ["192.0.2.1", "no such host", "x" * 70])
def test_addresses_of_others_are_refused(host):
    pytest.importorskip("viser")
    with pytest.raises(surfel.InputError, match="cannot listen on"):
        surfel.view(surfel.Sphere(1), host=host, port=0)


def test_the_probe_is_an_image_whose_script_survives_quoting():
    from html.parser import HTMLParser

    from surfel.viewer.probe import probe

    found = {}
    parser = HTMLParser()
    parser.handle_starttag = lambda tag, known: found.update({tag: dict(known)})
    parser.feed(probe("draw on the server"))
    assert set(found) == {"img"} and found["img"]["src"].startswith("data:")
    assert "innerText.trim() === 'draw on the server'" in found["img"]["onload"]
    assert "label && document" in found["img"]["onload"] and "one => one" in found["img"]["onload"]


def test_disks_are_hidden_from_single_clients_also_those_that_come_later():
    """Whoever gets pictures sees no disks; whoever does not still does."""
    from unittest.mock import MagicMock

    page, elements = a_page()
    client = MagicMock(client_id=7, scene=Scene())
    page.hide_from(client, True)
    page.add_part(1, elements, Frame.of(BOX), np.zeros(3), lambda *moved: None)
    veiled = client.scene.nodes
    assert set(veiled) == {"/exact", "/parts/0/drawn", "/parts/1/drawn"}
    assert not any(veil.visible for veil in veiled.values())
    assert all(node.visible for node in page.server.scene.nodes.values())
    page.hide_from(client, False)
    assert not veiled


def test_large_results_are_thinned_but_not_at_the_cut():
    from surfel.viewer.elements import Elements, thinned

    rng = np.random.default_rng(0)
    whole = Elements(rng.random((1000, 3)), np.zeros((1000, 3)), np.ones(1000), None)
    precious = np.arange(1000) % 10 == 0
    some, rows = thinned(whole, precious, 400)
    assert 300 < len(some.points) <= 400
    assert np.isin(np.flatnonzero(precious), rows).all()
    assert (some.radii[precious[rows]] == 1.0).all()
    assert some.radii[~precious[rows]] == pytest.approx(np.sqrt(3.0))
    assert np.array_equal(some.points, whole.points[rows])
    assert thinned(whole, precious, 1000)[0] is whole


def test_what_does_not_move_stays_the_same_object():
    """What was learnt of a solid, its index or its disks, is kept while others move and cameras turn."""
    stage = Stage([ball(), surfel.Sphere(1)])
    stage.move(0, shifted(1, 0, 0))
    tree, cloud = stage.tree(), stage.parts[0].moved
    assert stage.tree() is tree
    stage.move(1, shifted(0, 1, 0))
    assert stage.tree() is not tree and stage.parts[0].moved is cloud
    tree = stage.tree()
    stage.switch(0, "difference")
    assert stage.tree() is not tree and stage.tree().operation == "difference"


def test_a_hand_is_followed_while_the_last_rest_is_settled():
    gate, entered, followed = threading.Event(), threading.Event(), threading.Event()
    seen = []

    def settle(stale):
        entered.set()
        gate.wait(10.0)
        seen.append(stale())

    def follow():
        if entered.is_set():
            followed.set()

    worker = Worker(follow, settle, lambda error: None)
    worker.start()
    worker.rest()
    assert entered.wait(10.0)
    worker.moved()
    assert followed.wait(10.0)  # though settle has not come back
    worker.rest()
    gate.set()
    assert worker.wait(10.0)
    assert seen == [True, False]
    worker.end()
