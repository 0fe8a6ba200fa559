"""Elements of a JSBSim file as text: tables, functions, products and sums."""

from typing import Any


def table(lookups: Any, rows: Any, columns: Any, values: Any, indent: int = 8) -> Any:
    """Return a JSBSim table element; one-dimensional when columns is None."""
    pad = " " * indent
    lines = [f"{pad}<table>"]
    for role, name in zip(("row", "column"), lookups):
        lines.append(f'{pad}  <independentVar lookup="{role}"> {name} </independentVar>')
    lines.append(f"{pad}  <tableData>")
    if columns is not None:
        lines.append(pad + " " * 14 + "".join(f"{c:12.5f}" for c in columns))
        lines += [f"{pad}    {r:10.6f}" + "".join(f"{v:12.6f}" for v in row) for r, row in zip(rows, values)]
    else:
        lines += [f"{pad}    {r:10.6f}{v:14.6f}" for r, v in zip(rows, values)]
    return "\n".join([*lines, f"{pad}  </tableData>", f"{pad}</table>"])


def function(name: str, body: Any, comment: str | None = None) -> str:
    """Return a named function element around `body`."""
    note = f"\n      <description> {comment} </description>" if comment else ""
    return f'    <function name="{name}">{note}\n{body}\n    </function>'


def product(*parts: Any, indent: int = 6) -> str:
    """Return a product of properties (str), numbers and ready elements."""
    return _operation("product", parts, indent)


def total(*parts: Any, indent: int = 6) -> str:
    """Return a sum of properties (str), numbers and ready elements."""
    return _operation("sum", parts, indent)


def _operation(kind, parts, indent):
    pad = " " * indent
    lines = []
    for part in parts:
        if isinstance(part, str) and "<" in part:
            lines.append(part)
        elif isinstance(part, str):
            lines.append(f"{pad}  <p> {part} </p>")
        else:
            lines.append(f"{pad}  <v> {part:.8g} </v>")
    return "\n".join([f"{pad}<{kind}>", *lines, f"{pad}</{kind}>"])
