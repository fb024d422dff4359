"""The REST API over real HTTP; the workers only count."""

import json
import shutil
import threading
import time
from http.client import HTTPConnection

import httpx
import pytest

from engine.scene.document import SIZE_LIMIT
from engine.scene.load import shipped_scenes
from tests.service.conftest import wait_for

QUICKSTART = shipped_scenes()["quickstart"].read_bytes()


def submit(http, scene=QUICKSTART, **headers):
    answer = http.post("/v1/jobs", content=scene, headers=headers)
    assert answer.status_code == 201, answer.text
    return answer.json()["id"]


def state(http, job):
    return http.get(f"/v1/jobs/{job}").json()["state"]


def finished(http, job=None):
    job = job or submit(http)
    wait_for(lambda: state(http, job) == "succeeded")
    return job


def long_scene():
    return json.dumps({**json.loads(QUICKSTART), "name": "long"}).encode()


def read_events(lines):
    """Return (id, kind, data) of each server-sent event."""
    events, fields = [], {}
    for line in lines:
        if line:
            name, _, value = line.partition(": ")
            fields[name] = value
        else:
            if "data" in fields:
                events.append((int(fields["id"]), fields["event"], json.loads(fields["data"])))
            fields = {}
    return events


def follow(http, job, last=0):
    with http.stream("GET", f"/v1/jobs/{job}/events", headers={"Last-Event-ID": str(last)}) as answer:
        assert answer.headers["content-type"].startswith("text/event-stream")
        return read_events(answer.iter_lines())


def assert_problem(answer, status):
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    problem = answer.json()
    assert problem["status"] == status and problem["title"] and problem["detail"]
    return problem


# jobs


def test_a_scene_becomes_a_job_that_is_run(http):
    answer = http.post("/v1/jobs", content=QUICKSTART)
    assert answer.status_code == 201
    job = answer.json()
    assert answer.headers["location"] == f"/v1/jobs/{job['id']}"
    assert job["state"] == "queued" and job["size"]["points"] > 0
    finished(http, job["id"])


def test_the_same_key_and_body_is_the_same_job(http):
    first = submit(http, **{"Idempotency-Key": "once"})
    again = http.post("/v1/jobs", content=QUICKSTART, headers={"Idempotency-Key": "once"})
    assert again.status_code == 200 and again.json()["id"] == first
    problem = assert_problem(http.post("/v1/jobs", content=long_scene(), headers={"Idempotency-Key": "once"}), 409)
    assert "once" in problem["detail"]


def test_pages_of_jobs(http):
    submitted = [submit(http) for _ in range(3)]
    listed, cursor = [], None
    while len(listed) < 3:
        page = http.get("/v1/jobs", params={"limit": 2} | ({"cursor": cursor} if cursor else {})).json()
        listed += [job["id"] for job in page["jobs"]]
        cursor = page["next"]
    assert listed[:3] == submitted[::-1]
    for job in submitted:
        finished(http, job)
    assert {job["state"] for job in http.get("/v1/jobs", params={"state": "succeeded"}).json()["jobs"]} == {"succeeded"}


def test_a_running_job_is_cancelled_within_a_second(http):
    job = submit(http, long_scene())
    wait_for(lambda: http.get(f"/v1/jobs/{job}").json().get("progress"))
    asked = time.monotonic()
    assert http.post(f"/v1/jobs/{job}/cancel").status_code == 200
    wait_for(lambda: state(http, job) == "cancelled")
    assert time.monotonic() - asked < 1.0
    assert http.post(f"/v1/jobs/{job}/cancel").json()["state"] == "cancelled"


# events


