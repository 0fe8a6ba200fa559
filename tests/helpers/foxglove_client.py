"""A viewer for tests: a WebSocket client that speaks as much of Foxglove's protocol as watching and asking take."""

import json
import struct

from websockets.sync.client import connect

PROTOCOL = "foxglove.sdk.v1"


class Viewer:
    """Connect to `url` with an optional `origin`; a context manager. Raises InvalidStatus when it is turned away."""

    def __init__(self, url, origin=None):
        self._socket = connect(url, subprotocols=[PROTOCOL], origin=origin, max_size=None, open_timeout=20)
        self.info, self.channels, self.services, self.offered = {}, {}, {}, {}
        self.samples, self.answers, self.states = {}, {}, []  # topic -> [(ns, payload)]
        self._topics, self._call = {}, 0
        self.until(lambda: self.info)

    def until(self, true, seconds=20.0):
        """Take messages until `true()`; raises TimeoutError."""
        while not true():
            self._take(self._socket.recv(timeout=seconds))

    def _take(self, message):
        if isinstance(message, str):
            said = json.loads(message)
            if said["op"] == "serverInfo":
                self.info = said
            elif said["op"] == "advertise":
                self.channels |= {c["topic"]: c["id"] for c in said["channels"]}
            elif said["op"] == "advertiseServices":
                self.services |= {s["name"]: s["id"] for s in said["services"]}
                self.offered |= {s["name"]: s for s in said["services"]}
            elif said["op"] == "serviceCallFailure":
                self.answers[said["callId"]] = {"ok": False, "error": said["message"]}
        elif message[0] == 1:
            subscription, ns = struct.unpack_from("<IQ", message, 1)
            self.samples.setdefault(self._topics[subscription], []).append((ns, message[13:]))
        elif message[0] == 3:
            _, call, length = struct.unpack_from("<III", message, 1)
            self.answers[call] = json.loads(message[13 + length :])
        elif message[0] == 5:
            self.states.append(struct.unpack_from("<BQf?", message, 1))  # status, ns, speed, did seek

    def watch(self, topic):
        """Subscribe to a topic once it is there."""
        self.until(lambda: topic in self.channels)
        number = len(self._topics) + 1
        self._topics[number] = topic
        subscription = {"id": number, "channelId": self.channels[topic]}
        self._socket.send(json.dumps({"op": "subscribe", "subscriptions": [subscription]}))

    def call(self, service, /, **keys):
        """Return the answer of a service to these keys."""
        self.until(lambda: f"/{service}" in self.services)
        self._call += 1
        head = struct.pack("<BIII", 2, self.services[f"/{service}"], self._call, 4)
        self._socket.send(head + b"json" + json.dumps(keys).encode())
        self.until(lambda: self._call in self.answers)
        return self.answers[self._call]

    def control(self, play, speed=1.0, seek_ns=None):
        """Play or pause, at a speed, from a time on."""
        seek = struct.pack("<BQ", 1, seek_ns) if seek_ns is not None else struct.pack("<BQ", 0, 0)
        self._socket.send(struct.pack("<BBf", 3, 0 if play else 1, speed) + seek + struct.pack("<I", 1) + b"c")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._socket.close()
