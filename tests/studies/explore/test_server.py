"""Answers and refusals of the server of a page."""

import gc
import http.client
import json
import socket
import threading
import time
import tracemalloc

import pytest

from lagsim.cli._faults import error_text
from lagsim.outputs.animation.pages import explorer, policy
from lagsim.studies.explore import server as serving
from lagsim.studies.explore.explorer import Explorer
from lagsim.studies.explore.server import HOST, MOST_BYTES, Server
from tests.patience import PATIENCE
from tests.studies.explore.test_explorer import OSCILLATOR, unpacked

OWN = {"Content-Type": "application/json"}


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("explore") / "oscillator.yaml"
    path.write_text(OSCILLATOR)
    return path


@pytest.fixture
def server(file):
    made = Server(Explorer(str(file), {}, {}, error_text))
    answering = threading.Thread(target=made.serve)
    answering.start()
    yield made
    made.over.set()
    answering.join(20 * PATIENCE)
    assert not answering.is_alive()


def asked(server, method, path, body=None, headers=None, secret=None):
    """Return status, headers and body of an answer."""
    line = http.client.HTTPConnection(
        HOST, server.server_address[1], timeout=20 * PATIENCE
    )
    path = f"/{server.secret if secret is None else secret}/{path}"
    content = json.dumps(body).encode() if isinstance(body, dict) else body
    given = (OWN if content is not None else {}) | (headers or {})
    line.request(method, path, content, given)
    answer = line.getresponse()
    found = answer.status, dict(answer.getheaders()), answer.read()
    line.close()
    return found


def lives(server):
    status, _, content = asked(server, "POST", "state", {"values": {}, "t": 1})
    return status == 200 and json.loads(content)["state"]["t"] == 1.0


def test_the_address_is_of_the_loopback_with_a_secret(server):
    assert server.address.startswith(f"http://{HOST}:")
    assert server.socket.getsockname()[0] == "127.0.0.1"
    assert len(server.secret) >= 16


def test_the_page_comes_with_a_policy_for_its_own_script_alone(server):
    status, headers, content = asked(server, "GET", "")
    assert status == 200
    assert headers["Content-Security-Policy"] == policy(content)
    script = headers["Content-Security-Policy"].split("script-src ")[1].split(";")[0]
    assert script.startswith("'sha256-")
    assert "unsafe" not in script
    assert headers["Cache-Control"] == "no-store"
    assert content == explorer("oscillator")


def test_motions_states_drags_and_files(server):
    status, _, content = asked(server, "POST", "motion", {"values": {"k": 2}})
    header, columns = unpacked(content)
    assert status == 200
    assert header["values"]["k"] == 2.0
    assert columns["t"][-1] == 3.0
    _, _, content = asked(server, "POST", "state", {"values": {"k": "1+1"}, "t": 3})
    assert json.loads(content)["state"]["x"] == columns["x"][-1]
    _, headers, content = asked(server, "POST", "file", {"values": {"m": 7}})
    assert headers["Content-Type"].startswith("application/yaml")
    assert b"m: 7 # kilograms" in content
    _, _, content = asked(server, "GET", "equations")
    assert b"<math" in content
    _, _, content = asked(server, "GET", "model")
    assert json.loads(content)["name"] == "oscillator"


def test_faults_of_values_are_texts_of_the_command(server):
    _, _, content = asked(server, "POST", "motion", {"values": {"k": "1/0"}})
    assert "[E221]" in json.loads(content)["error"]
    assert "^" in json.loads(content)["error"]


def other_port(server):
    return server.server_address[1] % 60000 + 1024


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "evil.example"},
        {"Host": "evil.example:{port}"},
        {"Host": "127.0.0.1:{other}"},
        {"Host": "127.0.0.1"},
        {"Origin": "http://evil.example"},
        {"Origin": "http://127.0.0.1:{other}"},
        {"Origin": "https://127.0.0.1:{port}"},
        {"Origin": "null"},
        {"Sec-Fetch-Site": "cross-site"},
    ],
)
def test_another_host_or_origin_is_refused(server, headers):
    known = {"port": server.server_address[1], "other": other_port(server)}
    headers = {name: text.format(**known) for name, text in headers.items()}
    status, _, content = asked(server, "POST", "motion", {"values": {}}, headers)
    assert status in (403, 421)
    assert b"oscillator" not in content
    assert lives(server)


