"""Mutations of the five papers' methods, drawn at random from their code, against the rows of `cosim reproduce`.

    python tests/helpers/mutants.py --seed 1 --each 8 -o FOLDER [--papers jay,lu17] [--list]

A site is a place in the syntax tree of METHODS: an operator, a sign, a factor, a term, an index, an argument, a
comparison, a transpose. Nobody chooses: `--seed` draws `--each` sites per paper. A mutant is the tree with
that one change; the rows of its paper are measured on it until a claim differs, the cheap ones (PLAIN) first, in plain
Python and one process. An error counts as noticed. FOLDER/mutants.jsonl holds what was changed and which row noticed.
"""

import argparse
import ast
import json
import os
import random
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
METHODS: dict[str, dict[str, set[str]]] = {  # paper -> file -> functions that are left out: checks of arguments, files,
    # lost samples, decisions and extensions that the paper does not have
    "lu17": {
        "actuators/hydraulic/lu17.py": set(),
        "fdi/hydraulic/two_stage_ekf.py": {"sane", "clear"},
        "fdi/hydraulic/rtsekf.py": {"decide", "name"},
    },
    "jay": {
        "actuators/ema/jay.py": {"_elevator", "values"},
        "fdi/ema/ema_kalman.py": set(),
        "fdi/ema/model.py": {"limits"},
    },
    "sun13": {
        "fdi/rfafe/core.py": {"airframe_usable"},
        "fdi/rfafe/discrete.py": set(),
        "fdi/rfafe/model.py": set(),
        "fdi/rfafe/synthesis.py": {"_shapes", "_matrix", "_columns", "_learning_rate", "_check", "_region", "holds"},
    },
    "mar10": {
        "fdi/control_redundancy/core.py": {"complete", "accelerometers", "vane", "learn", "_pitching"},
        "fdi/control_redundancy/structure.py": {"undefined", "name"},
    },
    "alwi14": {
        "fdi/lpv_smo/core.py": {"bank", "gust", "learn", "_distance", "_choose"},
        "fdi/lpv_smo/kernels.py": set(),
        "fdi/lpv_smo/model.py": {"modes"},
        "fdi/lpv_smo/synthesis.py": {"digest", "save", "load", "array", "_plain", "verify"},
    },
}
PLAIN = (
    "printed.filters", "printed.equation", "printed.constants", "printed.linearisation", "transcribed.", "rows.table",
    "rows.injected", "rows.matrices", "rows.settings", "rows.on_elevator", "rows.blamed", "rows.flight_form",
    "designs.law", "designs.lmis", "model.again",
)  # fmt: skip
SWAPS = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Lt: ast.GtE, ast.LtE: ast.Gt,
         ast.Gt: ast.LtE, ast.GtE: ast.Lt, ast.And: ast.Or, ast.Or: ast.And}  # fmt: skip
NAMES = {"sin": "cos", "cos": "sin", "min": "max", "max": "min"}


def sites(file: str, left_out: set[str]) -> list[tuple[int, int, int, int, str, str]]:
    """Return [(line, column, end line, end column, text that stands there instead, what it is)] of a file."""
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    found: list = []
    for node in tree.body:
        if isinstance(node, ast.ClassDef):
            for inner in node.body:
                if isinstance(inner, ast.FunctionDef) and inner.name not in left_out:
                    _inside(inner, found)
        if isinstance(node, ast.FunctionDef) and node.name not in left_out:
            _inside(node, found)
    return found


def _inside(function, found):
    for statement in function.body:
        _statement(statement, found)


def _statement(node, found):
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
        return  # a docstring
    if isinstance(node, ast.Raise | ast.Import | ast.ImportFrom | ast.Assert):
        return
    if isinstance(node, ast.If) and all(isinstance(n, ast.Raise) for n in node.body) and not node.orelse:
        return
    for field in ast.walk(node) if not hasattr(node, "body") else [n for n in ast.iter_child_nodes(node)
                                                                   if not isinstance(n, ast.stmt)]:  # fmt: skip
        for inner in ast.walk(field) if hasattr(node, "body") else [field]:
            _node(inner, found)
    for name in ("body", "orelse", "finalbody"):
        for inner in getattr(node, name, []):
            _statement(inner, found)
    for handler in getattr(node, "handlers", []):
        for inner in handler.body:
            _statement(inner, found)


