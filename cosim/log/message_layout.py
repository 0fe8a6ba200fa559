"""Layout of the records of a chunk, to the byte (MCAP specification), shared by writer and kernels."""

import numpy as np

# a message record up to its payload (MCAP specification, Message): opcode 5, length, head of 22 bytes
HEAD = np.dtype(
    [("op", "u1"), ("length", "<u8"), ("channel", "<u2"), ("sequence", "<u4"), ("log", "<u8"), ("publish", "<u8")]
)
SEQUENCE, LOG_TIME, PUBLISH_TIME = 11, 15, 23  # bytes before these in a message: where it is stamped
# a MessageIndex record up to its entries: opcode 7, length, channel, bytes of entries; an entry is (log time, offset)
INDEX_HEAD = np.dtype([("op", "u1"), ("length", "<u8"), ("channel", "<u2"), ("bytes", "<u4")])
ABOUT = 11  # whole numbers that `gather` needs to know of a topic
STORE_HEAD, STORE_TARGET = 5, 7  # whole numbers that `store` needs to know, and of each rate
SHORT, MIDDLE = 15, 2047  # fields 1..15 have one-byte tags, to 2047 two bytes, later ones three