@pytest.mark.parametrize("secret", ["", "x", "x" * 32, "%00", ".."])
def test_a_path_without_the_secret_is_refused(server, secret):
    for method, path in (("GET", ""), ("GET", "model"), ("POST", "motion")):
        status, _, content = asked(server, method, path, secret=secret)
        assert status == 403
        assert b"oscillator" not in content
    assert lives(server)


@pytest.mark.parametrize(
    "path", ["../", "..%2f..%2fetc/passwd", "page.html", "motion/", "%2e%2e/model", "?"]
)
def test_only_known_places_exist(server, path):
    status, _, content = asked(server, "GET", path)
    assert (status, path) in ((404, path), (200, "?"))
    assert b"root:" not in content


@pytest.mark.parametrize(
    ("body", "status"),
    [
        (b"", 400),
        (b"{", 400),
        (b"[" * 60000, 400),
        (b"[1]", 400),
        (b"\xff\xfe", 400),
        (b'{"values": [1]}', 400),
        (b'{"values": {"k": null}}', 400),
        (b'{"values": {"k": {"a": 1}}}', 400),
        (b'{"values": {"k": true}}', 400),
        (b'{"values": {"k": NaN}}', 200),
        (b'{"values": {"k": 1e999}}', 200),
        (b'{"values": {"k": 1' + b"0" * 5000 + b"}}", 200),
        (b'{"values": {"k": "1' + b"0" * 5000 + b'"}}', 200),
        (b'{"values": {"k": "open(1)"}}', 200),
        (b'{"values": {"k": "' + b"(" * 900 + b'"}}', 200),
        (b'{"values": {"": 1}}', 200),
        (b'{"values": {"__class__": 1}}', 200),
        (b'{"values": {"k": -1e400}}', 200),
    ],
)
def test_malformed_and_hostile_bodies(server, body, status):
    found, _, content = asked(server, "POST", "motion", body)
    assert found == status
    if status == 200:
        assert json.loads(content)["error"]
    assert lives(server)


@pytest.mark.parametrize("body", [{"t": "1"}, {"t": None}, {}, {"t": "nan"}])
def test_a_time_is_a_number(server, body):
    assert asked(server, "POST", "state", body)[0] == 400


@pytest.mark.parametrize(
    "target", [None, [], [1], [1, "2"], [1, 2, 3, 4], {"x": 1}, [1e999, 0]]
)
def test_a_target_is_two_or_three_numbers(server, target):
    body = {"values": {}, "t": 0, "point": "p", "target": target}
    assert asked(server, "POST", "drag", body)[0] == 400


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"Content-Length": str(MOST_BYTES + 1)}, 413),
        ({"Content-Length": "10000000"}, 413),
        ({"Content-Length": "9" * 30}, 413),
        ({"Content-Length": "-1"}, 411),
        ({"Content-Length": "1e3"}, 411),
        ({"Content-Length": "2\r\nContent-Length: 3"}, 411),
        ({"Transfer-Encoding": "chunked"}, 411),
        ({"Content-Length": "\u00b2"}, 411),
        ({"Content-Type": "text/plain"}, 415),
        ({"Content-Type": "application/x-www-form-urlencoded"}, 415),
    ],
)
def test_bodies_of_other_kinds_or_sizes_are_refused_unread(server, headers, status):
    with socket.create_connection(server.server_address, timeout=20 * PATIENCE) as line:
        given = {"Host": f"{HOST}:{server.server_address[1]}"} | OWN
        given |= {"Content-Length": "2"} | headers
        lines = [f"POST /{server.secret}/motion HTTP/1.1"]
        lines += [f"{name}: {text}" for name, text in given.items()]
        line.sendall("\r\n".join([*lines, "", ""]).encode("latin-1"))
        answer = line.recv(1 << 16).decode("latin-1")
        assert answer.startswith(f"HTTP/1.1 {status} ")
        # The connection is closed: nothing that follows is taken for a request.
        while new := line.recv(1 << 16):
            answer += new.decode("latin-1")
    assert lives(server)


