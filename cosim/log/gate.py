"""Origin and token check of the live server: only programs, and pages that show flights, may connect.

Any web page that the user has open may connect to a port of this machine; a browser says in `Origin` whose page it is,
and no page can leave that out. The gate reads it, and passes the rest on to a server behind, which listens at an
address of its own: a random one of the loopback network where the system has more than one. Who shows the token comes
to the server that takes requests, who shows none to the one that only tells, who shows a wrong one is turned away.
"""

import contextlib
import hmac
import secrets
import selectors
import socket
import socketserver
import sys
import threading
import time
from collections.abc import Callable, Collection
from typing import Any
from urllib.parse import parse_qs, urlsplit

ORIGINS = ("https://app.foxglove.dev", "https://studio.foxglove.dev")  # pages of Foxglove itself
OWN_HOSTS = ("localhost", "127.0.0.1", "::1")  # a page that this machine serves
HEAD_BYTES, HEAD_S = 16384, 5.0  # of the request that opens a connection, all of it
MOST = 64  # connections at a time: each takes a thread and two sockets
KEPT = 8  # of them, for who shows the token: those who only watch keep the owner out of nothing


def hidden_host() -> str:
    """Return a loopback address that no page can guess, 127.0.0.1 where the system has no other."""
    if not sys.platform.startswith("linux"):
        return "127.0.0.1"
    a, b, c = (secrets.randbelow(254) + 1 for _ in range(3))
    return f"127.{a}.{b}.{c}"


def allowed(origin: str | None, origins: Collection[str] = ORIGINS) -> bool:
    """Tell whether a connection with this `Origin` (None: it has none, so it is no page of a browser) may come in."""
    if origin is None or origin in origins or origin.startswith(("file://", "app://")):  # the user's application
        return True
    try:
        parts = urlsplit(origin)
    except ValueError:  # no address at all
        return False
    return parts.scheme in ("http", "https") and parts.hostname in OWN_HOSTS


class Gate:
    """Listen at `host`:`port` and pass what may come in to `inner` (host, port), or with `token` in its address,
    ws://host:port/?token=..., to `steered`; `close` ends it. Raises OSError."""

    def __init__(
        self, host: str, port: int, inner: tuple[str, int], steered: tuple[str, int] | None = None, token: str = ""
    ):
        def behind(head: bytes) -> tuple[str, int] | None:
            shown = _token(head)
            if shown is None or steered is None:
                return inner
            return steered if hmac.compare_digest(shown.encode(), token.encode()) else None

        watching = threading.BoundedSemaphore(MOST - KEPT)

        class Handler(socketserver.BaseRequestHandler):
            def handle(self) -> None:
                _pass_on(self.request, behind, inner, watching)

        self._server = _Server((host, port), Handler)
        self.port = int(self._server.server_address[1])
        threading.Thread(target=self._server.serve_forever, name="gate", daemon=True).start()

    def close(self) -> None:
        """Take no more connections."""
        self._server.shutdown()
        self._server.server_close()


class _Server(socketserver.ThreadingTCPServer):
    allow_reuse_address = daemon_threads = True
    request_queue_size = 2 * MOST  # of 5 places, the system's choice, a caller beyond waits for seconds to try again

    def __init__(self, *about: Any):
        self._held: set[Any] = set()
        super().__init__(*about)

    def verify_request(self, request: Any, client_address: Any) -> bool:
        """Tell whether there is a place for a connection: before its thread is made, a flood makes none beyond MOST."""
        if len(self._held) >= MOST:
            return False
        self._held.add(request)
        return True

    def shutdown_request(self, request: Any) -> None:
        """Give the place of a connection back."""
        self._held.discard(request)
        super().shutdown_request(request)


def _pass_on(
    client: socket.socket, behind: Callable[[bytes], tuple[str, int] | None], watched: tuple[str, int],
    watching: threading.BoundedSemaphore,
) -> None:  # fmt: skip
    """Pass on what may come in; of those that only watch the server `watched`, as many as have a place."""
    head = _head(client)
    inner = behind(head) if head is not None and allowed(_origin(head)) else None
    if head is None or inner is None:
        with contextlib.suppress(OSError):
            client.sendall(b"HTTP/1.1 403 Forbidden\r\nContent-Length: 0\r\nConnection: close\r\n\r\n")
        return
    if inner != watched:
        _between(client, inner, head)
    elif watching.acquire(blocking=False):
        try:
            _between(client, inner, head)
        finally:
            watching.release()


def _between(client: socket.socket, inner: tuple[str, int], head: bytes) -> None:
    """Hand `head`, and all that follows on either side, to the other, until one of them closes."""
    with contextlib.suppress(OSError), socket.create_connection(inner, timeout=HEAD_S) as server:
        server.settimeout(None)
        server.sendall(head)
        with selectors.DefaultSelector() as both:
            both.register(client, selectors.EVENT_READ, server)
            both.register(server, selectors.EVENT_READ, client)
            while True:
                for key, _ in both.select():
                    data = key.fileobj.recv(1 << 16)  # type: ignore[union-attr]
                    if not data:
                        return
                    key.data.sendall(data)


def _head(client: socket.socket) -> bytes | None:
    """Return what opens the connection, up to the empty line and what follows it; None when it does not come."""
    data, end = b"", time.monotonic() + HEAD_S
    try:
        while b"\r\n\r\n" not in data:
            client.settimeout(max(1e-3, end - time.monotonic()))  # bytes one by one keep nobody's place
            more = client.recv(4096)
            if not more or len(data) + len(more) > HEAD_BYTES:
                return None
            data += more
    except OSError:
        return None
    client.settimeout(None)
    return data


def _token(head: bytes) -> str | None:
    """Return the token in the address of a request, None without one."""
    target = head.split(b"\r\n")[0].decode("latin-1").split(" ")[1:2]
    try:
        found = parse_qs(urlsplit(target[0]).query, keep_blank_values=True).get("token") if target else None
    except ValueError:
        return ""
    return found[0] if found else None


def _origin(head: bytes) -> str | None:
    """Return the Origin of a request, None without one; of several, which no browser sends, one that never fits."""
    lines = head.split(b"\r\n\r\n")[0].decode("latin-1").split("\r\n")[1:]
    pairs = (line.partition(":") for line in lines)
    found = [value.strip() for name, _, value in pairs if name.strip().lower() == "origin"]
    return None if not found else found[0] if len(found) == 1 else "several"
