"""How the source is built: what tests/structure.py counts keeps within its bounds."""

import pydoc
import re

import structure

import cosim
import fdi


def test_every_public_function_has_type_hints():
    assert structure.unhinted() == []


def test_help_shows_the_public_names_with_their_signatures():
    shown = pydoc.plain(pydoc.render_doc(cosim))
    assert "load_scenario(name_or_path" in shown and "class Flight" in shown and "Raises TrimError" in shown
    assert "module(name: str)" in pydoc.plain(pydoc.render_doc(fdi))


# documents that are not in the repository, and talk among those who write it
ELSEWHERE = re.compile(r"\bDESIGN(\.md| section)\b|\bnotes/\w|\bpapers/README[^.]|\b[Ii]ssue #?\d|\b(TODO|FIXME)\b")


def test_nothing_refers_to_what_is_not_in_the_repository():
    folders = (*structure.PACKAGES, "aircraft", "tests", ".github")
    every = (p for name in folders for p in (structure.ROOT / name).rglob("*"))
    files = [p for p in every if p.suffix in (".py", ".md", ".toml", ".xml")]
    found = []
    for path in [*files, structure.ROOT / "README.md", structure.ROOT / "CHANGELOG.md"]:
        if path.name != "test_structure.py":
            lines = path.read_text(encoding="utf-8").splitlines()
            found += [f"{path}:{i + 1}: {line}" for i, line in enumerate(lines) if ELSEWHERE.search(line)]
    assert found == []


def test_no_module_imports_one_that_imports_it():
    assert structure.cycle() == []