@pytest.mark.parametrize(
    "content",
    [b"\x16\x03\x01\x02\x00", b"GET\r\n\r\n", b"PUT / HTTP/1.1\r\n\r\n", b"G" * 70000],
)
def test_what_is_no_request_is_answered_by_an_error_without_text(server, content):
    with socket.create_connection(server.server_address, timeout=20 * PATIENCE) as line:
        line.sendall(content)
        line.shutdown(socket.SHUT_WR)
        answer = b""
        try:
            while new := line.recv(1 << 16):
                answer += new
        except ConnectionResetError:
            pass
    assert b"oscillator" not in answer
    assert lives(server)


def sent(server, *pieces, wait=0.0):
    """Return the answer to bytes sent in pieces, and whether all pieces were sent."""
    with socket.create_connection(server.server_address, timeout=20 * PATIENCE) as line:
        answer, whole = b"", False
        try:
            for piece in pieces:
                line.sendall(piece)
                time.sleep(wait)
            whole = True
            line.shutdown(socket.SHUT_WR)
            while new := line.recv(1 << 16):
                answer += new
        except OSError:
            pass
    return answer, whole


def head(server, line, *headers):
    host = f"Host: {HOST}:{server.server_address[1]}"
    lines = (line.replace("SECRET", server.secret), host, *headers, "", "")
    return "\r\n".join(lines).encode("latin-1", "replace")


def test_who_sends_ten_megabytes_is_told_that_it_is_too_much(server):
    given = "Content-Type: application/json", f"Content-Length: {10**7}"
    start = head(server, "POST /SECRET/motion HTTP/1.1", *given)
    answer, _ = sent(server, start, b"1" * 10**7)
    assert answer.startswith(b"HTTP/1.1 413 ")
    assert lives(server)


@pytest.mark.parametrize(
    ("line", "headers", "status"),
    [
        ("GET /SECRET/model HTTP/1.1", [f"X-{k}: y" for k in range(500)], 431),
        ("GET /SECRET/model HTTP/1.1", ["X: " + "y" * 70000], 431),
        ("GET /SECRET/model HTTP/1.1", ["Host: evil.example"], 421),
        ("GET /SECRET/\0model HTTP/1.1", [], 404),
        ("GET /SECRET/../model HTTP/1.1", [], 404),
        ("GET /SECRET/..\\..\\model HTTP/1.1", [], 404),
        ("GET /../SECRET/model HTTP/1.1", [], 403),
        ("GET /\u00e9\u00fc/model HTTP/1.1", [], 403),
        ("GET http://evil.example/SECRET/model HTTP/1.1", [], 403),
        ("OPTIONS /SECRET/motion HTTP/1.1", ["Origin: http://evil.example"], 501),
        ("PUT /SECRET/model HTTP/1.1", [], 501),
    ],
)
def test_odd_requests_are_refused(server, line, headers, status):
    answer, _ = sent(server, head(server, line, *headers))
    assert answer.startswith(f"HTTP/1.1 {status} ".encode())
    assert b"oscillator" not in answer
    assert b"Access-Control" not in answer
    assert lives(server)


@pytest.mark.parametrize(
    "host", ["evil.example", "0.0.0.0", "[::1]", "127.0.0.1.nip.io", "localhost.", ""]
)
def test_a_name_that_was_changed_to_this_machine_is_refused(server, host):
    # DNS rebinding: the browser connects here for a page of another name.
    name = f"{host}:{server.server_address[1]}"
    headers = {"Host": name, "Origin": f"http://{name}"}
    status, _, content = asked(server, "POST", "motion", {"values": {}}, headers)
    assert status == 421
    assert b"oscillator" not in content


def test_who_sends_a_byte_now_and_then_is_cut_off(server, monkeypatch):
    monkeypatch.setattr(serving, "PATIENCE", 0.3)
    start = head(server, "GET /SECRET/model HTTP/1.1")
    pieces = [start[k : k + 1] for k in range(len(start) - 2)]
    assert sent(server, *pieces, wait=0.05) == (b"", False)
    given = "Content-Type: application/json", "Content-Length: 40"
    start = head(server, "POST /SECRET/motion HTTP/1.1", *given)
    assert sent(server, start, *[b" "] * 20, wait=0.05) == (b"", False)


