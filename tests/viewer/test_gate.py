import pytest
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from viewer.gate import COOKIE, Gate, asked_job, guarding

HERE = "127.0.0.1:8081"


def ask(path: str = "/", gate: Gate | None = None, **headers: str) -> Response | Request:
    return (gate or Gate()).check(Request(path, Headers({"Host": HERE, **headers})))


def test_own_pages_pass():
    assert isinstance(ask(), Request)
    assert isinstance(ask(Origin=f"http://{HERE}"), Request)
    assert isinstance(ask(Host="localhost:9"), Request)


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example", ""])
def test_other_hosts_are_refused(host):
    assert ask(Host=host).status_code == 421


@pytest.mark.parametrize("origin", ["http://evil.example", "http://127.0.0.1:9999", "null"])
def test_other_origins_are_refused(origin):
    assert ask(Origin=origin).status_code == 403


def test_a_job_is_asked_for_by_query_and_kept_in_the_path():
    answer = ask("/?job=a%2Fb")
    assert (answer.status_code, answer.headers["Location"]) == (302, "/job/a%2Fb")
    served = ask("/job/a%2Fb")
    assert isinstance(served, Request) and served.path == "/" and asked_job.get() == "a/b"


def test_a_token_is_asked_for_once_and_kept_in_a_cookie():
    gate = Gate(hosts=None, token="s3cret é")
    assert ask(gate=gate).status_code == 403
    assert ask("/?token=wrong", gate=gate).status_code == 403
    answer = ask("/?token=s3cret%20%C3%A9&job=x", gate=gate)
    assert (answer.status_code, answer.headers["Location"]) == (302, "/job/x")
    cookie = answer.headers["Set-Cookie"]
    assert "HttpOnly" in cookie and "SameSite=Strict" in cookie
    assert isinstance(ask("/job/x", gate=gate, Cookie=cookie.split(";")[0]), Request)
    assert ask("/", gate=gate, Cookie=f"{COOKIE}=other").status_code == 403


def test_a_server_that_does_not_pass_the_gate_is_refused():
    with pytest.raises(RuntimeError, match="unguarded"), guarding(Gate()):
        pass
