"""Show a flight while it is flown: the log's own topics over a WebSocket for Foxglove, and let viewers break it.

Nothing of the watching enters the log: a watched flight leaves the same bytes as one that nobody sees. Who comes in may
call the services that the flight offers, so that its address has a token; they run in the flight's own thread, between
two ticks.
"""

import json
import queue
import secrets
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any

import numpy as np

from cosim.errors import CosimError, OutputError
from cosim.texts import from_json

from . import foxglove, gate
from .format import channel_metadata
from .layout import HEAD, Block, by_channel, schema_data, schema_name
from .layouts import live_layout
from .writer import Target

HOST = "127.0.0.1"
PATIENCE_S = 120.0  # that a service waits for the flight
LAG_S = 0.2  # a flight that is later than that behind the clock goes on from where it is
LARGEST = 20_000  # bytes of a request
RATE = 50.0  # of the samples that are shown [Hz]: about what a screen draws


def library() -> Any:
    """Return the foxglove SDK; raises OutputError with what to install."""
    try:
        import foxglove as sdk
    except ImportError:
        raise OutputError(
            "showing a flight live needs foxglove-sdk, which is not installed",
            remedy="Install it: pip install 'cosim-fdi[live]'",
        ) from None
    return sdk


@dataclass(frozen=True)
class Control:
    """Something that viewers may do: `do` takes the keys of a request and returns those of the answer.

    `request` is the JSON schema of those keys, `example` a request that is a good first one.
    """

    do: Callable[[dict], Mapping[str, Any]]
    request: Mapping[str, Any]
    example: Mapping[str, Any]


class Pace:
    """Keep ticks of `dt` [s] at `speed` times that of the clock."""

    def __init__(self, dt: float, speed: float = 1.0):
        self.dt, self.speed, self._since = dt, speed, (0, 0.0)

    def change(self, speed: float, k: int) -> None:
        """Go at another speed from tick `k` on."""
        self.speed, self._since = speed, (k, time.perf_counter())

    def wait(self, k: int) -> None:
        """Wait until the clock has come as far as the end of tick `k`."""
        start, begin = self._since
        now = time.perf_counter()
        ahead = begin + (k + 1 - start) * self.dt / self.speed - now
        if begin == 0.0 or ahead < -LAG_S:
            self._since = k + 1, now
        elif ahead > 0:
            time.sleep(ahead)