@pytest.mark.parametrize(
    "text", ["\ud800", "\0", "\u202e1", "\uff11", "2\u00b2", "\U0001f642", "1 # c",
             "{a: 1}", "!!python/object/apply:os.system [ls]", "9**9**9", "lambda: 1"]
)  # fmt: skip
def test_text_that_is_no_expression_is_refused_with_a_place(server, text):
    for place in ("motion", "file"):
        status, _, content = asked(server, "POST", place, {"values": {"k": text}})
        assert status == 200
        assert "^" in json.loads(content)["error"]
    for name in (text, "__class__", "simulation.duration"):
        _, _, content = asked(server, "POST", "motion", {"values": {name: 1.5}})
        assert json.loads(content)["error"]


@pytest.mark.parametrize("given", ["Content-Length: 1", "Transfer-Encoding: chunked"])
def test_a_body_that_no_request_reads_is_refused(server, given):
    # It is itself a request, which must not be answered.
    hidden = head(server, "GET /SECRET/model HTTP/1.1")
    answer, _ = sent(server, head(server, "GET /SECRET/model HTTP/1.1", given), hidden)
    assert answer.startswith(b"HTTP/1.1 400 ")
    assert answer.count(b"HTTP/1.1 ") == 1
    assert b"oscillator" not in answer
    assert lives(server)


def test_two_hosts_are_refused(server):
    with socket.create_connection(server.server_address, timeout=20 * PATIENCE) as line:
        host = f"Host: {HOST}:{server.server_address[1]}\r\n"
        line.sendall(
            f"GET /{server.secret}/model HTTP/1.1\r\n{host}{host}\r\n".encode()
        )
        assert line.recv(64).startswith(b"HTTP/1.1 421 ")


def test_a_port_that_is_taken_is_an_error(server):
    with pytest.raises(OSError, match="in use"):
        Server(server.explorer, server.server_address[1])


def test_saved_files_are_told_to_pages_that_listen(server, file):
    line = http.client.HTTPConnection(
        HOST, server.server_address[1], timeout=20 * PATIENCE
    )
    line.request("GET", f"/{server.secret}/news")
    news = line.getresponse()
    assert news.getheader("Content-Type") == "text/event-stream"
    file.write_text(OSCILLATOR.replace("m: 2", "m: 5"))
    while news.readline() != b"data: changed\n":
        pass
    _, _, content = asked(server, "POST", "motion", {"values": {}})
    assert unpacked(content)[0]["values"]["m"] == 5.0
    line.close()
    file.write_text(OSCILLATOR)


def test_it_ends_some_time_after_the_last_page_has_been_closed(file, monkeypatch):
    monkeypatch.setattr(serving, "LINGER", 0.3)
    monkeypatch.setattr(serving, "SIGN", 0.05)
    server = Server(Explorer(str(file), {}, {}, error_text))
    answering = threading.Thread(target=server.serve)
    answering.start()
    time.sleep(0.4)  # before a page has been opened it waits
    pages = []
    for _ in range(2):
        line = socket.create_connection(server.server_address, timeout=20 * PATIENCE)
        host = f"{HOST}:{server.server_address[1]}"
        line.sendall(
            f"GET /{server.secret}/news HTTP/1.1\r\nHost: {host}\r\n\r\n".encode()
        )
        assert line.recv(15) == b"HTTP/1.1 200 OK"
        pages.append(line)
    pages[0].close()
    answering.join(0.5)
    assert answering.is_alive()
    pages[1].close()
    answering.join(0.1)
    assert answering.is_alive()
    answering.join(20 * PATIENCE)
    assert not answering.is_alive()


@pytest.mark.slow
def test_a_thousand_requests_leave_memory_flat(server):
    def ask(count):
        for k in range(count):
            asked(server, "POST", "motion", {"values": {"k": 1 + k % 7}})
        gc.collect()

    ask(50)
    tracemalloc.start()
    ask(100)
    before = tracemalloc.get_traced_memory()[0]
    ask(1000)
    after = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    assert after - before < 1 << 20