def _node(node, found):
    def add(what, *made):
        for each in made:
            text = each if isinstance(each, str) else f"({ast.unparse(each)})"
            found.append((node.lineno, node.col_offset, node.end_lineno, node.end_col_offset, text, what))

    if isinstance(node, ast.BinOp) and not _words(node):
        if type(node.op) in SWAPS:
            add("operator", ast.BinOp(node.left, SWAPS[type(node.op)](), node.right))
        if isinstance(node.op, ast.Add | ast.Sub):
            add("term dropped", node.left, node.right)
        if isinstance(node.op, ast.Mult | ast.Div):
            add("factor dropped", node.left)
        if isinstance(node.op, ast.MatMult):
            add("factor 2", ast.BinOp(ast.Constant(2.0), ast.Mult(), node))
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        add("sign", node.operand)
    elif isinstance(node, ast.Constant) and isinstance(node.value, float) and abs(node.value) > 0.0:
        add("factor 2", repr(2.0 * node.value))
    elif isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in SWAPS:
        add("comparison", ast.Compare(node.left, [SWAPS[type(node.ops[0])]()], node.comparators))
    elif isinstance(node, ast.AugAssign) and type(node.op) in SWAPS:
        add("operator", ast.unparse(ast.AugAssign(node.target, SWAPS[type(node.op)](), node.value)), "pass")
    elif isinstance(node, ast.Subscript) and not isinstance(node.ctx, ast.Store):
        index = node.slice
        parts = index.elts if isinstance(index, ast.Tuple) else [index]
        if len(parts) == 2 and all(isinstance(p, ast.Name) for p in parts) and parts[0].id != parts[1].id:
            add("index", ast.unparse(ast.Subscript(node.value, ast.Tuple([parts[1], parts[0]]))))
        for i, p in enumerate(parts):
            if isinstance(p, ast.Constant) and isinstance(p.value, int):
                other = [*parts]
                other[i] = ast.Constant(p.value - 1 if p.value > 0 else 1)
                add("index", ast.unparse(ast.Subscript(node.value, ast.Tuple(other) if len(other) > 1 else other[0])))
    elif isinstance(node, ast.Call):
        for i in range(len(node.args) - 1):
            a, b = node.args[i : i + 2]
            if ast.dump(a) != ast.dump(b) and not any(isinstance(x, ast.Starred | ast.Constant) for x in (a, b)):
                args = [*node.args]
                args[i], args[i + 1] = b, a
                add("argument", ast.unparse(ast.Call(node.func, args, node.keywords)))
        if isinstance(node.func, ast.Name) and node.func.id in NAMES:
            add("operator", ast.unparse(ast.Call(ast.Name(NAMES[node.func.id]), node.args, node.keywords)))
        if isinstance(node.func, ast.Attribute) and node.func.attr in NAMES:
            other = ast.Attribute(node.func.value, NAMES[node.func.attr])
            add("operator", ast.unparse(ast.Call(other, node.args, node.keywords)))
    elif isinstance(node, ast.Attribute) and node.attr == "T" and isinstance(node.ctx, ast.Load):
        add("transpose", node.value)


def _words(node):
    return any((isinstance(n, ast.Constant) and isinstance(n.value, str)) or isinstance(n, ast.JoinedStr)
               for n in ast.walk(node))  # fmt: skip


def changed(file: str, site: tuple) -> tuple[str, str, str]:
    """Return (whole text of the mutant's file, what stood there, what stands there)."""
    line, column, last, end, text, _ = site
    lines = (ROOT / file).read_text(encoding="utf-8").splitlines(keepends=True)
    raw = [ln.encode() for ln in lines]
    begin = sum(map(len, raw[: line - 1])) + column
    stop = sum(map(len, raw[: last - 1])) + end
    whole = b"".join(raw)
    return (whole[:begin] + text.encode() + whole[stop:]).decode(), whole[begin:stop].decode(), text


