"""How the source is built: what tests/structure.py counts keeps within its bounds."""

import ast
import re

import structure


def test_rooms_are_few_and_imports_run_downwards():
    found = structure.counts()
    assert found["rooms of cosim"] <= 12 and found["loose modules of cosim"] <= 8
    assert found["floors"] <= 12


def test_every_public_function_says_what_it_does():
    assert structure.undocumented() == []


def test_every_public_function_has_type_hints():
    assert structure.unhinted() == []


def test_a_function_without_hints_would_be_found():
    bare, whole = ast.parse("def f(a, b: int = 1): ...\ndef g(a: int) -> None: ...").body
    assert structure.bare_arguments(bare) == ["a", "return"] and structure.bare_arguments(whole) == []


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


def test_imports_inside_cosim_run_downwards():
    assert structure.back_arrows() == []
