"""Pages that mkdocs-gen-files adds to the site: the repository's READMEs, and one per example with what it prints."""

import ast
import os
import re
from functools import partial
from importlib.resources import files
from pathlib import Path

import mkdocs_gen_files

ROOT = Path(__file__).resolve().parents[2]
SITE = ROOT / "cosim" / "site"
PAGES = {p: str(p.relative_to(ROOT)) for name in ("cosim", "fdi", "actuators", "aircraft")
         for p in (ROOT / name).rglob("README.md") if SITE not in p.parents and "templates" not in p.parts}  # fmt: skip
PAGES |= {ROOT / "README.md": "overview.md", ROOT / "CHANGELOG.md": "CHANGELOG.md"}
LINK = re.compile(r"!?\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s]+)\)")
RUN = 'exec="1" source="above" result="text"'


def link(match: re.Match, source: Path) -> str:
    """Return a link of a README for the site: to another page, a picture, or, to any other file, its words alone."""
    path = (source.parent / match[2].partition("#")[0]).resolve()
    page = PAGES.get(path / "README.md" if path.is_dir() else path)
    if "://" in match[2] or match[2].startswith("#"):
        return match[0]
    if page:
        return f"[{match[1]}]({os.path.relpath(page, Path(PAGES[source]).parent)})"
    if path.suffix not in (".png", ".svg"):
        return match[1]
    with mkdocs_gen_files.open(str(path.relative_to(ROOT)), "wb") as file:
        file.write(path.read_bytes())
    return match[0]


for source, page in PAGES.items():
    text = source.read_text(encoding="utf-8").replace("<details>", '<details markdown="1">')
    with mkdocs_gen_files.open(page, "w") as file:
        file.write(LINK.sub(partial(link, source=source), text))

for path in sorted((ROOT / "cosim" / "examples").glob("*.py")):
    code = path.read_text(encoding="utf-8")
    with mkdocs_gen_files.open(f"examples/{path.stem}.md", "w") as file:
        file.write(f"# {path.stem}\n\n{ast.get_docstring(ast.parse(code))}\n\n```python\n{code}```\n\n")
        file.write(f"```sh {RUN}\ncosim new example {path.stem} &&\npython {path.stem}.py\n```\n")

with mkdocs_gen_files.open("assets/math.ttf", "wb") as file:  # a browser without such a font misplaces indices
    file.write((files("ziamath") / "fonts" / "STIXTwoMath-Regular.ttf").read_bytes())
