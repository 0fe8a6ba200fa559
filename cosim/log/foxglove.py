"""Speak the well-known Foxglove messages for what people look at: fault windows, and where the aircraft is.

These messages are for viewers: replay reads none of them.
"""

from dataclasses import dataclass, field
from functools import cached_property
from math import cos, pi, sin
from typing import Any

from foxglove_schemas_protobuf.Event_pb2 import Event
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from mcap_protobuf.schema import build_file_descriptor_set

EARTH_RADIUS = 6_371_008.8  # mean radius R1 of WGS 84 [m]; only to place the aircraft in a viewer
# channels that every log has, so that viewers and scripts find them even when empty
TOPICS: dict[str, Any] = {"/events": Event, "/tf": FrameTransforms, "/fix": LocationFix}


def schema(message: Any) -> bytes:
    """Return the FileDescriptorSet of a message of TOPICS."""
    return build_file_descriptor_set(message).SerializeToString(deterministic=True)


def event(start_ns: int, end_ns: int | None, texts: dict) -> bytes:
    """Return the bytes of a foxglove.Event from start_ns to end_ns (None: open) with `texts` {str: value}."""
    made = TOPICS["/events"](metadata=[{"key": key, "value": str(value)} for key, value in texts.items()])
    made.start_time.FromNanoseconds(start_ns)
    if end_ns is not None:
        made.end_time.FromNanoseconds(end_ns)
    return made.SerializeToString()


@dataclass
class Pose:
    """Give viewers the aircraft's place: /tf and /fix, every `every` ticks.

    `index` are the positions in the tick vector of lat, lon [rad], h [m], phi, theta, psi [rad]. Frames follow
    Foxglove: `map` is east, north, up from where the log begins (flat, EARTH_RADIUS); `aircraft` is forward, left, up.
    """

    index: tuple[int, ...]
    every: int = 20
    _origin: tuple | None = field(default=None, init=False)

    def messages(self, rows: Any, k0: int, dt_ns: int) -> list:
        """Return [(tick, topic, bytes)] of rows (n, 6) in the order of `index`, one a tick, the first of tick k0."""
        out = []
        transforms, fix = self._messages
        frame = transforms.transforms[0]
        for k in range(k0 + -k0 % self.every, k0 + len(rows), self.every):
            lat, lon, h, phi, theta, psi = rows[k - k0].tolist()
            if self._origin is None:
                self._origin = lat, lon
            lat0, lon0 = self._origin
            for at in (frame.timestamp, fix.timestamp):
                at.FromNanoseconds(k * dt_ns)
            place, turn = frame.translation, frame.rotation
            place.x, place.y, place.z = EARTH_RADIUS * (lon - lon0) * cos(lat0), EARTH_RADIUS * (lat - lat0), h
            turn.x, turn.y, turn.z, turn.w = _quaternion(phi, -theta, pi / 2 - psi)
            fix.latitude, fix.longitude, fix.altitude, fix.heading = lat * 180 / pi, lon * 180 / pi, h, psi
            out += [(k, "/tf", transforms.SerializeToString()), (k, "/fix", fix.SerializeToString())]
        return out

    @cached_property
    def _messages(self):
        """Return the two messages that are filled again and again: making them costs more than filling them."""
        frame = {"parent_frame_id": "map", "child_frame_id": "aircraft"}
        return TOPICS["/tf"](transforms=[frame]), TOPICS["/fix"](frame_id="aircraft")


def _quaternion(roll, pitch, yaw):
    """Return the quaternion x, y, z, w of rotations [rad] by yaw (z), pitch (y), roll (x), in that order about moving
    axes."""
    if not all(abs(a) < 1e6 for a in (roll, pitch, yaw)):  # a diverged state has no attitude
        return 0.0, 0.0, 0.0, 1.0
    cr, sr, cp, sp, cy, sy = (f(a / 2) for a in (roll, pitch, yaw) for f in (cos, sin))
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )
