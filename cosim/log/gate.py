"""Origin and token check of the live server: only programs, and pages that show flights, may connect.

Any web page that the user has open may connect to a port of this machine; a browser says in `Origin` whose page it is,
and no page can leave that out. The gate reads it, and passes the rest on to a server behind, which listens at an
address of its own: a random one of the loopback network where the system has more than one. Where there is a token,
who does not show it is turned away.
"""

import asyncio
import contextlib
import email
import hmac
import re
import secrets
import socket
import sys
import threading
from concurrent.futures import Future
from urllib.parse import parse_qs, urlsplit

ORIGIN = re.compile(
    r"https://(app|studio)\.foxglove\.dev"  # pages of Foxglove itself
    r"|https?://(localhost|127\.0\.0\.1|\[::1\])(:\d+)?"  # a page that this machine serves
    r"|(file|app)://.*"  # the user's application
)
HEAD_BYTES, HEAD_S = 16384, 5.0  # of the request that opens a connection, all of it
MOST = 64  # connections at a time: each takes two sockets
REFUSED = b"HTTP/1.1 403 Forbidden\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"


def hidden_host() -> str:
    """Return a loopback address that no page can guess, 127.0.0.1 where the system has no other."""
    if not sys.platform.startswith("linux"):
        return "127.0.0.1"
    return "127." + ".".join(str(secrets.randbelow(254) + 1) for _ in range(3))


def allowed(origins: list[str]) -> bool:
    """Tell whether a connection with these `Origin` headers may come in: none is no page of a browser, and no browser
    sends several."""
    return not origins or (len(origins) == 1 and bool(ORIGIN.fullmatch(origins[0])))


class Gate:
    """Listen at `host`:`port` and pass what may come in to `inner` (host, port); where there is a `token`, that is who
    shows it in the address, ws://host:port/?token=... `close` ends it. Raises OSError."""

    def __init__(self, host: str, port: int, inner: tuple[str, int], token: str = ""):
        self._inner, self._token, self._places = inner, token.encode(), asyncio.Semaphore(MOST)
        # in a queue of 5 places, the system's choice, a caller beyond waits for seconds to try again
        listening = socket.create_server((host, port), backlog=2 * MOST)
        self.port, started = int(listening.getsockname()[1]), Future()  # type: ignore[var-annotated]
        threading.Thread(target=lambda: asyncio.run(self._serve(listening, started)), name="gate", daemon=True).start()
        self.close = started.result()

    async def _serve(self, listening: socket.socket, started: Future) -> None:
        ended, loop = asyncio.Event(), asyncio.get_running_loop()
        server = await asyncio.start_server(self._taken, sock=listening, limit=HEAD_BYTES)
        started.set_result(lambda: loop.call_soon_threadsafe(ended.set))
        await ended.wait()
        server.close()

    async def _taken(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Hand what may come in to the server behind, and all that follows to the other side, until one closes."""
        with contextlib.closing(writer), contextlib.suppress(OSError):
            if self._places.locked():
                return
            async with self._places:
                if not (head := await self._admitted(reader)):
                    writer.write(REFUSED)
                    return await writer.drain()
                answers, asks = await asyncio.open_connection(*self._inner)
                with contextlib.closing(asks):
                    asks.write(head)
                    both = [asyncio.ensure_future(_copy(*way)) for way in ((reader, asks), (answers, writer))]
                    await asyncio.wait(both, return_when=asyncio.FIRST_COMPLETED)
                    for way in both:
                        way.cancel()

    async def _admitted(self, reader: asyncio.StreamReader) -> bytes:
        """Return the head of a request that may come in, nothing of one that is turned away."""
        try:
            head = await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), HEAD_S)  # bytes one by one keep nobody's place
            request, _, rest = head.partition(b"\r\n")
            shown = parse_qs(urlsplit(request.decode("latin-1").split(" ")[1]).query).get("token", [""])[0]
        except (TimeoutError, asyncio.IncompleteReadError, asyncio.LimitOverrunError, ValueError, IndexError):
            return b""
        own = allowed(email.message_from_bytes(rest).get_all("Origin", []))
        return head if own and (not self._token or hmac.compare_digest(shown.encode(), self._token)) else b""


async def _copy(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    with contextlib.suppress(OSError):
        while data := await reader.read(1 << 16):
            writer.write(data)
            await writer.drain()
