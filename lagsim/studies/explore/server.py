"""HTTP server of an explorer on the loopback of this machine, for one page.

`http.server` of the standard library suffices: one page makes a few small requests a
second, and a server with fewer parts has fewer faults. A request is answered only if
its path begins with the secret of this server, its Host is this server, and its Origin,
if any, is this server: another site that the browser shows can neither guess the secret
nor send a request that passes as one of the page. Bodies are small, JSON, and contain
numbers and expressions alone, which are parsed as `--set` parses them.
"""

from __future__ import annotations

import hmac
import io
import json
import math
import secrets
import socket
import threading
import time
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import TYPE_CHECKING, Any

from lagsim.errors import LagsimError
from lagsim.outputs.animation.pages import explorer, policy
from lagsim.outputs.manifest import encode
from lagsim.studies.explore.explorer import SupersededError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from lagsim.studies.explore.explorer import Explorer

HOST = "127.0.0.1"
# Bytes of a request's body, bytes of random secret, seconds for a request to arrive,
# open connections.
MOST_BYTES, SECRET_BYTES, PATIENCE, MOST_CONNECTIONS = 1 << 16, 24, 20.0, 64
# Bytes and seconds of a refused request that are read, so that its sender, who may
# still be sending, receives the answer.
MOST_IGNORED, LINGERING = 1 << 26, 2.0
# Intervals in s between checks of the file, and between keep-alive messages to pages;
# time from the close of the last page to the end of the server.
LOOK, SIGN, LINGER = 0.25, 1.0, 60.0
JSON, HTML, BYTES = (
    "application/json",
    "text/html; charset=utf-8",
    "application/octet-stream",
)
YAML, STREAM = "application/yaml; charset=utf-8", "text/event-stream"
# The name of a page in its requests.
MOST_LETTERS = 64


class RefusedError(Exception):
    """Signal that a request is refused, with the HTTP status of the answer."""

    def __init__(self, status: HTTPStatus) -> None:
        super().__init__(status.phrase)
        self.status = status


def require(status: HTTPStatus, *, unless: bool) -> None:
    """Raise RefusedError with an HTTP status, unless the condition `unless` is true."""
    if not unless:
        raise RefusedError(status)


class Server(ThreadingHTTPServer):
    """Server of one explorer's page.

    Parameters
    ----------
    explorer : Explorer
    port : int
        Number of the port; 0 for a free port.

    Attributes
    ----------
    secret : str
        Random text that every path begins with.

    Raises
    ------
    OSError
        If the port is taken.
    """

    daemon_threads = True
    # A port that another program listens on is refused, also where the system would
    # allow two listeners.
    allow_reuse_address = False

    def __init__(self, explorer: Explorer, port: int = 0) -> None:
        self.explorer, self.secret = explorer, secrets.token_urlsafe(SECRET_BYTES)
        self._pages, self._closed = 0, math.inf
        self._seats = threading.BoundedSemaphore(MOST_CONNECTIONS)
        self._changed = threading.Condition()
        self._news = 0
        self.over = threading.Event()
        super().__init__((HOST, port), Handler)

    @property
    def address(self) -> str:
        """The address of the page, with its secret."""
        return f"http://{HOST}:{self.server_address[1]}/{self.secret}/"

    def serve(self) -> None:
        """Answer requests until `end`, or a minute after the last page was closed."""
        answering = threading.Thread(
            target=self.serve_forever, args=(LOOK,), daemon=True
        )
        answering.start()
        try:
            while not self.over.wait(LOOK):
                if self.explorer.changed():
                    self._notify()
                if time.monotonic() > self._closed + LINGER:
                    break
        finally:
            self.end()

    def end(self) -> None:
        """End `serve`, and close all connections."""
        self.over.set()
        self._notify()
        self.shutdown()
        self.server_close()

    def process_request(self, request: Any, client_address: Any) -> None:
        """Answer a connection in a thread; close it if too many are open."""
        if not self._seats.acquire(blocking=False):
            self.shutdown_request(request)
            return
        super().process_request(request, client_address)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Answer the requests of a connection."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._seats.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore a connection that broke; report other exceptions."""
        import sys

        if not isinstance(sys.exc_info()[1], OSError):
            super().handle_error(request, client_address)

    # --- Pages that wait for events of the server

    def _notify(self) -> None:
        with self._changed:
            self._news += 1
            self._changed.notify_all()

    def opened(self) -> None:
        """Count a page that has begun to receive events."""
        with self._changed:
            self._pages += 1
            self._closed = math.inf

    def closed(self) -> None:
        """Count a page that receives no more events."""
        with self._changed:
            self._pages -= 1
            if not self._pages:
                self._closed = time.monotonic()

    def wait(self, known: int) -> int:
        """Wait for a change of the model file; return the number of the last change.

        The wait ends after SIGN seconds at the latest; the result is then `known`.

        known : the number of the last change that the page knows.
        """
        with self._changed:
            if self._news == known:
                self._changed.wait(SIGN)
            return self._news


