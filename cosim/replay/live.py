"""Show a log as if it were flown now: played, paused, scrubbed from Foxglove, by `cosim replay LOG --live`.

Foxglove's own playback bar steers it; a viewer without one sees it played once at the speed of the command. Whoever
comes in may scrub, nothing else: a log is only read.
"""

import os
import queue
import threading
from collections.abc import Callable
from typing import Any

from cosim.errors import LogError
from cosim.log import open_log
from cosim.log.live import Live, library
from cosim.replay.log_schema import check_start

IDLE_S = 0.02  # between looks at what viewers ask for, while nothing plays


def show(
    path: str | os.PathLike, *, port: int, speed: float = 1.0, start_s: float = 0.0,
    ready: Callable[[Any], None] | None = None, ended: threading.Event | None = None
) -> None:  # fmt: skip
    """Serve the log at `path` on `port` of this machine, from `start_s` at `speed`, until Ctrl-C or `ended` is set.

    `ready(server)` is called when viewers may come. Raises LogError for a log that cannot be read or has no ticks,
    ReplayError for a start that is no time, OutputError when it cannot be served.
    """
    check_start(start_s)
    log = open_log(os.fspath(path))
    n, dt_ns, sdk = log.n_ticks, log.dt_ns, library()
    first = min(round(start_s * 1e9 / dt_ns), n)
    if n < 1 or log.gaps:
        raise LogError("has no ticks, or gaps between them", place=str(path), remedy="cosim recover makes it whole")
    player = _Player(sdk, first, n, dt_ns, speed)
    more = {"playback_time_range": (0, n * dt_ns), "server_listener": player.listener()}
    topics, name = [t for t in log.topics.values() if t.every == 1], os.path.basename(os.fspath(path))
    with Live(topics, dt_ns=dt_ns, port=port, name=name, speed=speed, more=more) as live:
        if ready:
            ready(live)
        player.play(live, log, ended or threading.Event())


class _Player:
    """Where the log is, and how it goes on."""

    def __init__(self, sdk, k, n, dt_ns, speed):
        self._sdk, self.k, self._n, self._dt_ns, self.speed = sdk, k, n, dt_ns, speed
        self.playing = True
        self._asked: queue.SimpleQueue = queue.SimpleQueue()

    def listener(self):
        """Return what the SDK calls when a viewer moves the playback bar."""
        player, ws = self, self._sdk.websocket

        class Listener(ws.ServerListener):  # type: ignore[name-defined]
            def on_playback_control_request(self, request):
                player._asked.put(request)
                playing = request.playback_command == ws.PlaybackCommand.Play
                at = player.k * player._dt_ns if request.seek_time is None else request.seek_time
                return player.state(playing, at, request.playback_speed, request.seek_time is not None, request)

        return Listener()

    def state(self, playing, at, speed, sought=False, request=None):
        """Return a PlaybackState."""
        ws = self._sdk.websocket
        status = ws.PlaybackStatus.Playing if playing else ws.PlaybackStatus.Paused
        if not playing and at >= self._n * self._dt_ns:
            status = ws.PlaybackStatus.Ended
        return ws.PlaybackState(status, int(at), speed, sought, request.request_id if request else "")

    def play(self, live, log, ended):
        """Show ticks until `ended` is set."""
        server = live.server
        while not ended.is_set():
            self._follow(live, log)
            if not self.playing:
                ended.wait(IDLE_S)
                continue
            live.show(self.k, *log.row(self.k))
            step = min(live.stride, self._n - self.k)
            self.k += step
            live.pace.wait(self.k - 1)
            if self.k >= self._n:
                self.playing = False
                server.broadcast_playback_state(self.state(False, self.k * self._dt_ns, self.speed))

    def _follow(self, live, log):
        while not self._asked.empty():
            request = self._asked.get()
            self.playing = request.playback_command == self._sdk.websocket.PlaybackCommand.Play
            if 0.01 <= request.playback_speed <= 1000.0:
                self.speed = request.playback_speed
            if request.seek_time is not None:
                self.k = min(max(0, round(request.seek_time / self._dt_ns)), self._n - 1)
                live.show(self.k, *log.row(self.k))
            if self.playing and self.k >= self._n:
                self.k = 0
            live.pace.change(self.speed, self.k)
