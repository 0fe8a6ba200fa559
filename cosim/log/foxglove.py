"""Speak the well-known Foxglove messages for what people look at: fault windows, and where the aircraft is.

The schemas are those of Foxglove's own package (same names, numbers and types), built here from descriptors, so that
the core does not need that package. These messages are for viewers: replay reads none of them.
"""

from dataclasses import dataclass, field
from functools import cache, cached_property, partial
from math import cos, pi, sin
from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2

_F = descriptor_pb2.FieldDescriptorProto
_TIME = ".google.protobuf.Timestamp"
EARTH_RADIUS = 6_371_008.8  # mean radius R1 of WGS 84 [m]; only to place the aircraft in a viewer

# message -> (field, number, type); a type with a capital is another message, "name*" is repeated
_MESSAGES = {
    "Vector3": (("x", 1, "double"), ("y", 2, "double"), ("z", 3, "double")),
    "Quaternion": (("x", 1, "double"), ("y", 2, "double"), ("z", 3, "double"), ("w", 4, "double")),
    "Color": (("r", 1, "double"), ("g", 2, "double"), ("b", 3, "double"), ("a", 4, "double")),
    "KeyValuePair": (("key", 1, "string"), ("value", 2, "string")),
    "Event": (("start_time", 1, _TIME), ("end_time", 2, _TIME), ("metadata", 3, "KeyValuePair*")),
    "FrameTransform": (
        ("timestamp", 1, _TIME), ("parent_frame_id", 2, "string"), ("child_frame_id", 3, "string"),
        ("translation", 4, "Vector3"), ("rotation", 5, "Quaternion"),
    ),
    "FrameTransforms": (("transforms", 1, "FrameTransform*"),),
    "LocationFix": (
        ("timestamp", 6, _TIME), ("frame_id", 7, "string"),
        ("latitude", 1, "double"), ("longitude", 2, "double"), ("altitude", 3, "double"),
        ("position_covariance", 4, "double*"),
        ("position_covariance_type", 5, "enum PositionCovarianceType UNKNOWN APPROXIMATED DIAGONAL_KNOWN KNOWN"),
        ("heading", 10, "double"), ("velocity", 11, "Vector3"), ("color", 8, "Color"),
        ("metadata", 9, "KeyValuePair*"),
    ),
}  # fmt: skip


def _file(name):
    """Return the FileDescriptorProto of one message, and the names of the messages that it holds."""
    file = descriptor_pb2.FileDescriptorProto(name=f"foxglove/{name}.proto", package="foxglove", syntax="proto3")
    message, needs = file.message_type.add(name=name), []
    for word, number, kind in _MESSAGES[name]:
        label = _F.LABEL_REPEATED if kind.endswith("*") else _F.LABEL_OPTIONAL
        made = message.field.add(name=word, number=number, label=label)
        kind = kind.rstrip("*")
        if kind.startswith("enum "):
            _, enum, *values = kind.split()
            made.type, made.type_name = _F.TYPE_ENUM, f".foxglove.{name}.{enum}"
            declared = message.enum_type.add(name=enum)
            for value, word in enumerate(values):
                declared.value.add(name=word, number=value)
        elif kind == _TIME:
            made.type, made.type_name = _F.TYPE_MESSAGE, kind
            needs.append(_TIME)
        elif kind in _MESSAGES:
            made.type, made.type_name = _F.TYPE_MESSAGE, f".foxglove.{kind}"
            needs.append(kind)
        else:
            made.type = getattr(_F, f"TYPE_{kind.upper()}")
    needs = sorted(set(needs))
    file.dependency.extend("google/protobuf/timestamp.proto" if n == _TIME else f"foxglove/{n}.proto" for n in needs)
    return file, needs


@cache
def _files(name):
    """Return the FileDescriptorProtos that message `name` needs, dependencies first."""
    if name == _TIME:
        time = descriptor_pb2.FileDescriptorProto()
        timestamp_pb2.DESCRIPTOR.CopyToProto(time)
        return (time,)
    file, needs = _file(name)
    found: dict = {}
    for need in needs:
        found.update((f.name, f) for f in _files(need))
    return (*found.values(), file)


def schema(name: str) -> Any:
    """Return the FileDescriptorSet (bytes) of the well-known message `foxglove.<name>`."""
    return descriptor_pb2.FileDescriptorSet(file=_files(name)).SerializeToString(deterministic=True)


@cache
def message(name: str) -> Any:
    """Return the protobuf class of `foxglove.<name>`, in a pool of its own."""
    pool = descriptor_pool.DescriptorPool()
    for file in _files(name):
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(f"foxglove.{name}"))


# channels that every log has, so that viewers and scripts find them even when empty
TOPICS = {topic: (f"foxglove.{name}", partial(schema, name)) for topic, name in (
    ("/events", "Event"), ("/tf", "FrameTransforms"), ("/fix", "LocationFix"))}  # fmt: skip


def _time(ns):
    return {"seconds": ns // 1_000_000_000, "nanos": ns % 1_000_000_000}


def event(start_ns: Any, end_ns: Any, texts: dict) -> Any:
    """Return the bytes of a foxglove.Event from start_ns to end_ns (None: open) with `texts` {str: value}."""
    made = message("Event")(start_time=_time(start_ns))
    if end_ns is not None:
        made.end_time.seconds, made.end_time.nanos = divmod(end_ns, 1_000_000_000)
    for key, value in texts.items():
        made.metadata.add(key=key, value=str(value))
    return made.SerializeToString()


@dataclass
class Pose:
    """Give viewers the aircraft's place: /tf and /fix, every `every` ticks.

    The positions in the tick vector: lat, lon [rad], h [m], phi, theta, psi [rad]. Frames follow Foxglove: `map` is
    east, north, up from where the log begins (flat, EARTH_RADIUS); `aircraft` is forward, left, up.
    """

    lat: int
    lon: int
    h: int
    phi: int
    theta: int
    psi: int
    every: int = 20
    _origin: tuple | None = field(default=None, init=False)

    @property
    def index(self) -> tuple[int, int, int, int, int, int]:
        """Return the positions in the order in which `messages` takes the values."""
        return self.lat, self.lon, self.h, self.phi, self.theta, self.psi

    def messages(self, rows: Any, k0: int, dt_ns: int) -> list:
        """Return [(tick, topic, bytes)] of rows (n, 6) in the order of `index`, the first of tick k0."""
        out = []
        transforms, fix = self._messages
        frame = transforms.transforms[0]
        for i, (lat, lon, h, phi, theta, psi) in enumerate(rows.tolist()):
            if self._origin is None:
                self._origin = lat, lon
            lat0, lon0 = self._origin
            k = k0 + i * self.every
            for at in (frame.timestamp, fix.timestamp):
                at.seconds, at.nanos = divmod(k * dt_ns, 1_000_000_000)
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
        return message("FrameTransforms")(transforms=[frame]), message("LocationFix")(frame_id="aircraft")


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
