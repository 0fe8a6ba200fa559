"""Hostile recordings of others: CSV and Parquet tables, MCAP files with schemas, messages and chunks that lie."""

import json
import struct
import zlib

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from google.protobuf import descriptor_pb2
from hostile_texts import encoded
from mcap.writer import CompressionType, Writer

ROWS = 400
MAP = (
    "rate_hz = 200\n[flight]\nmass_t = 200.0\ncg_pct = 30.0\naltitude_ft = 20000.0\ncas_kt = 290.0\n[signals]\n"
    'de_cmd = {{ channel = "{0}cmd", unit = "deg" }}\n"left_inner.surface" = {{ channel = "{0}surf", unit = "deg" }}\n'
)
CELLS = (
    "0",
    "-1",
    "1e308",
    "-1e308",
    "nan",
    "inf",
    "true",
    "[]",
    "",
    "-",
    "é",
    "1e400",
    "0.1",
    ";",
    '"',
    "\x00",
    "\t",
    "9" * 400,
    "1,5",
    "2020-01-01",
    "10:00:00",
    "NaT",
    "None",
    "x" * 20_000,
    '"a\nb"',
    "0x10",
    "1_0",
    "+-1",
    " 1 ",
    "1" * 20,
    "1e",
    "\ufeff",
    "١",
)
TYPES = (
    pa.float32(),
    pa.float16(),
    pa.int8(),
    pa.uint64(),
    pa.bool_(),
    pa.string(),
    pa.decimal128(30, 4),
    pa.binary(),
    pa.timestamp("ns"),
    pa.timestamp("ms", "Europe/Berlin"),
    pa.duration("us"),
    pa.date32(),
    pa.time64("ns"),
    pa.list_(pa.float64()),
    pa.struct([("a", pa.float64())]),
    pa.dictionary(pa.int32(), pa.string()),
    pa.null(),
)


def write_maps(folder):
    """Write the map of the tables and that of the MCAP files, whose channels are fields of /bus."""
    for name, prefix in (("map.toml", ""), ("bus.toml", "/bus.")):
        (folder / name).write_text(MAP.format(prefix))


def _columns():
    t = np.arange(ROWS) * 0.005
    return {"t_s": t, "cmd": np.sin(t * 4), "surf": np.cos(t * 4)}


def _lines():
    return ["t_s,cmd,surf", *(f"{t:.3f},{a:.4f},{b:.4f}" for t, a, b in zip(*_columns().values()))]


def write_whole(path):
    """Write a CSV without a fault."""
    path.write_text("\n".join(_lines()))


def csv(rng, folder):
    """Write a CSV with cells, rows, columns, quotes or encoding changed."""
    lines = _lines()
    for _ in range(rng.randint(1, 4)):
        k = rng.randrange(len(lines)) if rng.random() < 0.7 else 0
        cells = lines[k].split(",")
        cells[rng.randrange(len(cells))] = rng.choice(CELLS)
        told = ",".join(cells)
        lines[k] = rng.choice(
            [told, told, told, lines[0], "", lines[-1], ",,,,,,,", told + ",1,2", '"' + told, cells[0]]
        )
        what = rng.random()
        if what < 0.05:
            lines = [rng.choice((";", "\t", "|", ",,")).join(line.split(",")) for line in lines]
        elif what < 0.1:
            lines = [",".join([line] + [line.split(",")[-1]] * rng.choice((1, 3000))) for line in lines]
    if rng.random() < 0.1:
        lines = lines[: rng.randrange(5)]
    path = folder / "case.csv"
    path.write_bytes(encoded(rng, "\n".join(lines)))
    return path


