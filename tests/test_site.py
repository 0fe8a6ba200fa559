"""The documentation site: its pages are complete, and named in the navigation. `.ci/site` runs their code."""

import re
import tomllib

import pytest
import structure

ROOT = structure.ROOT
SITE = ROOT / "cosim" / "site"
PAGES = sorted((SITE / "pages").rglob("*.md"))
THEORY = [p for p in PAGES if p.parent.name == "theory" and p.name != "index.md"]


@pytest.mark.parametrize("page", THEORY, ids=lambda p: p.stem)
def test_a_theory_page_has_equations_symbols_code_and_a_figure(page):
    text = page.read_text(encoding="utf-8")
    assert text.count("$$") >= 4 and "| symbol | meaning" in text and "plots.html(" in text
    files = re.findall(r"\(`([\w/.]+)`\)", text)
    assert files and [f for f in files if not (ROOT / f).exists()] == []


def test_the_navigation_names_every_page_and_example_and_only_those():
    named = set(re.findall(r"([\w/.-]+\.md)", (SITE / "mkdocs.yml").read_text(encoding="utf-8"))) - {"overview.md"}
    examples = {f"examples/{p.stem}.md" for p in (ROOT / "cosim" / "examples").glob("*.py")}
    assert {str(p.relative_to(SITE / "pages")) for p in PAGES} | examples <= named
    assert [n for n in named - examples if not ((SITE / "pages" / n).is_file() or (ROOT / n).is_file())] == []


def test_the_page_of_installing_has_every_extra_and_installs_as_the_package_check_does():
    page = (SITE / "pages" / "install.md").read_text(encoding="utf-8")
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    assert set(re.findall(r"^\| `(\w+)` \|", page, re.M)) == set(extras)
    checked = (ROOT / ".ci" / "package").read_text(encoding="utf-8")
    for line in ("pip install {}/cosim_fdi-*.whl", "cosim run"):
        assert f"$ .venv/bin/{line.format('DIR')}\n" in page
        assert line.format('"$to"').replace("pip install", 'pip" install -q') in checked
