import httpx
import pytest

from service.server import CannotServe, Service, ServiceConfig
from tests.service.conftest import COUNTING_WORKER, serving


@pytest.mark.parametrize("host", ["evil.example", "evil.example:8765", "127.0.0.1.evil.example", "", "[", "0.0.0.0"])
def test_a_foreign_host_is_refused(http, host):
    answer = http.get("/v1/jobs", headers={"Host": host})
    assert answer.status_code in (400, 421)
    if answer.status_code == 421:
        assert answer.json()["allowed"]


@pytest.mark.parametrize("host", ["localhost", "localhost:1", "127.0.0.1", "[::1]:80"])
def test_this_machines_names_are_fine(http, host):
    assert http.get("/v1/jobs", headers={"Host": host}).is_success


def test_a_page_from_elsewhere_changes_nothing(http, service):
    for origin in ("https://evil.example", "null", "http://127.0.0.1:1"):
        answer = http.post("/v1/jobs", content=b"{}", headers={"Origin": origin, "Content-Type": "text/plain"})
        assert answer.status_code == 403
    assert http.post("/v1/jobs", content=b"{}", headers={"Origin": service.url}).status_code == 422


def test_answers_carry_a_policy(http):
    headers = http.get("/").headers
    assert "connect-src 'self'" in headers["content-security-policy"]
    assert headers["x-content-type-options"] == "nosniff"


def test_another_address_needs_a_token(tmp_path):
    with pytest.raises(CannotServe, match="STRANDLINE_TOKEN"):
        Service(ServiceConfig(tmp_path, host="0.0.0.0", port=0))


@pytest.fixture(scope="module")
def open_service(tmp_path_factory):
    yield from serving(tmp_path_factory.mktemp("open"), host="0.0.0.0", token="secret", viewer=False,
                       worker_command=COUNTING_WORKER)


def test_the_token_opens_and_nothing_else(open_service):
    with httpx.Client(base_url=open_service.url, trust_env=False) as http:
        assert http.get("/healthz").is_success
        for headers in ({}, {"Authorization": "Bearer wrong"}, {"Authorization": "secret2"}, {"Cookie": "a=b"}):
            for path in ("/", "/v1/jobs", "/metrics", "/openapi.json", "/recording/index.html"):
                answer = http.get(path, headers=headers)
                assert answer.status_code == 401 and answer.headers["www-authenticate"] == "Bearer"
        assert http.get("/v1/jobs", headers={"Authorization": "Bearer secret"}).is_success
        assert http.get("/?token=wrong").status_code == 401


def test_the_link_with_the_token_is_kept_in_a_cookie(open_service):
    with httpx.Client(base_url=open_service.url, trust_env=False) as http:
        answer = http.get("/?token=secret")
        assert answer.status_code == 303 and answer.headers["location"] == "/"
        assert "HttpOnly" in answer.headers["set-cookie"] and "samesite=strict" in answer.headers["set-cookie"].lower()
        assert http.get("/").is_success