def parquet(rng, folder):
    """Write a Parquet file with columns of other types, nulls, repeated or odd names, or damaged bytes."""
    columns = {name: pa.array(values) for name, values in _columns().items()}
    for _ in range(rng.choice((1, 1, 2))):
        name = rng.choice(list(columns))
        what = rng.random()
        if what < 0.6:
            columns[name] = _of(rng, rng.choice(TYPES))
        elif what < 0.7:
            columns[name] = pa.nulls(ROWS)
        elif what < 0.8:
            values = columns[name].to_pylist()
            values[rng.randrange(ROWS)] = None
            columns[name] = pa.array(values, columns[name].type)
        elif what < 0.9:
            columns[rng.choice(("", "x" * 5000, "é\n", "__index_level_0__", "T_S"))] = columns.pop(name)
        columns = columns or {"t_s": pa.nulls(ROWS)}
    table = pa.table(columns)
    if rng.random() < 0.1:
        table = pa.Table.from_arrays([*table.columns, table.column(0)], [*table.column_names, table.column_names[0]])
    if rng.random() < 0.1:
        about = rng.choice((b"{", b"null", b'{"index_columns": ["nope"], "columns": []}', b'{"index_columns": 3}'))
        table = table.replace_schema_metadata({b"pandas": about})
    if rng.random() < 0.1:
        table = table.slice(0, rng.choice((0, 1, 2)))
    path = folder / "case.parquet"
    pq.write_table(
        table, path, compression=rng.choice(("snappy", "zstd", "none", "gzip")), use_dictionary=rng.random() < 0.5
    )
    if rng.random() < 0.3:
        raw = bytearray(path.read_bytes())
        for _ in range(rng.choice((1, 3, 20))):
            raw[rng.randrange(len(raw))] = rng.randrange(256)
        path.write_bytes(raw[: rng.randrange(len(raw))] if rng.random() < 0.2 else raw)
    return path


def of(rng, rows):
    """Return a column of any type with `rows` values."""
    return pa.chunked_array([_of(rng, rng.choice(TYPES))]).slice(0, rows)


def _of(rng, kind):
    """Return ROWS values of an Arrow type."""
    if pa.types.is_list(kind):
        return pa.array([[0.1 * k] * rng.choice((0, 1, 2)) for k in range(ROWS)], kind)
    if pa.types.is_struct(kind):
        return pa.array([{"a": 0.1 * k} for k in range(ROWS)], kind)
    if pa.types.is_dictionary(kind) or pa.types.is_string(kind):
        return pa.array([rng.choice((str(0.005 * k), "x", None)) for k in range(ROWS)]).cast(kind)
    if pa.types.is_binary(kind):
        return pa.array([b"%d" % k for k in range(ROWS)], kind)
    if pa.types.is_null(kind):
        return pa.nulls(ROWS)
    ramp = pa.array(np.arange(ROWS) % 100)
    if pa.types.is_temporal(kind):
        wide = kind in (pa.date32(),)
        return ramp.cast(pa.int32() if wide else pa.int64()).cast(kind)
    return ramp.cast(kind)


VALUES = (
    0,
    1.5,
    -1e308,
    10**30,
    10**400,
    "x",
    "1e400",
    "NaN",
    "0.5",
    None,
    True,
    [],
    {},
    [1.0] * 5000,
    {"a": {"b": 1}},
    [[[[[1]]]]],
    "é" * 300,
    {f"k{i}": i for i in range(5000)},
)


