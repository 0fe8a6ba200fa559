"""Build the documentation site: `python cosim/site/build.py OUT`. Warnings of any step are errors.

Pages come from four places, and nothing is written twice: `pages/` (tutorials and theory, whose code is run and whose
outputs are put in), the READMEs of the repository where they lie, `cosim/examples` (run for the
gallery), and the docstrings of the public names. `[words](code:PATH#NAME)` in a page is a link to the definition of
NAME in that file of the repository; a file or name that is not there is an error.
"""

import argparse
import ast
import concurrent.futures
import hashlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path

import yaml
from pygments import highlight
from pygments.formatters import HtmlFormatter
from pygments.lexers import TextLexer, get_lexer_for_filename
from pygments.util import ClassNotFound

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
PACKAGES = ("cosim", "fdi", "actuators", "aircraft")
CACHE = ROOT / "build" / "site-cache"
LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s]+)\)")
CODE = re.compile(r"\]\(code:([^)#\s]+)(?:#(\w+))?\)")
PICTURES = {".svg", ".png", ".jpg"}


def mirrored() -> list[Path]:
    """Return the Markdown files of the repository that are pages of the site."""
    rooms = [p for name in PACKAGES for p in (ROOT / name).rglob("*.md") if HERE not in p.parents]
    more = [ROOT / "CHANGELOG.md", ROOT / "tests" / "README.md", *(ROOT / ".github").glob("*.md")]
    return sorted(p for p in [*rooms, *more] if p.parent.name != "templates")


