"""Live channels for a viewer: the log's topics in a Foxglove context, some samples a second."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from cosim.errors import OutputError

from . import foxglove
from .chunk import empty_message
from .format import channel_metadata, schema_data, schema_name
from .message_layout import HEAD

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


class Shown:
    """Channels of `context`, a foxglove.Context, for topics and pose of a LogWriter; `send` shows a tick.

    `speed` is that of the samples in multiples of the clock's: the faster, the fewer are shown of each second flown.
    """

    def __init__(self, topics: Sequence[Any], pose: Any, dt_ns: int, context: Any):
        self._context, self.dt_ns, self.speed = context, dt_ns, 1.0
        self._known: dict[tuple, Any] = {}  # (topic, fields) -> its channel: with it the channel would close
        self._places: dict[str, Any] = {}
        self.declare(topics, pose)

    def declare(self, topics: Sequence[Any], pose: Any) -> None:
        """Show these topics from now on: what is new gets a channel, what is known keeps its own."""
        sdk, self._pose, self._channels = library(), pose, []
        for t in topics:
            if t.every > 1:
                continue
            body, runs = empty_message(len(t.fields))
            at = np.concatenate([start - HEAD.itemsize + step * np.arange(run.stop - run.start)
                                 for run, start, step in runs])  # fmt: skip
            key = t.name, tuple(t.fields)
            if key not in self._known:
                schema = sdk.Schema(name=schema_name(t.name), encoding="protobuf", data=schema_data(t.name, t.fields))
                self._known[key] = sdk.Channel(t.name, schema=schema, message_encoding="protobuf",
                                               context=self._context, metadata=channel_metadata(t))  # fmt: skip
            message = np.frombuffer(body, "u1").copy()
            self._channels.append((self._known[key], t.index, message, at[:, None] + np.arange(8)))
        for topic in ("/tf", "/fix") if pose is not None and not self._places else ():
            kind, data = foxglove.TOPICS[topic]
            schema = sdk.Schema(name=kind, encoding="protobuf", data=data())
            self._places[topic] = sdk.Channel(topic, schema=schema, message_encoding="protobuf", context=self._context)

    @property
    def stride(self) -> int:
        """Return every how many ticks one is shown."""
        return max(1, round(1e9 / RATE / self.dt_ns * self.speed))

    def send(self, k: int, v: np.ndarray) -> None:
        """Show tick `k` of the vector v that the topics index."""
        ns = k * self.dt_ns
        for channel, index, message, at in self._channels:
            message[at] = np.ascontiguousarray(v[index]).view("u1").reshape(-1, 8)
            channel.log(message.tobytes(), log_time=ns)
        if self._pose is not None:
            for _, name, data in self._pose.messages(v[list(self._pose.index)][None], k, self.dt_ns):
                self._places[name].log(data, log_time=ns)
