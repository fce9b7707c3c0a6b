"""Who is let in."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from flexid.studio.guard import COOKIE, Guard, is_loopback

HERE = "127.0.0.1:8765"
TOKEN = "a-long-secret"
Headers = dict[str, str]


def answer(
    headers: Headers,
    *,
    host: str = "127.0.0.1",
    token: str = "",
    path: str = "/",
    query: str = "",
    method: str = "GET",
    kind: str = "http",
) -> tuple[int, Headers]:
    """Status and headers of what a guard answers; 200 is what it guards, 1008 a closed socket."""
    sent: list[Any] = []

    async def app(_scope: Any, _receive: Any, send: Any) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": []})

    async def receive() -> dict[str, str]:
        return {"type": "websocket.connect"}

    async def send(message: Any) -> None:
        sent.append(message)

    scope = {
        "type": kind,
        "method": method,
        "path": path,
        "query_string": query.encode(),
        "headers": [(name.lower().encode(), value.encode()) for name, value in headers.items()],
    }
    guard = Guard(app, host, token)
    asyncio.run(guard(scope, receive, send))
    if sent[0]["type"] == "websocket.close":
        return sent[0]["code"], {}
    found = {name.decode(): value.decode() for name, value in sent[0]["headers"]}
    return sent[0]["status"], found


@pytest.mark.parametrize(
    ("host", "status"),
    [
        *((name, 200) for name in (HERE, "localhost:8765", "[::1]:8765")),
        *((name, 403) for name in ("evil.example", "127.0.0.1.evil.example", "", "[", "10.1.1.1")),
        ("localhost.evil.example", 403),
    ],
)
def test_the_loopback_is_let_in_by_its_names_alone(host: str, status: int):
    """Assert that a name that somebody else lets resolve to the loopback does not serve."""
    assert answer({"Host": host})[0] == status


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:9000"])
@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_another_page_is_refused(origin: str, kind: str):
    """Assert that no page of another origin can ask, be it by a socket."""
    status, _ = answer({"Host": HERE, "Origin": origin}, kind=kind)
    assert status == (403 if kind == "http" else 1008)


def test_who_acts_says_where_from():
    """Assert that a request that changes something, or opens a socket, has an origin: ours."""
    assert answer({"Host": HERE}, method="POST")[0] == 403
    assert answer({"Host": HERE}, kind="websocket")[0] == 1008
    ours = {"Host": HERE, "Origin": f"http://{HERE}"}
    assert answer(ours, method="POST")[0] == 200
    assert answer(ours, kind="websocket")[0] == 200


def test_the_token_is_asked_for():
    """Assert that nobody gets in without it, nor with a part of it."""
    for query in ("", "token=", "token=a-long", f"token={TOKEN}x", "token=%ff"):
        assert answer({"Host": HERE}, token=TOKEN, query=query)[0] == 403
    for cookie in ("", f"{COOKIE}=wrong", f"other={TOKEN}", "="):
        assert answer({"Host": HERE, "Cookie": cookie}, token=TOKEN)[0] == 403
    ours = {"Host": HERE, "Origin": f"http://{HERE}"}
    query = f"token={TOKEN}"
    assert answer(ours, token=TOKEN, kind="websocket", query=query)[0] == 1008


def test_the_token_becomes_a_cookie():
    """Assert that the token leaves the address, and that scripts cannot read the cookie."""
    status, headers = answer({"Host": HERE}, token=TOKEN, query=f"hold=zero&token={TOKEN}")
    assert status == 303
    assert headers["location"] == "/?hold=zero"
    cookie = headers["set-cookie"].lower()
    assert "httponly" in cookie
    assert "samesite=lax" in cookie
    let_in = {"Host": HERE, "Cookie": f"{COOKIE}={TOKEN}", "Origin": f"http://{HERE}"}
    assert answer(let_in, token=TOKEN)[0] == 200
    assert answer(let_in, token=TOKEN, kind="websocket")[0] == 200


def test_off_the_loopback_a_number_serves():
    """Assert that a studio on the network is reached by its number, and by no foreign name."""
    let_in = {"Cookie": f"{COOKIE}={TOKEN}"}
    assert answer({"Host": "10.1.1.1:8765", **let_in}, host="0.0.0.0", token=TOKEN)[0] == 200
    assert answer({"Host": "evil.example", **let_in}, host="0.0.0.0", token=TOKEN)[0] == 403


def test_answers_keep_the_browser_in():
    """Assert that a page runs the scripts of the studio alone, and stands in no frame."""
    policy = answer({"Host": HERE})[1]["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "script-src 'self'; style-src 'self';" in policy
    assert "frame-ancestors 'none'" in policy


def test_what_the_loopback_is():
    """Assert that only addresses of this machine count as such."""
    names = ("127.0.0.1", "localhost", "::1", "0.0.0.0", "localhost.example")
    assert [name for name in names if is_loopback(name)] == [*names[:3]]
