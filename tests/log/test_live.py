"""`cosim run --live`: what a viewer gets is what the log holds, by the clock, and the log stays the same."""

import contextlib
import functools
import socket
import sys
import time

import numpy as np
import pytest

import cosim
from cosim.errors import OutputError
from cosim.flight.build import build
from cosim.flight.fly import fly
from cosim.flight.interactive.live import fly_live
from cosim.flight.loop.recorder import pose, topics
from cosim.flight.simulate import simulate
from cosim.log import gate, open_log
from cosim.log.live import Live

foxglove = pytest.importorskip("foxglove")
SHORT = ["duration_s=0.5", "detectors.enabled=['iotsekf', 'lpv_smo']", "flight.turbulence=light"]


def test_a_viewer_gets_the_samples_of_the_log(tmp_path):
    from mcap.reader import make_reader
    from mcap_protobuf.decoder import DecoderFactory

    s = cosim.load_scenario("liquid-ofc", SHORT)
    simulate(s, log=tmp_path / "flight.mcap", timed=False)
    setup, context = build(s), foxglove.Context()
    sink = foxglove.open_mcap(tmp_path / "seen.mcap", context=context)
    with Live(topics(setup), pose=pose(setup.loop.bus), port=0, context=context) as server:
        fly(setup, server.append)
    sink.close()
    log, seen = open_log(tmp_path / "flight.mcap"), {}
    with open(tmp_path / "seen.mcap", "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, message, sample in reader.iter_decoded_messages():
            seen.setdefault(channel.topic, []).append((message.log_time, sample))
    sampled = {name for name, t in log.topics.items() if t.every == 1}
    assert set(seen) == {log.topics[name].channel for name in sampled} | {"/tf", "/fix"}
    for name in sampled:
        frame = log.frame(name)
        fields, own = log.topics[name].fields, seen[log.topics[name].channel]
        assert [ns for ns, _ in own] == [k * 5_000_000 for k in range(0, 100, 4)]
        words = name[len(log.topics[name].channel) :].split("/")[1:]
        parts = [functools.reduce(getattr, words, sample) for _, sample in own]
        got = np.array([[getattr(part, f) for f in fields] for part in parts])
        assert got.tobytes() == frame[list(fields)].to_numpy()[::4].tobytes(), name


def test_a_watched_flight_goes_by_the_clock_and_leaves_the_same_log(tmp_path):
    s = cosim.load_scenario("liquid-ofc", SHORT)
    simulate(s, log=tmp_path / "alone.mcap", timed=False, achieved=True)
    begin = time.perf_counter()
    fly_live(s, log=tmp_path / "watched.mcap", port=0)
    assert time.perf_counter() - begin > 0.45
    assert (tmp_path / "alone.mcap").read_bytes() == (tmp_path / "watched.mcap").read_bytes()


def test_a_port_in_use_and_a_missing_library_are_told(monkeypatch):
    setup = build(cosim.load_scenario("liquid-ofc", SHORT))
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(OutputError, match=r"127\.0\.0\.1:\d+: cannot be served.*in use"):
            Live(topics(setup), port=taken.getsockname()[1])
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(OutputError, match=r"pip install 'cosim-fdi\[live\]'"):
        Live(topics(setup), port=0)


HELLO = (
    "GET / HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Protocol: foxglove.sdk.v1\r\n{origin}\r\n"
)
STRANGE = (
    "https://evil.example", "null", "", "http://[", "https://app.foxglove.dev.evil.example",
    "http://localhost.evil.example",
)  # fmt: skip


def _answer(url, origin):
    host, port = url.removeprefix("ws://").split(":")
    with socket.create_connection((host, int(port)), timeout=10) as client:
        line = "".join(f"Origin: {o}\r\n" for o in origin)
        client.sendall(HELLO.format(host=f"{host}:{port}", origin=line).encode())
        return client.recv(4096).split(b"\r\n")[0].decode()


def test_only_programs_and_pages_that_show_flights_may_watch():
    setup = build(cosim.load_scenario("liquid-ofc", SHORT))
    with Live(topics(setup), port=0) as server:
        for origin in ([], ["https://app.foxglove.dev"], ["http://localhost:8080"]):
            assert _answer(server.url, origin) == "HTTP/1.1 101 Switching Protocols", origin
        for origin in (*([o] for o in STRANGE), ["https://app.foxglove.dev", "https://evil.example"]):
            assert _answer(server.url, origin) == "HTTP/1.1 403 Forbidden", origin


def test_who_floods_the_gate_keeps_nobody_out_for_long(monkeypatch):
    """Connections that say nothing, or a byte at a time, are closed."""
    monkeypatch.setattr(gate, "HEAD_S", 0.5)
    setup = build(cosim.load_scenario("liquid-ofc", SHORT))
    with Live(topics(setup), port=0) as server:
        place = "127.0.0.1", int(server.url.rpartition(":")[2])
        idle = [socket.create_connection(place, timeout=10) for _ in range(2 * gate.MOST)]
        begin = time.monotonic()
        with socket.create_connection(place, timeout=10) as slow, contextlib.suppress(OSError):
            while time.monotonic() - begin < 5 and slow.send(b"G"):
                time.sleep(0.1)
        assert time.monotonic() - begin < 4
        for one in idle:
            one.close()
        assert _answer(server.url, []) == "HTTP/1.1 101 Switching Protocols"