def test_events_are_followed_live_and_replayed_from_any_point(http):
    job = submit(http)
    live = follow(http, job)
    kinds = [kind for _, kind, _ in live]
    assert kinds[0] == "state" and "progress" in kinds and live[-1][2]["state"] == "succeeded"
    ids = [id for id, _, _ in live]
    assert ids == sorted(set(ids))
    middle = live[len(live) // 2][0]
    assert follow(http, job, middle) == [event for event in live if event[0] > middle]
    assert http.get(f"/v1/jobs/{job}/events", headers={"Last-Event-ID": str(ids[-1])}).status_code == 204


def test_all_jobs_are_followed_in_one_stream(http, service):
    seen = []

    def listen():
        with httpx.stream("GET", f"{service.url}/v1/events", trust_env=False, timeout=20) as answer:
            for line in answer.iter_lines():
                if line.startswith("data:"):
                    seen.append(json.loads(line.partition(": ")[2]))
                    if seen[-1].get("state") == "succeeded":
                        return

    listener = threading.Thread(target=listen)
    listener.start()
    time.sleep(0.3)
    job = submit(http)
    listener.join(20)
    assert seen[-1]["job"] == job and {event["job"] for event in seen} == {job}


@pytest.mark.parametrize("last", ["-1", "x", "1e3", str(2**80)])
def test_a_foolish_event_id_is_refused(http, last):
    job = submit(http)
    assert_problem(http.get(f"/v1/jobs/{job}/events", headers={"Last-Event-ID": last}), 422)


# files


@pytest.fixture(scope="module")
def done(service):
    """A finished job."""
    with httpx.Client(base_url=service.url, trust_env=False) as http:
        return finished(http)


def raw_status(service, path):
    """Ask for a path as it stands: other clients resolve its dots before they ask."""
    connection = HTTPConnection("127.0.0.1", service.port)
    connection.request("GET", path)
    return connection.getresponse().status


def test_files_whole_in_ranges_and_not_at_all(http, done):
    job = done
    names = {file["name"]: file["size"] for file in http.get(f"/v1/jobs/{job}/files").json()["files"]}
    assert names.keys() >= {"scene.json", "job.json", "attempts"}
    url = f"/v1/jobs/{job}/files/scene.json"
    whole = http.get(url)
    content, etag = whole.content, whole.headers["etag"]
    assert len(content) == names["scene.json"] == int(whole.headers["content-length"])
    for header, expected in (("bytes=0-9", content[:10]), ("bytes=10-", content[10:]), ("bytes=-7", content[-7:]),
                             (f"bytes=5-{10**9}", content[5:])):
        part = http.get(url, headers={"Range": header})
        assert part.status_code == 206 and part.content == expected
        assert part.headers["content-range"].endswith(f"/{len(content)}")
    assert http.get(url, headers={"Range": "bytes=0-9", "If-Range": '"old"'}).content == content
    assert http.get(url, headers={"If-None-Match": etag}).status_code == 304
    head = http.head(url)
    assert head.status_code == 200 and head.content == b"" and head.headers["content-length"] == str(len(content))
    for header in (f"bytes={len(content)}-", "bytes=5-2", "bytes=-0", "lines=1-2", "bytes=-"):
        assert_problem(http.get(url, headers={"Range": header}), 416)


def test_a_file_that_grows_is_sent_as_it_was(http, service, done):
    path = service.store.directory(done) / "growing"
    path.write_bytes(b"x" * 5_000_000)
    with http.stream("GET", f"/v1/jobs/{done}/files/growing") as answer:
        with path.open("ab") as file:
            file.write(b"y" * 1000)
        assert len(b"".join(answer.iter_bytes())) == 5_000_000 == int(answer.headers["content-length"])


@pytest.mark.parametrize("name", [
    "../.strandline/jobs.sqlite", "..%2f.strandline%2fjobs.sqlite", "%2e%2e/.strandline/jobs.sqlite", "/etc/passwd",
    "%2fetc%2fpasswd", "link", "frames", "frames/..", ".", "", "scene.json/", "scene.json%00", "half.aside", "nothing",
])
def test_no_name_leads_elsewhere(service, done, name):
    directory = service.store.directory(done)
    if not (directory / "link").is_symlink():
        (directory / "link").symlink_to("/etc/passwd")
        (directory / "frames").mkdir()
        (directory / "half.aside").write_text("half")
    assert raw_status(service, f"/v1/jobs/{done}/files/{name}") == 404


@pytest.mark.parametrize("job", ["..%2f.strandline", ".strandline", "%2e%2e", "..", "."])
def test_no_job_leads_elsewhere(service, job):
    assert raw_status(service, f"/v1/jobs/{job}/files/jobs.sqlite") == 404
    assert raw_status(service, f"/v1/jobs/{job}/report") == 404


def test_a_job_without_report_says_so(http, done):
    assert "no report" in assert_problem(http.get(f"/v1/jobs/{done}/report"), 404)["detail"]


# what is wrong


def changed(**changes):
    return json.dumps({**json.loads(QUICKSTART), **changes}).encode()


def bad_scenes():
    scene = json.loads(QUICKSTART)
    huge = {**scene["fabrics"][0], "warps": 32_000, "wefts": 32_000}
    return {
        "unknown key": (changed(colour="red"), "colour"),
        "wrong type": (changed(duration="long"), "duration"),
        "not a number": (changed(duration=1).replace(b'"duration": 1', b'"duration": NaN'), "duration"),
        "infinite": (changed(duration=1).replace(b'"duration": 1', b'"duration": 1e999'), "duration"),
        "negative radius": (changed(materials={"thin": {"radius": -1e-3}}), "materials.thin"),
        "1e9 nodes": (changed(fabrics=[huge, *scene["fabrics"][1:]]), "fabrics[0]"),
        "nested": (b"[" * 5_000_000 + b"]" * 5_000_000, ""),
        "nested objects": (b'{"a":' * 1_600_000 + b"1" + b"}" * 1_600_000, ""),
        "empty": (b"", ""),
        "empty object": (b"{}", None),
        "list": (b"[]", ""),
        "torn": (QUICKSTART[:-5], ""),
        "binary": (bytes(range(256)), ""),
    }


@pytest.mark.parametrize("kind", bad_scenes())
def test_a_bad_scene_is_refused_with_its_path(http, kind):
    scene, path = bad_scenes()[kind]
    problem = assert_problem(http.post("/v1/jobs", content=scene), 422)
    assert problem["problems"]
    if path is not None:
        assert any(item["path"].startswith(path) for item in problem["problems"]), problem
    assert any(item.get("allowed") or item["message"] for item in problem["problems"])
    assert http.get("/healthz").json() == {"status": "ok"}


def test_an_oversized_body_is_refused_before_it_is_read(http):
    assert_problem(http.post("/v1/jobs", content=b" " * (SIZE_LIMIT + 1)), 413)

    def chunks():
        for _ in range(SIZE_LIMIT // 2**20 + 2):
            yield b" " * 2**20

    assert_problem(http.post("/v1/jobs", content=chunks()), 413)
    assert http.get("/healthz").is_success


def test_a_full_disk_refuses_a_job_and_leaves_nothing(http, service, monkeypatch):
    def full(path, content):
        raise OSError(28, "No space left on device")

    before = sorted(service.store.data.iterdir())
    monkeypatch.setattr("service.store.write_whole", full)
    assert "No space left" in assert_problem(http.post("/v1/jobs", content=QUICKSTART), 507)["detail"]
    assert sorted(service.store.data.iterdir()) == before


def test_a_job_outlives_its_files(http, service):
    job = finished(http)
    shutil.rmtree(service.store.directory(job))
    assert http.get(f"/v1/jobs/{job}/files").json() == {"files": []}
    assert_problem(http.get(f"/v1/jobs/{job}/files/scene.json"), 404)
    assert_problem(http.get(f"/v1/jobs/{job}/report"), 404)
    assert http.get(f"/jobs/{job}").is_success and http.get("/").is_success


def test_every_error_is_a_problem(http):
    assert_problem(http.get("/v1/nothing"), 404)
    assert_problem(http.get("/v1/jobs/nothing"), 404)
    assert_problem(http.delete("/v1/jobs"), 405)
    assert "quickstart" in assert_problem(http.get("/v1/scenes/nothing"), 404)["allowed"]
    listed = assert_problem(http.get("/v1/jobs", params={"state": "asleep", "limit": 10**9}), 422)
    assert {item["path"] for item in listed["problems"]} == {"query.state", "query.limit"}


# what it tells of itself


def test_scenes_and_schema(http):
    assert "quickstart" in http.get("/v1/scenes").json()["scenes"]
    assert http.get("/v1/scenes/quickstart").content == QUICKSTART
    assert "duration" in http.get("/v1/schema").json()["properties"]
    assert "/v1/jobs/{job}/events" in http.get("/openapi.json").json()["paths"]


def test_metrics(http, done):
    lines = http.get("/metrics").text.splitlines()
    values = dict(line.rsplit(" ", 1) for line in lines if not line.startswith("#"))
    assert float(values['strandline_jobs{state="succeeded"}']) >= 1
    assert float(values["strandline_disk_free_bytes"]) > 0
