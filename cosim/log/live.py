"""Show a flight while it is flown: the log's own topics over a WebSocket for Foxglove, at the speed of the clock.

Nothing of it enters the log: a watched flight leaves the same bytes as one that nobody sees.
"""

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from cosim.errors import OutputError

from . import foxglove, gate
from .chunk import HEAD, empty_message
from .format import channel_metadata, schema_data, schema_name

RATE = 50.0  # of the samples that are shown [Hz]: about what a screen draws
HOST = "127.0.0.1"


class Live:
    """Serve the ticks of a flight; use it as a context manager, `append(v)` after each tick.

    `topics`, `dt_ns` and `pose` are those of the LogWriter. `port` 0 takes a free one. `context` is a
    foxglove.Context, by default its own. Raises OutputError when the library is missing or the port is taken.
    """

    def __init__(
        self,
        topics: Sequence[Any],
        *,
        dt_ns: int = 5_000_000,
        pose: Any = None,
        port: int,
        name: str = "cosim",
        context: Any = None,
    ):
        sdk = _library()
        self.dt_ns, self._pose = dt_ns, pose
        self._stride = max(1, round(1e9 / RATE / dt_ns))
        self._context = context = context or sdk.Context()  # kept: with it the channels would close
        self._channels = []
        for t in topics:
            if t.every == 1:
                schema = sdk.Schema(name=schema_name(t.name), encoding="protobuf", data=schema_data(t.name, t.fields))
                body, runs = empty_message(len(t.fields))
                at = np.concatenate([start - HEAD.itemsize + step * np.arange(run.stop - run.start)
                                     for run, start, step in runs])  # fmt: skip
                channel = sdk.Channel(t.name, schema=schema, message_encoding="protobuf", context=context,
                                      metadata=channel_metadata(t))  # fmt: skip
                self._channels.append(
                    (channel, t.index, np.frombuffer(body, "u1").copy(), at[:, None] + np.arange(8))
                )
        self._places = {}
        for topic in ("/tf", "/fix") if pose is not None else ():
            message, data = foxglove.TOPICS[topic]
            schema = sdk.Schema(name=message, encoding="protobuf", data=data())
            self._places[topic] = sdk.Channel(topic, schema=schema, message_encoding="protobuf", context=context)
        try:
            inner = gate.hidden_host()
            self._server = sdk.start_server(name=name, host=inner, port=0, context=context)
        except Exception as error:  # the library has no narrower one
            raise OutputError(f"cannot be served: {error}", place=inner) from None
        try:
            self._gate = gate.Gate(HOST, port, (inner, self._server.port))
        except OSError as error:
            self._server.stop()
            said = f"cannot be served: {error.strerror}"
            raise OutputError(said, place=f"{HOST}:{port}", remedy="Free the port, or choose another") from None
        self.url = f"ws://{HOST}:{self._gate.port}"
        self._k, self._start = 0, 0.0

    def append(self, v: np.ndarray) -> Any:
        """Show the vector v of the next tick, then wait until the clock has come as far as the flight."""
        k, self._k = self._k, self._k + 1
        self._start = self._start or time.perf_counter()
        if k % self._stride == 0:
            self._show(k, v)
        ahead = self._start + self._k * self.dt_ns * 1e-9 - time.perf_counter()
        if ahead > 0:
            time.sleep(ahead)

    def _show(self, k, v):
        ns = k * self.dt_ns
        for channel, index, body, at in self._channels:
            body[at] = np.ascontiguousarray(v[index]).view("u1").reshape(-1, 8)
            channel.log(body.tobytes(), log_time=ns)
        if self._pose is not None:
            for _, name, data in self._pose.messages(v[list(self._pose.index)][None], k, self.dt_ns):
                self._places[name].log(data, log_time=ns)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._gate.close()
        self._server.stop()


def _library():
    try:
        import foxglove as sdk
    except ImportError:
        raise OutputError(
            "showing a flight live needs foxglove-sdk, which is not installed",
            remedy="Install it: pip install 'cosim-fdi[live]'",
        ) from None
    return sdk