def line_of(path: Path, name: str) -> int:
    """Return the line where `name` is defined in a Python file; raises LookupError where it is not."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and node.name == name:
            return node.lineno
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        if isinstance(node, ast.Assign | ast.AnnAssign) and any(getattr(t, "id", "") == name for t in targets):
            return node.lineno
    raise LookupError(f"{path.relative_to(ROOT)} defines no {name}")


def code_link(file: str, name: str | None) -> str:
    """Return the place on the site of a definition in the repository; raises LookupError where there is none."""
    path = ROOT / file
    if path.is_dir() and (path / "README.md").is_file():
        return f"{file.rstrip('/')}/README.md"
    if not path.is_file():
        raise LookupError(f"there is no {file} in the repository")
    return f"{file}.html" + (f"#L-{line_of(path, name)}" if name else "")


def write_code(docs: Path, file: str) -> None:
    """Write the page of a source file, with a number at each line."""
    out = docs / f"{file}.html"
    if out.exists():
        return
    text = (ROOT / file).read_text(encoding="utf-8", errors="replace")
    try:
        lexer = get_lexer_for_filename(file)
    except ClassNotFound:
        lexer = TextLexer()
    style = "body{background:#fff;font-size:13px}@media(prefers-color-scheme:dark){html{filter:invert(.92)}}"
    form = HtmlFormatter(full=True, title=file, linenos="inline", lineanchors="L", anchorlinenos=True, cssstyles="")
    out.parent.mkdir(parents=True, exist_ok=True)
    page = highlight(text, lexer, form).replace("<style", f"<style>{style}</style><style", 1)
    out.write_text(page, encoding="utf-8")


def placed(text: str, page: Path, source: Path, docs: Path) -> str:
    """Return `text` of `page` (in docs) with its links made those of the site; `source` is where it lies."""

    def one(match: re.Match) -> str:
        mark, words, target = match.groups()
        if target.startswith("code:"):
            found = CODE.match(f"]({target})")
            place = code_link(found[1], found[2])  # type: ignore[index]
            if ".html" in place:
                write_code(docs, place.partition(".html")[0])
            return f"[{words}]({os.path.relpath(docs / place, page.parent)})"
        if "://" in target or target.startswith(("#", "mailto:")) or HERE in source.parents:
            return match[0]
        name = target.partition("#")[0]
        path = (source.parent / name).resolve()
        if path.is_dir():
            return f"[{words}]({name.rstrip('/')}/README.md)" if (path / "README.md").is_file() else words
        if path == ROOT / "README.md":
            return f"[{words}]({os.path.relpath(docs / 'overview.md', page.parent)})"
        if path in mirrored():
            return match[0]
        if not path.is_file():
            raise LookupError(f"{source.relative_to(ROOT)}: {target} is not there")
        file = str(path.relative_to(ROOT))
        if path.suffix in PICTURES:
            (docs / file).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, docs / file)
            return f"{mark}[{words}]({os.path.relpath(docs / file, page.parent)})"
        write_code(docs, file)
        return f"[{words}]({os.path.relpath(docs / f'{file}.html', page.parent)})"

    return LINK.sub(one, text)


def mirror(docs: Path) -> None:
    """Copy the READMEs to the same places of the site."""
    for source in mirrored():
        page = docs / source.relative_to(ROOT)
        page.parent.mkdir(parents=True, exist_ok=True)
        text = source.read_text(encoding="utf-8").replace("<details>", '<details markdown="1">')
        if source.name == "GLOSSARY.md":  # its places are paths of the repository
            text = re.sub(r"`([\w/]+\.py)` \|$", r"[`\1`](code:\1) |", text, flags=re.M)
        page.write_text(placed(text, page, source, docs), encoding="utf-8")
    page, source = docs / "overview.md", ROOT / "README.md"
    page.write_text(placed(source.read_text(encoding="utf-8"), page, source, docs), encoding="utf-8")


def section(file: str, title: str) -> str:
    """Return the text below the heading `title` of a file in the repository; raises LookupError without it."""
    text = (ROOT / file).read_text(encoding="utf-8")
    found = re.search(rf"^## {re.escape(title)}\n(.*?)(?=^## |\Z)", text, re.S | re.M)
    if not found:
        raise LookupError(f"{file} has no section {title!r}")
    return found[1].strip()


def filled(text: str) -> str:
    """Return a page with `{{section FILE | TITLE}}`, `{{bibtex}}` and `{{platforms}}` filled in."""
    text = re.sub(r"\{\{section ([^|]+) \| ([^}]+)\}\}", lambda m: section(m[1], m[2]), text)
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    who = " and ".join(f"{{{a['name']}}}" for a in cited["authors"])
    entry = f"@software{{cosim_fdi,\n  author  = {{{who}}},\n  title   = {{{cited['title']}}},\n"
    entry += f"  version = {{{cited['version']}}},\n  license = {{{cited['license']}}}\n}}"
    flow = yaml.safe_load((ROOT / ".github/workflows/check.yml").read_text(encoding="utf-8"))
    matrix = flow["jobs"]["tests"]["strategy"]["matrix"]
    rows = [f"| {name} | {', '.join(matrix['python'])} |" for name in matrix["os"]]
    table = "\n".join(["| system | Python |", "|---|---|", *rows])
    return text.replace("{{bibtex}}", f"```bibtex\n{entry}\n```").replace("{{platforms}}", table)


def digest() -> str:
    """Return the digest of every source that an output of a page depends on, tools included."""
    found = hashlib.sha256(f"{sys.version} {version('matplotlib')} {version('numpy')}".encode())
    for name in PACKAGES:
        for path in sorted((ROOT / name).rglob("*")):
            own = HERE in path.parents and path.name not in ("execute.py", "gallery.py")
            if path.suffix in (".py", ".toml", ".json", ".xml", ".csv") and not own:
                found.update(str(path.relative_to(ROOT)).encode() + path.read_bytes())
    return found.hexdigest()


def execute(pages: list[tuple[str, str]], docs: Path, jobs: int) -> None:
    """Run the pages [(place, text)] and write them with their outputs; what has not changed comes from the cache."""
    base = digest()

    def one(place: str, text: str) -> str:
        kept = CACHE / hashlib.sha256(f"{base}{place}{text}".encode()).hexdigest()
        if not (kept / Path(place).name).is_file():
            with tempfile.TemporaryDirectory() as work:
                page = Path(work) / Path(place).name
                page.write_text(text, encoding="utf-8")
                command = [sys.executable, str(HERE / "execute.py"), str(page), str(Path(work) / "out")]
                done = subprocess.run(command, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
                if done.returncode:
                    raise RuntimeError(f"{place} does not run:\n{done.stdout}")
                shutil.rmtree(kept, ignore_errors=True)
                shutil.copytree(Path(work) / "out", kept)
        to = docs / Path(place).parent
        to.mkdir(parents=True, exist_ok=True)
        for file in kept.iterdir():
            shutil.copyfile(file, to / file.name)
        return place

    with concurrent.futures.ThreadPoolExecutor(jobs) as pool:
        for place in pool.map(lambda p: one(*p), pages):
            print(f"  {place}", flush=True)


def configured(docs: Path, out: Path, nav: dict[str, list]) -> str:
    """Return the text of mkdocs' settings, with the generated parts of `nav`."""
    text = (HERE / "mkdocs.yml").read_text(encoding="utf-8")
    for name, entries in nav.items():
        told = "".join(f"      - {entry}\n" for entry in entries)
        text = text.replace(f"  - {name}: []\n", f"  - {name}:\n{told}")
    paths = f"docs_dir: {docs}\nsite_dir: {out}\nhooks: [{HERE / 'hooks.py'}]\n"
    return paths + text.replace("        python:\n", f"        python:\n          paths: [{ROOT}]\n")