class Live:
    """Serve the ticks of a flight; use it as a context manager, `append(v)` after each tick, then `serve()`.

    `topics`, `dt_ns` and `pose` are those of the LogWriter. `port` 0 takes a free one. `speed` is that of the flight
    against the clock. `controls` {name: Control} are what viewers may do, and the address `url` has a token then; a
    CosimError is answered as a refusal. `context` is a foxglove.Context, by default its own. `layout` is for Foxglove's
    "Import from file". Raises OutputError when the library is missing or the port is taken.
    """

    def __init__(
        self, topics: Sequence[Any], *, dt_ns: int = 5_000_000, pose: Any = None, port: int, name: str = "cosim",
        context: Any = None, speed: float = 1.0, controls: Mapping[str, Control] | None = None,
        more: Mapping[str, Any] | None = None,
    ):  # fmt: skip
        self._sdk = sdk = library()
        self._context, self.dt_ns, self.pace = context or sdk.Context(), dt_ns, Pace(dt_ns * 1e-9, speed)
        self._known: dict[tuple, Any] = {}  # (name, descriptors) -> its channel: with it the channel would close
        self.declare(topics, pose)
        self._controls = dict(controls or {})
        self.layout = live_layout(topics, {name: c.example for name, c in self._controls.items()})
        self._waiting: queue.SimpleQueue[tuple[str, Any, Future]] = queue.SimpleQueue()
        offered = dict(more or {})
        if self._controls:
            offered |= {"capabilities": [sdk.websocket.Capability.Services], "supported_encodings": ["json"],
                        "services": [self._service(name) for name in self._controls]}  # fmt: skip
        token, inner = secrets.token_urlsafe(18) if controls else "", gate.hidden_host()
        self.server = sdk.start_server(name=name, host=inner, port=0, context=self._context, **offered)
        try:
            self._gate = gate.Gate(HOST, port, (inner, self.server.port), token)
        except OSError as error:
            self.server.stop()
            said = f"cannot be served: {error.strerror}"
            raise OutputError(said, place=f"{HOST}:{port}", remedy="Free the port, or choose another") from None
        self.url = f"ws://{HOST}:{self._gate.port}" + f"/?token={token}" * bool(token)
        self._k = 0

    def declare(self, topics: Sequence[Any], pose: Any) -> None:
        """Show these topics from now on: what is new gets a channel, what is known keeps its own."""
        sampled, self._pose, self._channels = by_channel([t for t in topics if t.every == 1]), pose, []
        block = Block(1, [(i, name, parts) for i, (name, parts) in enumerate(sampled.items())])
        self._target = Target(block, topics, 1)
        ends = [*(at for _, at in block.channels[1:]), block.size]
        for (name, parts), (_, at), end in zip(sampled.items(), block.channels, ends):
            channel = self._channel(name, schema_name(name), schema_data(name, tuple(parts)), channel_metadata(parts))
            self._channels.append((channel, slice(at + HEAD.size, end)))
        kinds = {name: foxglove.TOPICS[name] for name in ("/tf", "/fix")}
        self._places = {n: self._channel(n, m.DESCRIPTOR.full_name, foxglove.schema(m), {}) for n, m in kinds.items()}

    def _channel(self, name, message, data, metadata):
        if (name, data) not in self._known:
            schema = self._sdk.Schema(name=message, encoding="protobuf", data=data)
            how: dict[str, Any] = {"message_encoding": "protobuf", "context": self._context, "metadata": metadata}
            self._known[name, data] = self._sdk.Channel(name, schema=schema, **how)
        return self._known[name, data]

    @property
    def stride(self) -> int:
        """Return every how many ticks one is shown: the faster it goes, the fewer of each second flown."""
        return max(1, round(1e9 / RATE / self.dt_ns * self.pace.speed))

    def show(self, k: int, row: np.ndarray, where: Mapping[str, bytes]) -> None:
        """Show tick `k`: the messages of the topics as a log has them (bytes,), and those of /tf and /fix."""
        for channel, part in self._channels:
            channel.log(row[part].tobytes(), log_time=k * self.dt_ns)
        for name in self._places.keys() & where.keys():
            self._places[name].log(where[name], log_time=k * self.dt_ns)

    def append(self, v: np.ndarray) -> None:
        """Show the vector v of the next tick, then wait until the clock has come as far as the flight."""
        k, self._k = self._k, self._k + 1
        if k % self.stride == 0:
            self._target.store(k, v)
            where = self._pose.messages(v[list(self._pose.index)][None], k, self.dt_ns) if self._pose else ()
            self.show(k, self._target.rows[0], {name: data for _, name, data in where})
        self.pace.wait(k)

    def serve(self) -> None:
        """Do what viewers have asked for since, here and now."""
        while not self._waiting.empty():
            name, given, answer = self._waiting.get()
            try:
                said = {"ok": True, **self._controls[name].do(given)}
            except (CosimError, TypeError, ValueError, KeyError, ArithmeticError) as error:  # whatever a request holds
                said = {"ok": False, "error": str(error)}
            answer.set_result(said)

    def _service(self, name):
        """Return the service of a control: it hands a request to the flight and waits for its answer."""
        sdk = self._sdk

        def called(request):
            try:
                given = from_json(request.payload, place=f"/{name}", largest=LARGEST)
                if not isinstance(given, dict):
                    raise CosimError("is no object of keys and values", place=f"/{name}")
                answer: Future = Future()
                self._waiting.put((name, given, answer))
                said = answer.result(PATIENCE_S)
            except (CosimError, TimeoutError) as error:
                said = {"ok": False, "error": str(error) or "the flight does not answer"}
            return json.dumps(said).encode()

        def told(kind, schema):
            about = sdk.Schema(name=f"cosim.{name}.{kind}", encoding="jsonschema", data=json.dumps(schema).encode())
            return sdk.websocket.MessageSchema(encoding="json", schema=about)

        request, response = told("Request", self._controls[name].request), told("Answer", {"type": "object"})
        schema = sdk.websocket.ServiceSchema(f"cosim/{name}", request=request, response=response)
        return sdk.websocket.Service(name=f"/{name}", schema=schema, handler=called)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._gate.close()
        self.server.stop()
