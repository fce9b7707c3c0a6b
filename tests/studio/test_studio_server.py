"""How the studio is started, and what is said where it cannot be."""

from __future__ import annotations

import socket
from urllib.request import Request, urlopen

import pytest

from flexid.studio import server


def test_without_the_package(flexid, monkeypatch: pytest.MonkeyPatch):
    """Assert that the sentence names the extra."""
    monkeypatch.setattr(server, "find_spec", lambda _: None)
    outcome = flexid("studio", "--no-browser")
    assert outcome.status == 2
    assert "pip install 'flexid[studio]'" in outcome.stderr


def test_a_port_that_is_taken(flexid):
    """Assert that another port is asked for."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        outcome = flexid("studio", "--no-browser", "--port", port)
    assert outcome.status == 2
    assert f"port {port}" in outcome.stderr
    assert "--port" in outcome.stderr


def test_off_the_loopback_the_address_has_a_token(start):
    """Assert that a studio on the network lets nobody in without what it printed."""
    with start("--host", "0.0.0.0") as address:
        port = address.split(":")[2].split("/")[0]
        token = address.partition("token=")[2]
        assert len(token) >= 32
        here = f"http://127.0.0.1:{port}/"
        with pytest.raises(OSError, match="403"):
            urlopen(here, timeout=10)
        with urlopen(
            Request(here, headers={"Cookie": f"flexid_studio={token}"}), timeout=10
        ) as page:
            assert b"flexid studio" in page.read()