CHILD = """
import json, sys
sys.path.insert(0, sys.argv[1])
import mutants
getattr(mutants, sys.argv[2])(json.loads(sys.stdin.read()))
"""


def child(what: str, asked: dict, tree: Path, **env: str) -> tuple[subprocess.CompletedProcess, list]:
    """Run a function of this file in a process of its own on the sources of `tree`; return what it prints, too."""
    run = subprocess.run([sys.executable, "-c", CHILD, str(Path(__file__).parent), what], input=json.dumps(asked),
                         env=os.environ | {"PYTHONPATH": str(tree)} | env, cwd=tree, capture_output=True, text=True,
                         timeout=7200)  # fmt: skip
    return run, [json.loads(line) for line in run.stdout.splitlines() if line.startswith("[")]


def compiled(asked: dict) -> None:
    """Print what the rows of a paper come to as they fly, the cheap ones by `cost` first."""
    from cosim.papers import claims

    rows = [p for p in claims.load(asked["paper"])
            if p.asks.rpartition(".")[2] != "step" and p.item not in asked["left_out"]]  # fmt: skip
    for told in measured(sorted(rows, key=lambda p: asked["cost"].get(p.item, 1.0)), asked["stop"]):
        print(json.dumps(told), flush=True)


def fly(paper: str, tree: Path, left_out: set, cost: dict, stop: bool = True) -> list[list]:
    """Return [[item, kind, verdict, number, time]] of the rows that were measured, until a claim differs."""
    run, out = child("compiled", {"paper": paper, "left_out": sorted(left_out), "stop": stop, "cost": cost}, tree)
    if run.returncode and not out:
        out.append(["(does not run)", "", "crash", run.stderr.strip().splitlines()[-1][:200] if run.stderr else "", 0])
    return out


def probe(asked: dict) -> None:
    """Print what the cheap rows of a paper say of each mutant, in this process: its function's code is put in place.

    `asked`: the paper, and {file, text, name} of each mutant. For plain Python only.
    """
    import importlib
    import signal

    from cosim.papers import broken, claims

    def late(*_):
        raise TimeoutError("half a minute of processor")

    signal.signal(signal.SIGVTALRM, late)
    for mutant in asked["mutants"]:
        module = importlib.import_module(mutant["file"].removesuffix(".py").replace("/", "."))
        owner, _, name = mutant["name"].rpartition(".")
        function = getattr(getattr(module, owner) if owner else module, name)
        broken.forget(asked["paper"])
        signal.setitimer(signal.ITIMER_VIRTUAL, 30.0)  # of processor
        with broken.coded(function, mutant["text"]):
            told = list(measured([p for p in claims.load(asked["paper"]) if p.asks.startswith(PLAIN)], True))
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        print(json.dumps([t[:4] for t in told if t[2] == "differs"]), flush=True)


def measured(rows: list, stop: bool) -> Iterator[list]:
    """Yield [item, kind, verdict, number, processor time] of rows, with `stop` until a claim differs; an error does."""
    for p in rows:
        begin = sum(os.times()[:4])
        try:
            row = p.judge()
            told = [p.item, p.kind, row.verdict, row.got, sum(os.times()[:4]) - begin]
        except Exception as e:
            told = [p.item, p.kind, "differs", f"{type(e).__name__}: {e}"[:200], 0.0]
        yield told
        if stop and told[2] == "differs" and p.kind == "claim":
            return


def _function(text: str, line: int) -> tuple[str, str]:
    """Return (name, source without decorators) of the function of a file's text that holds a line."""
    for node in ast.parse(text).body:
        inner = node.body if isinstance(node, ast.ClassDef) else [node]
        for f in inner:
            if isinstance(f, ast.FunctionDef) and f.lineno <= line <= (f.end_lineno or 0):
                f.decorator_list = []
                owner = f"{node.name}." if isinstance(node, ast.ClassDef) else ""
                return owner + f.name, ast.unparse(f)
    raise ValueError(f"no function at line {line}")


