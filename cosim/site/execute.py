"""Run the code of a page in a fresh folder and put the outputs into it: `python execute.py PAGE.md FOLDER`.

Blocks run in order, Python in one namespace:

    ```sh                            its commands, one a line; behind "# exit status" that which is due, else 0
    ```python                        executed; what it prints, and the value of its last expression
    ```python title="x.py"           written to x.py (any language)
    ```python run="x.py"             written to x.py and run as a program; its names are there for the next blocks
    ```python figure="words"         executed; the figure that it draws with matplotlib, or that its last expression is,
                                     its code folded away

FOLDER gets the page, as its name says, and its figures. A command or block that fails ends with a message and status 1.
"""

import ast
import contextlib
import io
import os
import re
import runpy
import subprocess
import sys
import tempfile
import traceback
from pathlib import Path
from typing import Any

BLOCK = re.compile(r"^```(\w+)([^\n]*)\n(.*?)^```\n", re.S | re.M)
WIDTH = 80  # columns that a page shows without scrolling


def result(text: str) -> str:
    """Return an output as Markdown; "" for none."""
    text = re.sub(r"[^\n]*\r(?!\n)", "", text).rstrip()  # a line of progress leaves its last state
    return f'\n<div class="output" markdown>\n\n```text\n{text}\n```\n\n</div>\n' if text.strip() else ""


def shell(code: str) -> str:
    """Return what the command lines print; raises RuntimeError where one fails."""
    out = ""
    for line in code.strip().splitlines():
        done = subprocess.run(line, shell=True, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        if done.returncode != int(line.partition("# exit status ")[2] or 0):
            raise RuntimeError(f"{line}: exit status {done.returncode}\n{done.stdout}")
        out += done.stdout
    return out


def python(code: str, names: dict, where: str, value_shown: bool = True) -> str:
    """Return what the code prints and, with `value_shown`, the value of its last expression."""
    tree = ast.parse(code, where)
    last: Any = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        exec(compile(tree, where, "exec"), names)
        if last is not None:
            value = names["_"] = eval(compile(ast.Expression(last.value), where, "eval"), names)
            if value is not None and value_shown and not hasattr(value, "savefig"):
                print(value if hasattr(value, "to_string") else repr(value))
    return out.getvalue()


def program(name: str, names: dict) -> str:
    """Return what the program prints; its names join `names`."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        names.update(runpy.run_path(name, run_name="__main__"))
    return out.getvalue()


def drawn(words: str, folder: Path, stem: str, count: int, value: Any) -> str:
    """Save the figure that was drawn, or that `value` is, and return its Markdown; "" where there is none."""
    plt: Any = sys.modules.get("matplotlib.pyplot")
    given = value if hasattr(value, "savefig") else None
    if given is None and (plt is None or not plt.get_fignums()):
        return ""
    name = f"{stem}-{count}.svg"
    (given or plt.gcf()).savefig(folder / name, metadata={"Date": None})
    if plt is not None:
        plt.close("all")
    return f"\n![{words}]({name})\n"


def executed(text: str, folder: Path, stem: str) -> str:
    """Return the page with its outputs; figures go to `folder`."""
    names: dict = {"__name__": "__page__"}
    count = 0

    def one(match: re.Match) -> str:
        nonlocal count
        language, options, code = match[1], dict(re.findall(r'(\w+)="([^"]*)"', match[2])), match[3]
        block = f"```{language}" + (f' title="{options["title"]}"' if "title" in options else "") + f"\n{code}```\n"
        if "title" in options:
            Path(options["title"]).write_text(code, encoding="utf-8")
            return block
        if language == "sh":
            return block + result(shell(code))
        if language != "python":
            return block
        count += 1
        if "run" in options:
            Path(options["run"]).write_text(code, encoding="utf-8")
            said = program(options["run"], names)
        else:
            said = python(code, names, f"{stem}, block {count}", "figure" not in options)
        figure = drawn(options.get("figure", ""), folder, stem, count, names.pop("_", None))
        if "figure" not in options:
            return block + result(said) + figure
        if not figure:
            raise RuntimeError(f"block {count} draws no figure")
        folded = '??? note "Code of this figure"\n\n' + "".join(f"    {line}\n" for line in block.splitlines())
        return f"{figure}\n*{options['figure']}*\n\n{result(said)}\n{folded}"

    return BLOCK.sub(one, text)


def main() -> int:
    """Execute the page named on the command line."""
    page, folder = Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    os.environ |= {"COLUMNS": str(WIDTH), "NO_COLOR": "1", "MPLBACKEND": "svg", "PYTHONHASHSEED": "0", "TERM": "dumb"}
    os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    import matplotlib

    look: Any = {"svg.hashsalt": "site", "figure.figsize": (7.2, 3.4), "figure.constrained_layout.use": True,
            "font.size": 9, "axes.grid": True, "grid.alpha": 0.3, "lines.linewidth": 1.2}  # fmt: skip
    matplotlib.rcParams.update(look)
    with tempfile.TemporaryDirectory() as work:
        os.chdir(work)
        sys.path.insert(0, work)
        try:
            text = executed(page.read_text(encoding="utf-8"), folder, page.stem)
        except Exception as error:
            traceback.print_exc(limit=-3)
            print(f"{page.name}: {error}", file=sys.stderr)
            return 1
        finally:
            os.chdir(folder)
    (folder / page.name).write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
