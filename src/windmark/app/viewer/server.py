"""The viewer's server: this computer only, and only who has the token.

Other pages that are open in the browser can send requests to a local port, too, and a name that leads to 127.0.0.1
("DNS rebinding") lets them read the answers. So every request must carry a random token and our own Host, and no answer
allows another origin anything.
"""

from __future__ import annotations

import hmac
import json
import secrets
import sys
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

from windmark.errors import WindmarkError
from windmark.io import reason, to_json

HOST = "127.0.0.1"
TOKEN_HEADER = "X-Windmark-Token"
MOST_BYTES = 65_536
"""Of a request."""
PATIENCE_S = 30.0
"""So long a connection may say nothing."""
HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:; "
        "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",  # the token is in the page's address
    "X-Content-Type-Options": "nosniff",
}


@dataclass(frozen=True)
class Answer:
    """What is sent back: the content and its type."""

    content: bytes
    kind: str = "application/json"
    status: HTTPStatus = HTTPStatus.OK

    @staticmethod
    def of(record: Mapping[str, Any], status: HTTPStatus = HTTPStatus.OK) -> Answer:
        """A record as JSON."""
        return Answer(to_json(record).encode(), status=status)


Routes = Mapping[tuple[str, str], Callable[[dict[str, Any]], Answer]]
"""("GET", "/state") -> what answers, called with what the request says."""


class Server(ThreadingHTTPServer):
    """Listens on 127.0.0.1; ``port`` 0 takes a free one."""

    daemon_threads = True
    allow_reuse_address = False  # on Windows two programs could have one port

    def __init__(self, routes: Routes, port: int = 0) -> None:
        self.routes = routes
        self.token = secrets.token_urlsafe(24)
        super().__init__((HOST, port), Handler)

    @property
    def address(self) -> str:
        """Of the page, with the token."""
        return f"http://{HOST}:{self.server_port}/?token={self.token}"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A browser that closes its page breaks off; all else is a fault and says so."""
        if not isinstance(sys.exc_info()[1], ConnectionError | TimeoutError):
            super().handle_error(request, client_address)


class Handler(BaseHTTPRequestHandler):
    """One connection."""

    server: Server
    server_version, sys_version = "windmark", ""
    timeout = PATIENCE_S

    def do_GET(self) -> None:
        """Pages and states."""
        self._handle("GET")

    def do_POST(self) -> None:
        """What changes something, or asks with numbers: JSON."""
        self._handle("POST")

    def log_message(self, format: str, *args: Any) -> None:
        """Nothing: the terminal is for what matters."""

    def _handle(self, method: str) -> None:
        url = urlsplit(self.path)
        if (refused := self._refused(parse_qs(url.query))) is not None:
            self._send(refused)
            return
        route = self.server.routes.get((method, url.path))
        if route is None:
            self._send(_refusal(HTTPStatus.NOT_FOUND, "there is nothing here"))
            return
        said: dict[str, Any] | Answer = {} if method == "GET" else self._said()
        self._send(said if isinstance(said, Answer) else _answered(route, said))

    def _refused(self, query: Mapping[str, list[str]]) -> Answer | None:
        """Why this request is not answered; None where it is."""
        ours = {f"{name}:{self.server.server_port}" for name in (HOST, "localhost")}
        if self.headers.get("Host", "").lower() not in ours:
            return _refusal(HTTPStatus.FORBIDDEN, "this page is for this computer only")
        origin = self.headers.get("Origin")
        if origin is not None and origin.lower() not in {f"http://{host}" for host in ours}:
            return _refusal(HTTPStatus.FORBIDDEN, "this page answers no other page")
        given = self.headers.get(TOKEN_HEADER) or query.get("token", [""])[0]
        if not hmac.compare_digest(given.encode("utf-8", "replace"), self.server.token.encode()):
            return _refusal(HTTPStatus.FORBIDDEN, "the token is missing or wrong; open the address that windmark view "
                            "printed")  # fmt: skip
        return None

    def _said(self) -> dict[str, Any] | Answer:
        """The JSON of a request."""
        if self.headers.get_content_type() != "application/json":
            return _refusal(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "expected JSON")
        length = self.headers.get("Content-Length", "")
        if not (length.isascii() and length.isdigit()):
            return _refusal(HTTPStatus.LENGTH_REQUIRED, "expected a Content-Length")
        if int(length[:12]) > MOST_BYTES:
            return _refusal(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"expected at most {MOST_BYTES} bytes")
        try:
            said = json.loads(self.rfile.read(int(length)))
        except (ValueError, RecursionError):
            return _refusal(HTTPStatus.BAD_REQUEST, "this is no JSON")
        return said if isinstance(said, dict) else _refusal(HTTPStatus.BAD_REQUEST, "expected a JSON object")

    def _send(self, answer: Answer) -> None:
        self.close_connection = True  # what a refused request still has to say is not read
        self.send_response(answer.status)
        for name, value in {**HEADERS, "Content-Type": answer.kind, "Content-Length": str(len(answer.content))}.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(answer.content)


def _refusal(status: HTTPStatus, words: str) -> Answer:
    return Answer.of({"error": words}, status)


def _answered(route: Callable[[dict[str, Any]], Answer], said: dict[str, Any]) -> Answer:
    """The answer of a route; what went wrong, in words, as the command line says it."""
    try:
        return route(said)
    except WindmarkError as error:
        return _refusal(HTTPStatus.UNPROCESSABLE_ENTITY, str(error))
    except OSError as error:
        of = "" if error.filename is None else f"{error.filename}: "
        return _refusal(HTTPStatus.UNPROCESSABLE_ENTITY, f"{of}{reason(error)}")
    except MemoryError:
        return _refusal(HTTPStatus.UNPROCESSABLE_ENTITY, "not enough memory for this")
    except Exception as error:
        traceback.print_exc()
        what = f"a fault of windmark, not of your data ({type(error).__name__}: {error}); the terminal has its lines"
        return _refusal(HTTPStatus.INTERNAL_SERVER_ERROR, what)