class _Reader(io.RawIOBase):
    """Stream of the bytes that arrive on a connection until a given time.

    The timeout of a socket begins again with each byte, so that a client that sends
    single bytes slowly would hold the connection without end.

    Parameters
    ----------
    connection : socket

    Attributes
    ----------
    until : float
        Time, by the monotonic clock, after which reading raises TimeoutError.
    """

    def __init__(self, connection: socket.socket) -> None:
        self._connection, self.until = connection, math.inf

    def readable(self) -> bool:
        """Return True: the stream can be read."""
        return True

    def readinto(self, room: Any) -> int:
        """Read bytes of the connection into the buffer `room`; return their number."""
        left = self.until - time.monotonic()
        if left <= 0.0:
            raise TimeoutError
        self._connection.settimeout(left)
        try:
            return self._connection.recv_into(room)
        finally:
            self._connection.settimeout(PATIENCE)


class Handler(BaseHTTPRequestHandler):
    """Handler of the requests of a page on one connection."""

    protocol_version = "HTTP/1.1"
    server_version, sys_version = "lagsim", ""
    timeout = PATIENCE
    server: Server

    def setup(self) -> None:
        """Begin a connection: set its time limits."""
        super().setup()
        self._reader = _Reader(self.connection)
        self.rfile = io.BufferedReader(self._reader)

    def handle_one_request(self) -> None:
        """Answer a request, which must arrive within PATIENCE seconds."""
        self._reader.until = time.monotonic() + PATIENCE
        super().handle_one_request()

    def do_GET(self) -> None:
        """Answer a request for the page, its news or the equations."""
        self._answer({"": self._page, "news": self._listen, "model": self._model,
                      "equations": self._equations})  # fmt: skip

    def do_POST(self) -> None:
        """Answer a request for a motion, a state, a drag or a file."""
        self._answer({"motion": self._motion, "state": self._state,
                      "drag": self._drag, "start": self._start,
                      "file": self._file})  # fmt: skip

    def _answer(self, routes: Mapping[str, Callable[[], None]]) -> None:
        try:
            self._check()
            secret, _, place = self.path.removeprefix("/").partition("/")
            expected = self.server.secret.encode()
            known = hmac.compare_digest(secret.encode("utf-8", "replace"), expected)
            require(HTTPStatus.FORBIDDEN, unless=known)
            route = routes.get(place.partition("?")[0])
            require(HTTPStatus.NOT_FOUND, unless=route is not None)
            assert route is not None
            route()
        except RefusedError as refused:
            # A body, if there is one, was not read: the connection cannot be continued.
            self.close_connection = True
            self._send(refused.status.phrase.encode(), "text/plain", refused.status)
            self._ignore()
        except SupersededError:
            self._send_json({"superseded": True})
        except LagsimError as error:
            self._send_json({"error": self.server.explorer.error_text(error)})

    def _check(self) -> None:
        """Refuse a request that names another host or comes from another origin."""
        port = self.server.server_address[1]
        hosts = {f"{name}:{port}" for name in (HOST, "localhost")}
        if self.headers.get_all("Host", []) not in [[host] for host in hosts]:
            raise RefusedError(HTTPStatus.MISDIRECTED_REQUEST)
        origins = self.headers.get_all("Origin", [])
        if any(
            origin not in {f"http://{host}" for host in hosts} for origin in origins
        ):
            raise RefusedError(HTTPStatus.FORBIDDEN)
        site = self.headers.get("Sec-Fetch-Site", "same-origin")
        if self.command == "POST" and site != "same-origin":
            raise RefusedError(HTTPStatus.FORBIDDEN)
        # An unread body would count as the next request on the connection.
        lengths = self.headers.get_all("Content-Length", ["0"])
        bodiless = lengths == ["0"] and "Transfer-Encoding" not in self.headers
        require(HTTPStatus.BAD_REQUEST, unless=self.command == "POST" or bodiless)

    # --- Requests

    def _body(self) -> dict[str, Any]:
        """Return the JSON object of a request.

        Raises
        ------
        RefusedError
            If the request has no JSON object, or too large a one.
        """
        # Two lengths, or a length and pieces, could hide a second request in a body.
        lengths = self.headers.get_all("Content-Length", [])
        if "Transfer-Encoding" in self.headers or len(lengths) != 1:
            raise RefusedError(HTTPStatus.LENGTH_REQUIRED)
        [length] = lengths
        if not (length.isascii() and length.isdigit()):
            raise RefusedError(HTTPStatus.LENGTH_REQUIRED)
        if len(length) > 12 or int(length) > MOST_BYTES:
            raise RefusedError(HTTPStatus.REQUEST_ENTITY_TOO_LARGE)
        if self.headers.get_content_type() != JSON:
            raise RefusedError(HTTPStatus.UNSUPPORTED_MEDIA_TYPE)
        content = self.rfile.read(int(length))
        try:
            # A whole number of a thousand digits is inf.
            found = json.loads(content, parse_int=float)
        except (ValueError, RecursionError):
            raise RefusedError(HTTPStatus.BAD_REQUEST) from None
        if not isinstance(found, dict):
            raise RefusedError(HTTPStatus.BAD_REQUEST)
        return found

    def _requested(self) -> tuple[dict[str, Any], dict[str, float | str]]:
        """Return the JSON object of a request, and its numbers and texts `values`."""
        found = self._body()
        values = found.get("values", {})
        if not (isinstance(values, dict) and all(map(_is_value, values.values()))):
            raise RefusedError(HTTPStatus.BAD_REQUEST)
        return found, values

    # --- Answers

    def _page(self) -> None:
        content = explorer(self.server.explorer.model.name)
        self._send(content, HTML, more={"Content-Security-Policy": policy(content)})

    def _model(self) -> None:
        self._send_json(self.server.explorer.document)

    def _equations(self) -> None:
        self._send_json({"mathml": self.server.explorer.equations()})

    def _motion(self) -> None:
        found, values = self._requested()
        page, follow = _page_of(found), found.get("follow") is True
        content = self.server.explorer.motion(values, page, follow=follow)
        self._send(content, BYTES)

    def _state(self) -> None:
        found, values = self._requested()
        t = _number(found.get("t"))
        state = self.server.explorer.state(values, t, _page_of(found))
        self._send_json({"state": state})

    def _drag(self) -> None:
        found, values = self._requested()
        target = found.get("target")
        if not isinstance(target, list) or len(target) not in (2, 3):
            raise RefusedError(HTTPStatus.BAD_REQUEST)
        start = self.server.explorer.drag(
            values, _number(found.get("t")), str(found.get("point")),
            [_number(x) for x in target], _page_of(found),
        )  # fmt: skip
        self._send_json({"start": start})

    def _start(self) -> None:
        found, values = self._requested()
        name, value = str(found.get("name")), _number(found.get("value"))
        self._send_json({"start": self.server.explorer.start(values, name, value)})

    def _file(self) -> None:
        _, values = self._requested()
        self._send(self.server.explorer.text(values).encode(), YAML)

    def _listen(self) -> None:
        """Send news of the file as server-sent events, until the page is closed."""
        self.close_connection = True
        self.send_response(HTTPStatus.OK)
        self._send_headers({"Content-Type": STREAM, "Connection": "close"})
        server, known = self.server, 0
        server.opened()
        try:
            with suppress(OSError):
                known = server.wait(-1)
                while not server.over.is_set():
                    news = server.wait(known)
                    line = b"data: changed\n\n" if news != known else b": here\n\n"
                    known = news
                    self.wfile.write(line)
                    self.wfile.flush()
                    if _has_closed(self.connection):
                        break
        finally:
            server.closed()

    def _ignore(self) -> None:
        """Read the rest of a refused request, up to a limit of bytes and time."""
        end, count = time.monotonic() + LINGERING, 0
        with suppress(OSError):
            self.connection.shutdown(socket.SHUT_WR)
            while count < MOST_IGNORED and (left := end - time.monotonic()) > 0.0:
                self.connection.settimeout(left)
                new = len(self.connection.recv(MOST_BYTES))
                if not new:
                    break
                count += new

    def _send_json(self, document: dict[str, Any]) -> None:
        self._send(encode(document), JSON)

    def _send(
        self,
        content: bytes,
        kind: str,
        status: HTTPStatus = HTTPStatus.OK,
        more: Mapping[str, str] | None = None,
    ) -> None:
        headers = {"Content-Type": kind, "Content-Length": str(len(content))}
        if self.close_connection:
            headers["Connection"] = "close"
        with suppress(OSError):
            self.send_response(status)
            self._send_headers(headers | (dict(more) if more else {}))
            self.wfile.write(content)

    def _send_headers(self, headers: Mapping[str, str]) -> None:
        fixed = {
            "Cache-Control": "no-store", "X-Content-Type-Options": "nosniff",
            "Referrer-Policy": "no-referrer", "X-Frame-Options": "DENY",
            "Cross-Origin-Resource-Policy": "same-origin",
        }  # fmt: skip
        for name, text in (fixed | dict(headers)).items():
            self.send_header(name, text)
        self.end_headers()

    def send_error(self, code: int, *_: Any) -> None:
        """Answer a malformed request with the status `code` and an empty body.

        No text of the request is returned. The connection is closed.
        """
        self.close_connection = True
        self._send(b"", "text/plain", HTTPStatus(code))

    def log_message(self, *_: object) -> None:
        """Discard messages of the server: the terminal shows the address alone."""


def _page_of(found: Mapping[str, Any]) -> str:
    return str(found.get("page", ""))[:MOST_LETTERS]


def _is_value(value: object) -> bool:
    return isinstance(value, (float, str))


def _number(value: object) -> float:
    """Return a number of a request; refuse other values, inf and nan."""
    if not isinstance(value, float) or not math.isfinite(value):
        raise RefusedError(HTTPStatus.BAD_REQUEST)
    return value


def _has_closed(connection: socket.socket) -> bool:
    """Whether the other end of a connection has closed it."""
    connection.settimeout(0.0)
    try:
        return not connection.recv(1, socket.MSG_PEEK)
    except OSError as error:
        return not isinstance(error, (BlockingIOError, InterruptedError))
    finally:
        connection.settimeout(PATIENCE)
