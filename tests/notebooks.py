"""Write the notebooks in cosim/notebooks from the examples: `python tests/notebooks.py`."""

import ast
import sys
from pathlib import Path

import nbformat
from nbformat import v4

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES, NOTEBOOKS = ROOT / "cosim" / "examples", ROOT / "cosim" / "notebooks"
MADE = ("fly_and_plot", "own_fault", "linear_model")


def notebook(name: str) -> str:
    """Return the notebook of example `name` as JSON text: its docstring as words, a cell per paragraph of code."""
    text = (EXAMPLES / f"{name}.py").read_text(encoding="utf-8")
    tree = ast.parse(text)
    lines = text.splitlines()
    cells = [v4.new_markdown_cell(f"# {name.replace('_', ' ')}\n\n{ast.get_docstring(tree)}")]
    for paragraph in paragraphs(lines[tree.body[0].end_lineno :]):
        cells.append(v4.new_code_cell(paragraph))
    for i, cell in enumerate(cells):
        cell["id"] = f"{name}-{i}"
    made = v4.new_notebook(cells=cells, metadata={"kernelspec": {"name": "python3", "display_name": "Python 3"}})
    return nbformat.writes(made) + "\n"


def paragraphs(lines: list[str]) -> list[str]:
    """Return the pieces of code between blank lines that are followed by a line without indentation."""
    out: list[list[str]] = [[]]
    for i, line in enumerate(lines):
        after = lines[i + 1] if i + 1 < len(lines) else ""
        if not line.strip() and out[-1] and after[:1] not in (" ", ")", "}", "]"):
            out.append([])
        elif line.strip() or out[-1]:
            out[-1].append(line)
    return ["\n".join(p).strip("\n") for p in out if "".join(p).strip()]


def main() -> None:
    """Write every notebook."""
    NOTEBOOKS.mkdir(exist_ok=True)
    for name in MADE:
        (NOTEBOOKS / f"{name}.ipynb").write_text(notebook(name), encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