def main() -> int:
    """Build the site into the folder of the command line and check its links."""
    sys.path[:0] = [str(HERE), str(ROOT)]
    import api
    import gallery
    import links

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path, help="folder for the site")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="pages that run at once")
    given = parser.parse_args()
    out = given.out.resolve()
    with tempfile.TemporaryDirectory() as work:
        docs = Path(work) / "docs"
        docs.mkdir()
        own = sorted((HERE / "pages").rglob("*.md"))
        pages = [(str(p.relative_to(HERE / "pages")), filled(p.read_text(encoding="utf-8"))) for p in own]
        pages = [(place, placed(text, docs / place, HERE / "pages" / place, docs)) for place, text in pages]
        shutil.copytree(HERE / "pages" / "assets", docs / "assets")
        shutil.copyfile(files("ziamath") / "fonts" / "STIXTwoMath-Regular.ttf", docs / "assets" / "math.ttf")  # type: ignore
        shown = gallery.pages()
        run = [p for p in pages if p[0].startswith(("tutorials/", "theory/"))] + shown
        for place, text in pages:
            (docs / place).parent.mkdir(parents=True, exist_ok=True)
            (docs / place).write_text(text, encoding="utf-8")
        execute(run, docs, given.jobs)
        mirror(docs)
        (docs / "gallery" / "index.md").write_text(gallery.index(docs), encoding="utf-8")
        (docs / "api").mkdir()
        for name, text in api.pages().items():
            (docs / "api" / name).write_text(text, encoding="utf-8")
        readmes = [str(p.relative_to(ROOT)) for p in mirrored() if p.name == "README.md" and p.parts[-2] != "tests"]
        results = ("cosim/compare/", "cosim/papers/")
        rooms = [f"{Path(r).parent}: {r}" for r in readmes if not r.startswith(results)]
        nav = {"Gallery": ["gallery/index.md", *(place for place, _ in shown)],
               "Reference": ["Overview: overview.md", *(f"api/{n}" for n in api.pages()), *rooms]}  # fmt: skip
        settings = Path(work) / "mkdocs.yml"
        settings.write_text(configured(docs, out, nav), encoding="utf-8")
        os.environ["NO_MKDOCS_2_WARNING"] = "1"
        done = subprocess.run([sys.executable, "-m", "mkdocs", "build", "-q", "--strict", "-f", settings])
        if done.returncode:
            return done.returncode
    wrong = links.wrong(out)
    print("\n".join(wrong) or f"{out}: {len(list(out.rglob('*.html')))} pages, every link leads somewhere")
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