def mcap(rng, folder):
    """Write an MCAP file of JSON and protobuf channels with values, schemas, times or bytes changed."""
    path = folder / "case.mcap"
    proto = rng.random() < 0.5
    compression = rng.choice((CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD))
    with path.open("wb") as file:
        writer = Writer(
            file, compression=compression, enable_crcs=rng.random() < 0.5, chunk_size=rng.choice((200, 1 << 20))
        )
        writer.start(profile=rng.choice(("", "ros1", "x")), library=rng.choice(("other", "", "cosim-log", "é")))
        name, encoding, data = (
            ("x.Bus", "protobuf", _descriptor(rng))
            if proto
            else ("bus", "jsonschema", rng.choice((b"{}", b"", b"\xff")))
        )
        schema = writer.register_schema(rng.choice((*[name] * 9, "nope")), rng.choice((*[encoding] * 9, "", "x")), data)
        kind = "protobuf" if proto else "json"
        topic = rng.choice((*["/bus"] * 20, "", "bus", "/bus.cmd", "x" * 5000))
        channel = writer.register_channel(topic, rng.choice((*[kind] * 9, "json", "protobuf", "cbor")), schema)
        odd_times, odd_messages = rng.choice((0, 0, 0.003)), rng.choice((0, 0, 0.002))
        odd = {rng.randrange(ROWS): rng.choice(VALUES) for _ in range(rng.choice((0, 1, 3)))}
        for k in range(ROWS):
            t = int(k * 5e6)
            if rng.random() < odd_times:
                t = rng.choice((0, 2**63 - 1, 2**64 - 1, 2**63, max(0, t - 10**8), t))
            message = _proto(k) if proto else _json(rng, k, odd)
            if rng.random() < odd_messages:
                message = rng.choice(
                    (b"", b"\xff" * 20, b"[" * 50_000, b"null", b"3", b'"x"', message[:-1], message * 2)
                )
            writer.add_message(channel, t, message, t)
        if rng.random() < 0.2:
            writer.add_attachment(0, 0, "x", "", b"y" * 100)
            writer.add_metadata("x" * 1000, {f"{i}": "" for i in range(1000)})
        writer.finish()
    if rng.random() < 0.4:
        raw = bytearray(path.read_bytes())
        for _ in range(rng.choice((1, 2, 5))):
            at, n = rng.randrange(len(raw)), rng.choice((1, 4, 8))
            raw[at : at + n] = rng.choice((rng.randbytes(n), b"\xff" * n, b"\0" * n))
        path.write_bytes(raw[: rng.randrange(len(raw))] if rng.random() < 0.2 else raw)
    elif rng.random() < 0.1:
        path.write_bytes(_bomb(rng))
    return path


def _json(rng, k, odd):
    message = {"cmd": float(np.sin(k / 50)), "surf": float(np.cos(k / 50))}
    if k in odd:
        message[rng.choice(("cmd", "surf", "more"))] = odd[k]
    return json.dumps(message).encode()


def _proto(k):
    return b"\x09" + struct.pack("<d", np.sin(k / 50)) + b"\x11" + struct.pack("<d", np.cos(k / 50))


def _descriptor(rng):
    """Return a FileDescriptorSet of x.Bus, often one that lies."""
    files = descriptor_pb2.FileDescriptorSet()
    file = files.file.add(
        name="bus.proto", package="x", syntax=rng.choice(("proto3", "proto3", "proto2", "editions", ""))
    )
    message = file.message_type.add(name="Bus")
    for number, name in enumerate(("cmd", "surf"), 1):
        message.field.add(name=name, number=number, type=1, label=1)
    what = rng.random()
    field = message.field[rng.randrange(2)]
    if what < 0.1:
        field.type = rng.randint(1, 18)
    elif what < 0.2:
        field.type, field.type_name = 11, rng.choice((".x.Bus", ".x.Nope", "Bus", ""))
    elif what < 0.3:
        field.number = rng.choice((0, -1, 1, 2, 19000, 2**29))
    elif what < 0.4:
        file.dependency.append(rng.choice(("bus.proto", "google/protobuf/timestamp.proto", "nope.proto")))
        files.file.add(name="nope.proto", dependency=["bus.proto"])
    elif what < 0.5:
        field.label = rng.choice((2, 3))
    elif what < 0.6:
        for i in range(3, rng.choice((30, 6000))):
            message.field.add(name=f"f{i}", number=i, type=rng.choice((1, 2, 5, 8, 9)), label=1)
    elif what < 0.65:
        return rng.randbytes(60)
    return files.SerializeToString()


def _bomb(rng):
    """Return an MCAP file of one chunk that holds far more than its bytes."""
    import zstandard

    size = rng.choice((200 << 20, 2 << 30, 1 << 40))
    packed = zstandard.ZstdCompressor(write_content_size=rng.random() < 0.5).compress(bytes(50 << 20))
    body = struct.pack("<QQQII", 0, 1, size, zlib.crc32(b""), 4) + b"zstd" + struct.pack("<Q", len(packed)) + packed
    head = b"\x89MCAP0\r\n" + struct.pack("<BQII", 1, 8, 0, 0)
    return head + struct.pack("<BQ", 6, len(body)) + body
