"""The viewer's server answers this computer, with the token, and nobody else."""


import json
import signal
import socket
import subprocess
import sys
import urllib.request

import pytest
from viewing import viewing


@pytest.fixture(scope="module")
def guarded(tmp_path_factory):
    path = tmp_path_factory.mktemp("guard") / "project.toml"
    path.write_text("")
    with viewing(path, run=False) as client:
        yield client


def test_it_listens_on_this_computer_only(guarded):
    assert guarded.server.server_address[0] == "127.0.0.1"
    with pytest.raises(OSError), socket.create_connection(("127.0.0.2", guarded.server.server_port), 2):
        pass


@pytest.mark.parametrize("path", ["/", "/state", "/nothing"])
@pytest.mark.parametrize("token", [None, "", "x", "é", "a" * 5000])
def test_no_token_no_answer(guarded, path, token):
    sent = None if token is None else token.encode("utf-8").decode("latin-1")
    status, content, _ = guarded.raw("GET", path, headers={"X-Windmark-Token": sent})
    assert status == 403
    assert "token" in json.loads(content)["error"]


def test_a_token_is_another_one_each_time(guarded, tmp_path):
    (tmp_path / "p.toml").write_text("")
    with viewing(tmp_path / "p.toml", run=False) as other:
        assert other.server.token != guarded.server.token
        assert len(other.server.token) >= 32
        status, _, _ = other.raw("GET", "/state", headers={"X-Windmark-Token": guarded.server.token})
        assert status == 403


@pytest.mark.parametrize(
    "host", ["example.com", "example.com:{port}", "127.0.0.1", "127.0.0.1:1", "localhost.evil:{port}"]
)
def test_another_name_of_this_computer_is_refused(guarded, host):
    status, content, _ = guarded.raw("GET", "/state", host=host.format(port=guarded.server.server_port))
    assert status == 403
    assert guarded.server.token.encode() not in content


@pytest.mark.parametrize("origin", ["http://example.com", "null", "https://127.0.0.1:{port}", "http://127.0.0.1:1"])
def test_another_page_is_refused_even_with_the_token(guarded, origin):
    origin = origin.format(port=guarded.server.server_port)
    for method, path, body in (("GET", "/state", None), ("POST", "/run", {})):
        status, _, headers = guarded.raw(method, path, body, {"Origin": origin})
        assert status == 403
        assert not [name for name in headers if name.lower().startswith("access-control")]
    assert guarded.state()["busy"] is False


def test_preflights_of_other_pages_are_not_answered(guarded):
    status, _, headers = guarded.raw("OPTIONS", "/run", headers={"Access-Control-Request-Method": "POST"})
    assert status == 501
    assert not [name for name in headers if name.lower().startswith("access-control")]


def test_with_token_and_own_names_it_answers(guarded):
    for host in (f"127.0.0.1:{guarded.server.server_port}", f"localhost:{guarded.server.server_port}"):
        status, _, headers = guarded.raw("GET", "/state", host=host, headers={"Origin": f"http://{host}"})
        assert status == 200
        assert "default-src 'none'" in headers["Content-Security-Policy"]
        assert (headers["Cache-Control"], headers["Referrer-Policy"]) == ("no-store", "no-referrer")
    status, _, _ = guarded.raw("GET", f"/state?token={guarded.server.token}", headers={"X-Windmark-Token": None})
    assert status == 200
    assert guarded.raw("GET", "/nothing")[0] == 404
    assert guarded.raw("GET", "/run")[0] == 404


@pytest.mark.parametrize(("body", "headers", "status"), [
    (b"{", {}, 400), (b"[1]", {}, 400), (b"\xff", {}, 400), (b"[" * 60000, {}, 400),
    (b'{"a": 1}', {"Content-Type": "text/plain"}, 415),
    (b"", {"Content-Length": "70000"}, 413), (b"", {"Content-Length": "-1"}, 411),
    (b"", {"Content-Length": "1" * 30}, 413),
])  # fmt: skip
def test_requests_that_are_none_are_refused(guarded, body, headers, status):
    assert guarded.raw("POST", "/run", body, headers)[0] == status


def test_before_a_run_nothing_can_be_asked_or_changed(guarded):
    for path in ("/name", "/exclude", "/free", "/grid", "/explain", "/export"):
        status, said = guarded.ask(path, image="a", spot=0)
        assert status == 422
        assert "reload" in said["error"]


def test_a_port_that_is_taken_is_said(guarded, windmark, virtual_test):
    done = windmark("view", virtual_test[0] / "project.toml", "--no-browser", "--port", guarded.server.server_port)
    assert done.code == 2
    assert f"--port {guarded.server.server_port}" in done.err


def test_another_verbs_project_is_refused_before_anything_is_served(windmark, tmp_path):
    (tmp_path / "p.toml").write_text('title = "t"\n')
    done = windmark("view", tmp_path / "p.toml", "--no-browser")
    assert done.code == 2
    assert "length_unit" in done.err


@pytest.mark.slow
def test_ctrl_c_ends_it_cleanly_with_a_job_at_work(virtual_test):
    words = [sys.executable, "-m", "windmark.app.cli", "view", str(virtual_test[0] / "project.toml"), "--no-browser"]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        address = process.stdout.readline().split()[-1]
        with urllib.request.urlopen(address) as answer:
            assert b"wm-view-data" in answer.read()
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=300)
    finally:
        process.kill()
        process.wait()
    assert process.returncode == 0, err
    assert "Traceback" not in err
    assert "the viewer ends" in err
    assert not (virtual_test[0] / "results").exists()
