"""The pages in a real browser, with real workers: submit a scene, see it finish, read its report."""

import json

import httpx
import pytest
from playwright.sync_api import expect

from engine.scene.load import shipped_scenes
from tests.browser import chromium
from tests.service.conftest import serving, wait_for

PATIENCE = 300_000  # the first run after an edit compiles all kernels [ms]


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    yield from serving(tmp_path_factory.mktemp("site"))


@pytest.fixture(scope="module")
def finished(site):
    """A finished job with report and recording."""
    scene = {**json.loads(shipped_scenes()["crossing-sliders"].read_text()), "name": "short", "duration": 0.1}
    job = httpx.post(site.url + "/v1/jobs", json=scene, trust_env=False).json()["id"]
    wait_for(lambda: site.store.get(job).state == "succeeded", PATIENCE / 1000)
    return job


@pytest.fixture(scope="module")
def browser():
    with chromium() as opened:
        yield opened


@pytest.fixture
def page(browser, site):
    opened = browser.new_page(viewport={"width": 1200, "height": 900})
    opened.complaints = []
    opened.on("pageerror", lambda error: opened.complaints.append(str(error)))
    opened.on("console", lambda message: opened.complaints.append(message.text) if message.type == "error" else None)
    opened.goto(site.url)
    yield opened
    opened.close()


def scene_file(tmp_path, **changes):
    scene = {**json.loads(shipped_scenes()["crossing-sliders"].read_text()), **changes}
    (tmp_path / "scene.json").write_text(json.dumps(scene))
    return tmp_path / "scene.json"


def test_a_scene_is_submitted_followed_and_reported(page, site, tmp_path):
    page.get_by_label("Scene", exact=True).select_option("crossing-sliders")
    page.get_by_role("button", name="Run").click()
    card = page.locator(".card").first
    expect(card).to_contain_text("crossing-sliders")
    expect(card.locator(".state")).to_have_text("running", timeout=PATIENCE)
    expect(card).to_contain_text("time left", timeout=PATIENCE)
    expect(card.locator(".state")).to_have_text("succeeded", timeout=PATIENCE)
    assert card.locator("progress").evaluate("bar => bar.value") == 1
    expect(page.locator("[data-census=succeeded]")).not_to_have_text("0")
    assert card.get_by_role("link", name="View in 3D").get_attribute("href").startswith(
        f"http://127.0.0.1:{site.viewer_port}/?job=")
    page.screenshot(path=tmp_path / "jobs.png")
    card.get_by_role("link", name="Report").click()
    expect(page.get_by_role("heading", name="Report")).to_be_visible()
    expect(page.locator("#report")).to_contain_text("Newton residual, largest")
    expect(page.get_by_role("link", name="recording.rrd")).to_be_visible()
    page.screenshot(path=tmp_path / "report.png", full_page=True)
    assert page.complaints == []


def test_a_running_job_is_cancelled_by_its_button(page, tmp_path):
    page.locator("#file").set_input_files(scene_file(tmp_path, name="endless", duration=1000.0))
    card = page.locator(".card", has_text="endless")
    expect(card).to_contain_text("time left", timeout=PATIENCE)
    card.get_by_role("button", name="Cancel").click()
    expect(card.locator(".state")).to_have_text("cancelled", timeout=2000)
    assert page.complaints == []


def test_what_waits_says_how_large_it_is(page, tmp_path):
    page.locator("#file").set_input_files(scene_file(tmp_path, name="first", duration=1000.0))
    first = page.locator(".card", has_text="first")
    expect(first.locator(".state")).to_have_text("running", timeout=PATIENCE)
    waiting = {"knot-pull": "1 strand with 140 vertices", "curly-hair-swing": "100 strands with 6 400 vertices",
               "chain-over-peg": "21 points"}
    for scene, extent in waiting.items():
        page.get_by_label("Scene", exact=True).select_option(scene)
        page.get_by_role("button", name="Run").click()
        card = page.locator(".card", has_text=scene)
        expect(card.locator(".waiting")).to_contain_text(f"Waiting for a free worker: {extent}, about")
        page.screenshot(path=tmp_path / f"{scene}.png")
        card.get_by_role("button", name="Cancel").click()
        expect(card.locator(".state")).to_have_text("cancelled")
    first.get_by_role("button", name="Cancel").click()
    expect(first.locator(".state")).to_have_text("cancelled", timeout=2000)
    assert page.complaints == []


def test_a_bad_scene_is_explained_in_place(page, tmp_path):
    page.locator("#file").set_input_files(scene_file(tmp_path, colour="red", duration=-1))
    outcome = page.locator("#outcome")
    expect(outcome).to_contain_text("colour")
    expect(outcome).to_contain_text("unknown key")
    expect(outcome).to_contain_text("duration")
    expect(outcome).to_contain_text("allowed")


def test_a_recording_is_played_by_the_service_alone(page, site, finished):
    elsewhere = []

    def note(answer):
        if not answer.url.startswith((site.url, "blob:", "data:")):
            elsewhere.append(answer.url)

    page.context.on("response", note)
    page.goto(f"{site.url}/jobs/{finished}")
    link = page.get_by_role("link", name="Recording", exact=True).get_attribute("href")
    with page.expect_response(lambda answer: answer.url.endswith("recording.rrd") and answer.ok, timeout=60_000):
        page.goto(site.url + link)
    assert elsewhere == []


def test_the_reference_shows_every_operation(page):
    page.get_by_role("link", name="API").click()
    expect(page.get_by_text("/v1/jobs/{job}/events")).to_be_visible()
    assert page.complaints == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_nothing_is_wider_than_a_phone(browser, site, finished, scheme, tmp_path):
    phone = browser.new_page(viewport={"width": 360, "height": 740}, color_scheme=scheme)
    for path in ("/", "/docs", f"/jobs/{finished}"):
        phone.goto(site.url + path)
        assert phone.evaluate("document.documentElement.scrollWidth") <= 360, path
        phone.screenshot(path=tmp_path / f"{path.strip('/').replace('/', '-') or 'jobs'}.png", full_page=True)
    phone.close()