def judge(paper: str, tree: Path, base: dict) -> tuple[str, list]:
    """Return (outcome, rows that noticed): "claim", "other" (a row of another kind), "survived" or "crash"."""
    cost = {item: took for item, (_, took) in base.items()}
    before = {item for item, (verdict, _) in base.items() if verdict == "differs"}
    rows = fly(paper, tree, before, cost)
    seen = [r[:4] for r in rows if r[2] in ("differs", "crash")]
    if any(r[1] == "claim" for r in seen):
        return "claim", seen
    return ("crash" if any(r[2] == "crash" for r in seen) else "other" if seen else "survived"), seen


def main() -> None:
    """Draw, fly and write."""
    ask = argparse.ArgumentParser(description=__doc__)
    ask.add_argument("--seed", type=int, default=1)
    ask.add_argument("--each", type=int, default=8)
    ask.add_argument("--papers", default=",".join(METHODS))
    ask.add_argument("--plain", action="store_true", help="measure the cheap rows only")
    ask.add_argument("--list", action="store_true", help="show what is drawn, fly nothing")
    ask.add_argument("-o", dest="folder", type=Path, required=True)
    a = ask.parse_args()
    a.folder.mkdir(parents=True, exist_ok=True)
    tree = a.folder / "tree"
    shutil.rmtree(tree, ignore_errors=True)
    for part in ("actuators", "aircraft", "cosim", "fdi"):
        shutil.copytree(ROOT / part, tree / part, ignore=shutil.ignore_patterns("__pycache__"))
    with (a.folder / "mutants.jsonl").open("a", encoding="utf-8") as log:
        for paper in a.papers.split(","):
            drawn = _drawn(paper, a.seed, a.each)
            if a.list:
                for about in drawn:
                    print(json.dumps({k: about[k] for k in ("paper", "file", "line", "what", "was", "now")}))
                continue
            mutants = [dict(zip(("name", "text"), _function(d["text"], d["line"])), file=d["file"]) for d in drawn]
            run, told = child("probe", {"paper": paper, "mutants": mutants}, ROOT, NUMBA_DISABLE_JIT="1")
            if run.returncode:
                raise RuntimeError(f"{paper}: {run.stderr[-2000:]}")
            base: dict = {}
            for i, about in enumerate(drawn):
                seen = told[i] if i < len(told) else []
                outcome = "claim" if any(r[1] == "claim" for r in seen) else "other" if seen else "survived"
                if outcome != "claim" and not a.plain:
                    base = base or {r[0]: (r[2], r[4]) for r in fly(paper, tree, set(), {}, False)}
                    (tree / about["file"]).write_text(about["text"], encoding="utf-8")
                    try:
                        outcome, more = judge(paper, tree, base)
                    finally:
                        shutil.copy(ROOT / about["file"], tree / about["file"])
                    seen += more
                about = {k: v for k, v in about.items() if k != "text"} | {"outcome": outcome, "seen": seen[:5]}
                log.write(json.dumps(about) + "\n")
                log.flush()
                first, file = (seen[-1][0][:70] if seen else ""), about["file"].rpartition("/")[2]
                print(f"{paper:7s} {outcome:9s} {file}:{about['line']} {about['was']!r:.50} -> {about['now']!r:.50} "
                      f"{first}", flush=True)  # fmt: skip


def _drawn(paper: str, seed: int, each: int) -> list[dict]:
    """Return `each` mutants of a paper, by its seed: {paper, file, line, what, was, now, text of the file}."""
    every = [(file, s) for file, out in METHODS[paper].items() for s in sites(file, out)]
    random.Random(f"{seed} {paper}").shuffle(every)
    found: list[dict] = []
    for file, site in every:
        text, was, now = changed(file, site)
        try:
            ast.parse(text)
        except SyntaxError:
            continue
        about = {"paper": paper, "file": file, "line": site[0], "what": site[5]}
        found.append(about | {"was": was, "now": now, "text": text})
        if len(found) == each:
            break
    return found


if __name__ == "__main__":
    main()
