"""The server listens on this machine alone, answers to its own name alone, and keeps work apart."""

import http.client
import os
import socket
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

from accelcal.app.server import HOST, free_port
from tests.hostile.workbench import port_of_worker

pytest.importorskip("nicegui")


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    """Run the workbench as a user would; return its port and process."""
    with served(tmp_path_factory) as result:
        yield result


@contextmanager
def served(tmp_path_factory):
    """A workbench while it runs: its port and process."""
    port = port_of_worker()
    passed = {name: value for name, value in os.environ.items() if not name.startswith(("PYTEST", "NICEGUI"))}
    process = subprocess.Popen(
        [sys.executable, "-m", "accelcal", "app", "--no-browser", "--port", str(port)],
        cwd=tmp_path_factory.mktemp("server"),
        env={**passed, "ACCELCAL_STATE": str(tmp_path_factory.mktemp("state"))},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    for _ in range(1200):  # a loaded machine takes its time
        with socket.socket() as probe:
            if probe.connect_ex((HOST, port)) == 0:
                break
        assert process.poll() is None, "the workbench ended while it was starting"
        time.sleep(0.25)
    try:
        yield port, process
    finally:
        process.terminate()
        process.wait(120)


def asked(port, path="/", host=None):
    """Answer to one request: status, headers, text."""
    connection = http.client.HTTPConnection(HOST, port, timeout=20)
    connection.request("GET", path, headers={} if host is None else {"Host": host})
    answer = connection.getresponse()
    return answer.status, dict(answer.getheaders()), answer.read().decode(errors="replace")


def test_only_loopback_listens(server):
    port, _ = server
    results = []
    for table in ("/proc/net/tcp", "/proc/net/tcp6"):
        rows = [line.split() for line in Path(table).read_text().splitlines()[1:]]
        results += [row[1] for row in rows if row[3] == "0A" and int(row[1].rpartition(":")[2], 16) == port]
    assert results == [f"0100007F:{port:04X}"]  # 127.0.0.1, as the kernel writes it; 0.0.0.0 would be 00000000


def test_an_unknown_session_has_expired(server):
    status, _, text = asked(server[0], "/bench/nobody")
    assert status == 200
    assert "This session has expired" in text


def test_a_foreign_name_is_refused(server):
    assert asked(server[0], host="evil.example")[0] == 400
    assert asked(server[0], host=f"127.0.0.1:{server[0]}")[0] == 200


@pytest.mark.parametrize("path", ["/../../etc/passwd", "/bench/../../../etc/passwd", "/_nicegui/../../../etc/passwd"])
def test_no_path_leads_out(server, path):
    assert "root:" not in asked(server[0], path)[2]


def test_an_occupied_port_is_skipped():
    with socket.socket() as occupied:
        occupied.bind((HOST, 0))
        port = occupied.getsockname()[1]
        assert free_port(port) != port
