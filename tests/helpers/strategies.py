"""Hostile files, a hypothesis strategy per format of ours: texts (TOML), recordings.

Trees are changed node by node and written anew, so that most cases are well formed and reach far; the rest is spliced
as text or bytes.
"""

import json
import tomllib

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from flight_point import POINT
from hypothesis import strategies as st
from mcap.writer import Writer

ROWS = 200
MAP = (
    f"rate_hz = 200\n{POINT}[signals]\n"
    'de_cmd = {{ channel = "{0}cmd", unit = "deg" }}\n"left_inner.surface" = {{ channel = "{0}surf", unit = "deg" }}\n'
)
WORDS = ("iotsekf", "ofc_monitor", "elevator.left_inner", "elevator", "aircraft", "all", "jam", "ofc_liquid", "none",
         "", "light", "cruise", "ema", "hydraulic", "fault.0.active", "n_z > 1.2", "/sensors/left_inner", "rod", "../x",
         ".", "/dev/zero", "[bold]", "\x1b[2J", "x" * 3000, "\u202e", "\ufeff", "deg", "m", "left_inner")  # fmt: skip
NUMBERS = st.one_of(
    st.integers(-3, 40), st.sampled_from([2**31, 2**63 - 1, -(2**63), 36000, 2000, 10**30]), st.floats(width=64),
    st.sampled_from([0.0, -0.0, 1e-320, 1e308, float("nan"), float("inf"), float("-inf"), 0.5, -1.0]))  # fmt: skip
LEAVES = st.one_of(NUMBERS, st.booleans(), st.sampled_from(WORDS), st.text(max_size=8))
DEEPER = lambda v: st.lists(v, max_size=4) | st.dictionaries(st.sampled_from(WORDS), v, max_size=3)  # noqa: E731
VALUES = st.recursive(LEAVES, DEEPER, max_leaves=8)
JSON = VALUES.map(lambda v: json.dumps(v, default=str))
RAW = st.binary(max_size=60)


def write_maps(folder):
    """Write the map of tables and that of MCAP files, whose channels are fields of /bus."""
    for name, prefix in (("map.toml", ""), ("bus.toml", "/bus.")):
        (folder / name).write_text(MAP.format(prefix))


def write_whole(path):
    """Write a CSV without a fault."""
    t = [k * 0.005 for k in range(2 * ROWS)]
    path.write_text("\n".join(["t_s,cmd,surf", *(f"{x:.3f},{np.sin(4 * x):.4f},{np.cos(4 * x):.4f}" for x in t)]))


def _places(node, found):
    """Return (container, key) of every node of a tree of dicts and lists."""
    for key in list(node) if isinstance(node, dict) else range(len(node)):
        found.append((node, key))
        if isinstance(node[key], dict | list):
            _places(node[key], found)
    return found


@st.composite
def trees(draw, tree, times=3):
    """Change `tree` (dicts and lists) in place at one or a few nodes, and return it."""
    for _ in range(draw(st.integers(1, times))):
        places = _places(tree, [])
        if not places:
            break
        node, key = draw(st.sampled_from(places))
        what = draw(st.integers(0, 9))
        if what < 4 and isinstance(node[key], int | float) and not isinstance(node[key], bool):
            node[key] *= draw(st.sampled_from([0, -1, 2, 0.5, 1.001, 10, 1e6]))
        elif what < 6:
            node[key] = draw(VALUES)
        elif what == 6:
            del node[key]
        elif what == 7:  # something of elsewhere
            other, at = draw(st.sampled_from(places))
            node[key] = json.loads(json.dumps(other[at], default=str)) if at in _keys(other) else None
        elif what == 8 and isinstance(node, dict):
            node[draw(st.sampled_from([*WORDS, *(str(k) for _, k in places)]))] = node.pop(key)
        else:
            node[key] = [node[key]] * draw(st.sampled_from([0, 1, 2, 300]))
    return tree


def _keys(node):
    return node if isinstance(node, dict) else range(len(node))


