import json
import threading
import time

import pytest

from service.lifecycle import ImpossibleEvent, JobEvent, JobState
from service.store import KEPT_EVENTS, LeaseLost, Store, SubmissionConflict

SIZE = {"nodes": 4, "points": 2, "frames": 10, "steps": 100}


@pytest.fixture
def store(tmp_path):
    return Store(tmp_path / "data")


def submit(store, name="scene", **options):
    return store.submit(name, "{}", SIZE, **options)[0]


def test_a_submitted_job_waits_in_its_directory(store):
    job = submit(store)
    assert job.state == JobState.QUEUED
    assert store.get(job.id) == job
    assert (store.directory(job.id) / "scene.json").read_text() == "{}"
    held = json.loads((store.directory(job.id) / "job.json").read_text())
    assert held["state"] == "queued" and held["attempts"] == 0 and held["id"] == job.id


def test_each_job_is_claimed_once(store):
    submitted = {submit(store).id for _ in range(60)}
    claimed = []

    def claim_all():
        while (job := store.claim(10)) is not None:
            claimed.append(job.id)

    threads = [threading.Thread(target=claim_all) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(claimed) == 60 and set(claimed) == submitted


def test_jobs_are_claimed_in_order(store):
    ids = [submit(store).id for _ in range(3)]
    assert [store.claim(10).id for _ in range(3)] == ids
    assert store.claim(10) is None


def test_a_lost_lease_goes_to_another_and_fences_the_first(store):
    submit(store)
    first = store.claim(-1)
    assert [job.state for job in store.expire()] == [JobState.QUEUED]
    second = store.claim(10)
    assert second.id == first.id and second.fence > first.fence and second.life.attempts == 2
    for write in (lambda: store.renew(first.id, first.fence, 10),
                  lambda: store.report_progress(first.id, first.fence, {}),
                  lambda: store.settle(first.id, first.fence, JobEvent.SUCCEED)):
        with pytest.raises(LeaseLost):
            write()
    assert store.settle(second.id, second.fence, JobEvent.SUCCEED).state == JobState.SUCCEEDED


def test_a_renewed_lease_does_not_expire(store):
    submit(store)
    job = store.claim(0.01)
    store.renew(job.id, job.fence, 10)
    time.sleep(0.02)
    assert store.expire() == []


def test_a_job_that_ended_holds_no_lease(store):
    submit(store)
    job = store.claim(10)
    store.settle(job.id, job.fence, JobEvent.FAIL, "a knot")
    assert store.get(job.id).reason == "a knot"
    with pytest.raises(LeaseLost):
        store.settle(job.id, job.fence, JobEvent.SUCCEED)


def test_the_same_key_means_the_same_job(store):
    first = submit(store, key="k", digest="a")
    again, new = store.submit("scene", "{}", SIZE, key="k", digest="a")
    assert again.id == first.id and not new
    with pytest.raises(SubmissionConflict):
        store.submit("scene", "{}", SIZE, key="k", digest="b")
    assert len(store.newest()) == 1


def test_pages_by_state_newest_first(store):
    ids = [submit(store).id for _ in range(5)]
    store.cancel(ids[1])
    assert [job.id for job in store.newest(limit=2)] == [ids[4], ids[3]]
    third = store.get(ids[3])
    assert [job.id for job in store.newest(before=third.number)] == [ids[2], ids[1], ids[0]]
    assert [job.id for job in store.newest(JobState.CANCELLED)] == [ids[1]]
    assert store.census() == {"queued": 4, "running": 0, "succeeded": 0, "failed": 0, "cancelled": 1}


def test_events_are_replayed_from_any_point(store):
    job = submit(store)
    other = submit(store)
    held = store.claim(10)
    store.report_progress(held.id, held.fence, {"step": 1})
    store.settle(held.id, held.fence, JobEvent.SUCCEED)
    events = store.events(0, job.id)
    assert [event.kind for event in events] == ["state", "state", "progress", "state"]
    assert [event.data.get("state") for event in events] == ["queued", "running", None, "succeeded"]
    assert store.events(events[1].id, job.id) == events[2:]
    assert {event.job for event in store.events(0)} == {job.id, other.id}


def test_progress_events_do_not_pile_up(store):
    submit(store)
    job = store.claim(100)
    for step in range(KEPT_EVENTS + 20):
        store.report_progress(job.id, job.fence, {"step": step})
    progress = [event for event in store.events(0, job.id, limit=10**6) if event.kind == "progress"]
    assert len(progress) == KEPT_EVENTS
    assert progress[-1].data["step"] == KEPT_EVENTS + 19


def test_lines_of_a_log_are_events(store):
    submit(store)
    job = store.claim(100)
    store.log(job.id, job.fence, [{"event": "rejected", "step": step} for step in range(KEPT_EVENTS + 5)])
    kept = store.newest_events(job.id, "log", 10**6)
    assert len(kept) == KEPT_EVENTS and kept[-1].data == {"event": "rejected", "step": KEPT_EVENTS + 4}
    assert store.newest_events(job.id, "log", 2) == kept[-2:]


def test_cancelling_twice_is_cancelling_once(store):
    job = submit(store)
    assert store.cancel(job.id).state == JobState.CANCELLED
    before = store.events(0)
    assert store.cancel(job.id).state == JobState.CANCELLED
    assert store.events(0) == before
    assert store.cancel("nothing") is None


def test_a_failed_change_leaves_nothing_behind(store):
    submit(store)
    job = store.claim(10)
    before = store.get(job.id), store.events(0)
    with pytest.raises(ImpossibleEvent):
        store.settle(job.id, job.fence, JobEvent.CLAIM)
    assert (store.get(job.id), store.events(0)) == before
