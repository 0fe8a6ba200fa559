"""Messages of MCAP files that others wrote, of any writer and in any order: protobuf, JSON, ROS 2."""

import json
import os
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from mcap.reader import NonSeekingReader
from mcap.records import Channel, Message, Schema
from mcap_protobuf.decoder import DecoderFactory
from zstandard import ZstdError

from .format import MAGIC
from .walker import BAD

BROKEN = (*BAD, RuntimeError, ZstdError)  # what is raised for bytes that are not what they should be
MOST_BYTES = 1 << 20  # of a message that is decoded: JSON makes objects of ten times that


class Sent(NamedTuple):
    """One message: its channel, its record, and what decodes its data, None where nothing here does."""

    channel: Channel
    record: Message
    decoder: Callable[[bytes], Any] | None

    def decoded(self) -> Any:
        """Return the message: a dict, or an object of protobuf or ROS 2. Raises ValueError for one too large."""
        if len(self.record.data) > MOST_BYTES:
            raise ValueError(f"a message of {len(self.record.data)} bytes, allowed: {MOST_BYTES}")
        return self.decoder(self.record.data) if self.decoder else None


class ForeignMcap:
    """The messages of an MCAP file in the order of the file; `cut` is True after one that ends early."""

    def __init__(self, path: str | os.PathLike):
        """Take the file at `path`."""
        self.path, self.cut = path, False

    def __iter__(self) -> Iterator[Sent]:
        """Yield every message up to the end of the file, or up to where it is cut.

        Checksums are checked where the file has them. Raises OSError, or ValueError for a damaged file.
        """
        decoders: dict[int, Any] = {}
        with open(self.path, "rb") as file:
            most = os.fstat(file.fileno()).st_size  # whatever length a record claims
            reader = NonSeekingReader(file, validate_crcs=True, record_size_limit=most)
            try:
                for schema, channel, record in reader.iter_messages(log_time_order=False):
                    if channel.id not in decoders:
                        decoders[channel.id] = _decoder(channel, schema)
                    yield Sent(channel, record, decoders[channel.id])
            except BROKEN as error:
                if file.read(1) or file.tell() <= len(MAGIC):
                    said = f"not a readable MCAP file: {str(error) or type(error).__name__}"
                    raise ValueError(said) from error
                self.cut = True


def _decoder(channel: Channel, schema: Schema | None) -> Callable[[bytes], Any] | None:
    """Return bytes -> message for a channel, or None when nothing here decodes it."""
    if channel.message_encoding == "json":
        return json.loads
    factory: Any = DecoderFactory()
    if channel.message_encoding == "cdr":
        try:
            from mcap_ros2.decoder import DecoderFactory as Ros2
        except ImportError:
            return None
        factory = Ros2()
    return factory.decoder_for(channel.message_encoding, schema)