def toml(value):
    """Return a value as TOML, a table within another one inline."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(str(k))} = {toml(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml, value)) + "]"
    if value is None or isinstance(value, bool | str):
        return json.dumps(value) if value is not None else '""'
    return repr(value) if isinstance(value, int | float) else f'"{value}"'


@st.composite
def spliced(draw, raw):
    """Return bytes with a piece of them gone, doubled or replaced, mostly as they are."""
    if draw(st.integers(0, 9)) < 7 or not raw:
        return raw
    a = draw(st.integers(0, len(raw)))
    b = min(len(raw), a + draw(st.sampled_from([0, 1, 8, 200, len(raw)])))
    return raw[:a] + draw(st.one_of(RAW, st.just(b""), st.just(raw[a:b] * 2), st.just(b"[" * 5000))) + raw[b:]


@st.composite
def texts(draw, originals):
    """Return a hostile TOML file made of one of `originals` (str)."""
    tree = draw(trees(tomllib.loads(draw(st.sampled_from(originals)))))
    text = "\n".join(f"{json.dumps(str(k))} = {toml(v)}" for k, v in tree.items())
    code = draw(st.sampled_from(["utf-8"] * 12 + ["utf-16", "utf-8-sig", "cp500"]))
    return draw(spliced(text.encode(code, "replace")))


COLUMNS = st.one_of(
    st.lists(st.one_of(st.none(), NUMBERS), min_size=1, max_size=5),
    st.lists(st.sampled_from(WORDS), min_size=1, max_size=4),
    st.lists(st.booleans(), min_size=1, max_size=3), st.lists(st.datetimes(), min_size=1, max_size=3),
    st.lists(st.lists(NUMBERS, max_size=2), min_size=1, max_size=3))  # fmt: skip


@st.composite
def recordings(draw, folder):
    """Write a recording of others into `folder`; return (its path, the name of its map)."""
    t = np.arange(ROWS) * 0.005
    table: dict = {"t_s": t.tolist(), "cmd": np.sin(4 * t).tolist(), "surf": np.cos(4 * t).tolist()}
    for _ in range(draw(st.integers(0, 3))):
        name, some = draw(st.sampled_from([*table, "more", "t_s"])), draw(COLUMNS)
        if draw(st.booleans()):  # all of it, or some cells
            table[name] = (some * ROWS)[:ROWS]
        else:
            column = list(table.get(name, t.tolist()))
            at = draw(st.integers(0, ROWS - 1))
            column[at : at + len(some)] = some
            table[name] = column[:ROWS]
    kind = draw(st.sampled_from(["csv", "parquet", "mcap"]))
    path = folder / f"rec.{kind}"
    if kind == "parquet":
        columns = {}
        for name, column in table.items():
            try:
                columns[name] = pa.array(column)
            except (pa.ArrowException, OverflowError):
                columns[name] = pa.array([str(v) for v in column])
        pq.write_table(pa.table(columns), path, compression=draw(st.sampled_from(["snappy", "zstd", "none"])))
    elif kind == "csv":
        cut = draw(st.sampled_from([",", ",", ";", "\t"]))
        mark = draw(st.sampled_from([".", ".", ","]))
        rows = (cut.join("" if v is None else str(v).replace(".", mark) for v in row) for row in zip(*table.values()))
        lines = [cut.join(table), *rows]
        path.write_bytes("\n".join(lines[draw(st.integers(0, 1)) :]).encode("utf-8", "replace"))
    else:
        with path.open("wb") as file:
            writer = Writer(file)
            writer.start()
            coded = draw(st.sampled_from(["jsonschema"] * 5 + ["protobuf", ""]))
            schema = writer.register_schema("x.Bus", coded, b"{}")
            channel = writer.register_channel(draw(st.sampled_from(["/bus"] * 5 + ["bus", ""])), "json", schema)
            for k, row in enumerate(zip(*table.values())):
                at = draw(st.sampled_from([0, 2**63, 5])) if k == 7 and draw(st.booleans()) else int(k * 5e6)
                writer.add_message(channel, at, json.dumps(dict(zip(table, row)), default=str).encode(), at)
            writer.finish()
    path.write_bytes(draw(spliced(path.read_bytes())))
    return path, "bus.toml" if kind == "mcap" else "map.toml"
