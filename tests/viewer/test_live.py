"""The page as a visitor sees it, in headless Chromium with software rendering."""

import io
import re
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Page, expect

from engine.run.frames import write_frame
from tests.browser import chromium
from tests.viewer import jobs, liquids, strands, synthetic
from viewer.server import LiveViewer

FRAMES = 10
PATIENCE = 90_000  # a processor that has other work takes seconds to draw [ms]


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("jobs")
    synthetic.write_job(path / "cloths", FRAMES)
    synthetic.write_job(path / "running", 3, state="running")
    synthetic.write_large_job(path / "large")
    strands.write_job(path / "tufts", 4)
    strands.write_falling_job(path / "falling")
    jobs.write_job(path / "swelling", strands.on_a_swelling_ball(), map(strands.frame, range(4)))
    strands.write_large_job(path / "hair")
    liquids.write_job(path / "basin", 4)
    liquids.write_job(path / "surfaced", 4, surfaced=True)
    liquids.write_large_job(path / "sea")
    return path


@pytest.fixture(scope="module")
def viewer(data) -> Iterator[LiveViewer]:
    served = LiveViewer(data, "127.0.0.1", 0)
    yield served
    served.stop()


@pytest.fixture(scope="module")
def page(viewer) -> Iterator[Page]:
    with chromium() as browser:
        page = browser.new_page(viewport={"width": 760, "height": 460})
        page.set_default_timeout(PATIENCE)
        expect.set_options(timeout=PATIENCE)
        yield page


def url(viewer: LiveViewer, job: str) -> str:
    return f"http://127.0.0.1:{viewer.port}/?job={job}"


def picture(page: Page) -> np.ndarray:
    """Return the 3D canvas once it has come to rest, as bytes."""
    last = np.zeros(0)
    deadline = time.monotonic() + PATIENCE / 1000
    while time.monotonic() < deadline:
        shot = page.locator("canvas").first.screenshot()
        now = np.asarray(Image.open(io.BytesIO(shot)).convert("RGB"), float)[:, :420]  # left of the panel
        if now.shape == last.shape and np.abs(now - last).max() < 3:
            return now
        last = now
        time.sleep(0.3)
    raise AssertionError("the picture does not come to rest")


def share_changed(a: np.ndarray, b: np.ndarray) -> float:
    return float((np.abs(a - b).max(axis=2) > 16).mean())


def drag_timeline_to_start(page: Page) -> None:
    thumb = page.get_by_role("slider").first.bounding_box()
    assert thumb
    x, y = thumb["x"] + thumb["width"] / 2, thumb["y"] + thumb["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x - 60, y, steps=4)
    page.mouse.move(x - 400, y, steps=4)
    page.mouse.up()


def test_dragging_the_timeline_and_toggling_layers_change_the_picture(page, viewer):
    requests: list[str] = []
    page.on("request", lambda request: requests.append(request.url))
    page.goto(url(viewer, "cloths"))
    expect(page.get_by_text("two cloths by formula")).to_be_visible()
    expect(page.get_by_text(f"frame {FRAMES - 1} of {FRAMES - 1}")).to_be_visible()
    last = picture(page)
    assert share_changed(last, np.broadcast_to(last[5, 5], last.shape)) > 0.1, "something is drawn"

    drag_timeline_to_start(page)
    expect(page.get_by_text(f"frame 0 of {FRAMES - 1}")).to_be_visible()
    first = picture(page)
    assert share_changed(first, last) > 0.02

    page.get_by_role("checkbox", name="Nodes").click()
    nodes = picture(page)
    assert share_changed(nodes, first) > 0.02
    red = (nodes[..., 0] > 1.6 * nodes[..., 1]) & (nodes[..., 0] > 1.6 * nodes[..., 2])
    assert red.sum() > 20, "EIL-EIL nodes are red"

    page.get_by_role("checkbox", name="Obstacles").click()
    assert share_changed(picture(page), nodes) > 0.02

    page.get_by_role("button", name="next").click()
    expect(page.get_by_text(f"frame 1 of {FRAMES - 1}")).to_be_visible()
    page.get_by_role("button", name="Play").click()
    expect(page.get_by_text(f"frame {FRAMES - 1} of {FRAMES - 1}")).to_be_visible()
    outside = [address for address in requests if "127.0.0.1" not in address]
    assert not outside, "the page asks nobody else for anything"


def test_new_frames_of_a_running_job_are_followed(page, viewer, data):
    page.goto(url(viewer, "running"))
    expect(page.get_by_text("running · time 0.067 s · frame 2 of 2")).to_be_visible()
    write_frame(data / "running", synthetic.frame(3))
    expect(page.get_by_text("frame 3 of 3")).to_be_visible()


def test_an_unreadable_scene_is_said_and_its_yarns_are_shown(page, viewer, data):
    synthetic.write_job(data / "broken", 2)
    (data / "broken" / "scene.json").write_text("{")
    page.goto(url(viewer, "broken"))
    expect(page.get_by_text("scene not readable")).to_be_visible()
    expect(page.get_by_text("frame 1 of 1")).to_be_visible()


def test_a_job_that_has_not_begun_is_waited_for(page, viewer, data):
    page.goto(url(viewer, "later"))
    expect(page.get_by_text("shown here as soon as it begins")).to_be_visible()
    synthetic.write_job(data / "later", 1)
    expect(page.get_by_text("frame 0 of 0")).to_be_visible()


def test_the_largest_cloth_is_drawn_coarser_and_that_is_said(page, viewer):
    page.goto(url(viewer, "large"))
    statement = page.get_by_text(re.compile(r"shown 1\d,\d{3} of 1,\d{3},\d{3} segments; every 9th yarn"))
    expect(statement).to_be_visible()
    cloths = picture(page)
    green = (cloths[..., 1] > 1.2 * cloths[..., 0]) & (cloths[..., 1] > 1.1 * cloths[..., 2])
    yellow = (cloths[..., 0] > 1.2 * cloths[..., 2]) & (cloths[..., 1] > 1.1 * cloths[..., 2])
    assert green.mean() > 0.03 and yellow.mean() > 0.03, "both fabrics"


def choose(page: Page, box: str, option: str) -> None:
    page.get_by_role("combobox", name=box).click()
    page.get_by_role("option", name=option, exact=True).click()


def test_strands_are_drawn_in_the_colours_of_what_one_asks_for(page, viewer):
    page.goto(url(viewer, "tufts"))
    expect(page.get_by_text("two tufts by formula")).to_be_visible()
    expect(page.get_by_text("shown all 1,152 segments")).to_be_visible()
    expect(page.get_by_role("checkbox", name="Strands")).to_be_visible()
    expect(page.get_by_role("checkbox", name="Nodes")).to_have_count(0)
    groups = picture(page)
    blue = groups[..., 2] > 1.3 * groups[..., 0]
    brown = groups[..., 0] > 1.3 * groups[..., 2]
    assert blue.mean() > 0.005 and brown.mean() > 0.005, "both tufts"

    choose(page, "Colour by", "contact force")
    expect(page.get_by_text("contact force, with 99% of the frame in this range")).to_be_visible()
    forces = picture(page)
    red = (forces[..., 0] > 1.5 * forces[..., 1]) & (forces[..., 0] > 1.5 * forces[..., 2])
    assert red.sum() > 20, "what presses"
    choose(page, "Colour by", "stretch strain")
    expect(page.get_by_text("+2%")).to_be_visible()
    assert share_changed(picture(page), forces) > 0.005

    page.get_by_role("checkbox", name="Strands").click()
    bare = picture(page)
    assert not ((bare[..., 2] > 1.3 * bare[..., 0]).mean() > 0.005), "only the ball is left"


def test_the_solver_says_how_strands_did(page, viewer):
    page.goto(url(viewer, "tufts"))
    expect(page.get_by_text("frame 3 of 3")).to_be_visible()
    page.get_by_role("tab", name="Solver").click()
    for name, value in (("Newton iterations", "4"), ("contacts", "15"), ("deepest overlap", "0.0001 radii")):
        expect(page.locator("div", has=page.get_by_text(name, exact=True)).get_by_text(value, exact=True).last).to_be_visible()
    expect(page.get_by_text("Deepest overlap, log10")).to_be_attached()
    expect(page.get_by_text("Widest gap, log10")).to_have_count(0)


def test_what_has_fallen_far_is_shown_from_its_beginning(page, viewer):
    page.goto(url(viewer, "falling"))
    expect(page.get_by_text("frame 0 of 1")).to_be_visible()
    tufts = picture(page)
    assert (tufts[..., 2] > 1.3 * tufts[..., 0]).mean() > 0.005, "and is no speck"


def test_a_body_that_changes_is_drawn_in_the_shape_of_the_moment(page, viewer):
    page.goto(url(viewer, "swelling"))
    expect(page.get_by_text("frame 3 of 3")).to_be_visible()
    page.get_by_role("checkbox", name="Strands").click()
    swollen = picture(page)
    page.get_by_role("button", name="first").click()
    expect(page.get_by_text("frame 0 of 3")).to_be_visible()
    small = picture(page)
    page.get_by_role("checkbox", name="Obstacles").click()
    bare = picture(page)
    area, swollen_area = share_changed(small, bare), share_changed(swollen, bare)
    assert area > 0.01 and swollen_area / area == pytest.approx(1.4**2, rel=0.15)


def test_a_page_goes_from_strands_to_yarns_and_back(page, viewer):
    page.goto(url(viewer, "tufts"))
    expect(page.get_by_text("shown all 1,152 segments")).to_be_visible()
    choose(page, "Job", "cloths")
    expect(page.get_by_text("shown all 350 segments")).to_be_visible()
    expect(page.get_by_role("checkbox", name="Yarns")).to_be_visible()
    expect(page.get_by_role("checkbox", name="Nodes")).to_be_visible()
    assert page.get_by_role("combobox", name="Colour by").input_value() == "fabric"
    cloths = picture(page)
    assert ((cloths[..., 1] > 1.2 * cloths[..., 0]) & (cloths[..., 1] > 1.1 * cloths[..., 2])).mean() > 0.01, "cloths only"
    choose(page, "Job", "tufts")
    expect(page.get_by_text("shown all 1,152 segments")).to_be_visible()
    expect(page.get_by_role("checkbox", name="Nodes")).to_have_count(0)


def test_a_head_of_hair_is_drawn_by_some_of_its_strands(page, viewer):
    page.goto(url(viewer, "hair"))
    expect(page.get_by_text("shown 19,995 of 480,000 segments; 1,333 of 32,000 strands")).to_be_visible()
    hair = picture(page)
    assert (hair[..., 0] > 1.2 * hair[..., 2]).mean() > 0.1, "a head of brown hair"


def blue(shot: np.ndarray) -> float:
    """Share of the picture that is blue."""
    return float((shot[..., 2] > 1.25 * shot[..., 0]).mean())


def test_liquid_is_drawn_in_the_colours_of_what_one_asks_for(page, viewer):
    page.goto(url(viewer, "basin"))
    expect(page.get_by_text("shown all 6,401 particles")).to_be_visible()
    expect(page.get_by_role("checkbox", name="Liquid")).to_be_visible()
    for absent in ("Nodes", "Surface"):
        expect(page.get_by_role("checkbox", name=absent)).to_have_count(0)
    assert blue(picture(page)) > 0.05

    choose(page, "Colour by", "shear stress")
    expect(page.get_by_text("shear stress, with 99% of the frame in this range")).to_be_visible()
    choose(page, "Colour by", "yielding")
    expect(page.get_by_text("not yielded: elastic")).to_be_visible()
    yielding = picture(page)
    orange = yielding[..., 0] > 1.5 * yielding[..., 2]
    assert orange.mean() > 0.02 and blue(yielding) < 0.01

    page.get_by_role("checkbox", name="Liquid").click()
    bare = picture(page)
    assert (bare[..., 0] > 1.5 * bare[..., 2]).mean() < 0.01, "only obstacles are left, and the edge of a notice"


def test_the_surface_of_liquid_follows_the_frames_and_gives_way_to_particles(page, viewer):
    page.goto(url(viewer, "surfaced"))
    expect(page.get_by_text(re.compile(r"shown the surface, [\d,]+ triangles"))).to_be_visible()
    expect(page.get_by_text("frame 3 of 3")).to_be_visible()
    last = picture(page)
    assert blue(last) > 0.05
    page.get_by_role("button", name="first").click()
    expect(page.get_by_text("frame 0 of 3")).to_be_visible()
    first = picture(page)
    assert blue(first) > 0.05 and share_changed(first, last) > 0.01
    page.get_by_role("checkbox", name="Surface").click()
    expect(page.get_by_text("shown all 6,401 particles")).to_be_visible()
    particles = picture(page)
    assert blue(particles) == pytest.approx(blue(first), rel=0.2) and share_changed(particles, first) > 0.01


def test_much_liquid_is_drawn_by_some_of_its_particles(page, viewer):
    page.goto(url(viewer, "sea"))
    expect(page.get_by_text("shown 20,000 of 172,801 particles, as large as all of them together")).to_be_visible()
    assert blue(picture(page)) > 0.05


def test_the_solver_says_how_liquid_did(page, viewer):
    page.goto(url(viewer, "basin"))
    expect(page.get_by_text("frame 3 of 3")).to_be_visible()
    page.get_by_role("tab", name="Solver").click()
    expect(page.get_by_text("Iterations for pressure", exact=True)).to_be_attached()
    expect(page.get_by_text("iterations for pressure", exact=True)).to_be_visible()
    expect(page.get_by_text("6,401", exact=True)).to_be_visible()
    expect(page.get_by_text("Newton residual, log10")).to_have_count(0)


def test_strangers_are_turned_away(viewer):
    address = f"http://127.0.0.1:{viewer.port}/"
    assert httpx.get(address).status_code == 200
    assert httpx.get(address, headers={"Host": "evil.example"}).status_code == 421
    handshake = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13",
                 "Sec-WebSocket-Key": "x" * 22 + "=="}  # fmt: skip
    assert httpx.get(address, headers={**handshake, "Origin": "http://evil.example"}).status_code == 403


def test_an_address_for_others_needs_a_token(data):
    with pytest.raises(ValueError, match="token"):
        LiveViewer(data, "0.0.0.0", 0)
