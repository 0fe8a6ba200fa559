"""The documentation site: what its pages name is there; what does not run or leads nowhere is told."""

import os
import re
import subprocess
import sys
import tomllib

import pytest
import structure

ROOT = structure.ROOT
SITE = ROOT / "cosim" / "site"
PAGES = sorted((SITE / "pages").rglob("*.md"))
GLOSSARY = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in (ROOT / "cosim" / "GLOSSARY.md").read_text(encoding="utf-8").splitlines()
    if line.startswith("| ") and not line.startswith("| term ")
]


@pytest.fixture(scope="module")
def site():
    """The modules of the site, which are programs beside its settings and no package."""
    sys.path.insert(0, str(SITE))
    import api
    import build
    import execute
    import gallery
    import links

    sys.path.remove(str(SITE))
    return type("Site", (), {"api": api, "build": build, "execute": execute, "gallery": gallery, "links": links})


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_the_places_of_code_on_a_page_are_there(page, site):
    for file, name in site.build.CODE.findall(page.read_text(encoding="utf-8")):
        assert site.build.code_link(file, name or None)


def test_a_place_that_is_not_there_is_told(site):
    with pytest.raises(LookupError, match="defines no nothing"):
        site.build.code_link("cosim/flight/tick.py", "nothing")
    with pytest.raises(LookupError, match=r"no cosim/nowhere\.py"):
        site.build.code_link("cosim/nowhere.py", None)


def test_every_theory_page_has_equations_symbols_code_and_a_figure():
    theory = [p for p in PAGES if p.parent.name == "theory" and p.name != "index.md"]
    assert len(theory) == 12
    for page in theory:
        text = page.read_text(encoding="utf-8")
        assert text.count("$$") >= 4 and "| symbol | meaning" in text and "](code:" in text, page.name
        assert re.search(r"```python figure=", text), page.name


def test_the_navigation_names_every_page_that_is_written():
    named = set(re.findall(r"([\w/.-]+\.md)", (SITE / "mkdocs.yml").read_text(encoding="utf-8")))
    assert {str(p.relative_to(SITE / "pages")) for p in PAGES} <= named
    assert [n for n in named if not ((SITE / "pages" / n).is_file() or (ROOT / n).is_file())] == []


def test_every_example_has_a_figure(site):
    assert set(site.gallery.FIGURES) == {p.stem for p in (ROOT / "cosim" / "examples").glob("*.py")}
    assert len(site.gallery.pages()) == 13
    assert all('figure="' in text for _, text in site.gallery.pages())


def test_the_reference_has_every_public_name_and_what_it_returns(site):
    pages = site.api.pages()
    names = re.findall(r"^## ([\w.]+)", (ROOT / "cosim" / "API.md").read_text(encoding="utf-8"), re.M)
    assert [n for n in names if f"\n### {n}\n" not in pages["index.md"]] == []
    types = set(re.findall(r"^## (\w+)$", pages["types.md"], re.M))
    asked = {"Result", "Log", "LinearModel", "Comparison", "CampaignResult", "FlightPoint", "Replay", "Diagnosis"}
    assert asked <= types


def test_outputs_and_files_of_a_page_are_made(site, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page = '```text title="a.txt"\nfour\n```\n\n```sh\ncat a.txt\n```\n\n```python\nx = 2\nprint(x)\nx + 1\n```\n'
    text = site.execute.executed(page, tmp_path, "page")
    assert [m.strip() for m in re.findall(r"```text\n(.*?)```", text, re.S)] == ["four", "2\n3"]


@pytest.mark.parametrize("block", ["```sh\nexit 3\n```\n", "```python\n1 / 0\n```\n", '```python figure="f"\n1\n```\n'])
def test_a_block_that_fails_ends_the_build(block, site, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises((RuntimeError, ZeroDivisionError)):
        site.execute.executed(block, tmp_path, "page")


def test_links_that_lead_nowhere_and_loads_from_elsewhere_are_found(site, tmp_path):
    (tmp_path / "b.html").write_text('<p id="here">')
    good = '<a href="b.html#here"></a><a href="https://example.org">x</a><img src="b.html">'
    (tmp_path / "a.html").write_text(good)
    assert site.links.wrong(tmp_path) == []
    bad = '<a href="c.html"></a><a href="b.html#there"></a><script src="https://example.org/x.js"></script>'
    (tmp_path / "a.html").write_text(good + bad)
    assert len(site.links.wrong(tmp_path)) == 3


def test_the_page_of_installing_has_every_extra_and_installs_as_the_package_check_does():
    page = (ROOT / "cosim" / "site" / "pages" / "install.md").read_text(encoding="utf-8")
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    assert set(re.findall(r"^\| `(\w+)` \|", page, re.M)) == set(extras)
    checked = (ROOT / ".ci" / "package").read_text(encoding="utf-8")
    for line in ("pip install {}/cosim_fdi-*.whl", "cosim run"):
        assert f"$ .venv/bin/{line.format('DIR')}\n" in page
        assert line.format('"$to"').replace("pip install", 'pip" install -q') in checked


def test_code_that_a_page_shows_is_as_wide_as_its_column():
    """Longer lines scroll; the code of a figure is folded away, and an output has its own size."""
    wide = []
    for path in sorted((ROOT / "cosim" / "site" / "pages").rglob("*.md")):
        for head, code in re.findall(r"^```(\w[^\n]*)\n(.*?)^```$", path.read_text(encoding="utf-8"), re.S | re.M):
            wide += [f"{path.name}: {line}" for line in code.splitlines() if len(line) > 87 and "figure=" not in head]
    assert wide == []


def test_a_wheel_has_no_site():
    wheel = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["hatch"]["build"]["targets"]
    assert wheel["wheel"]["exclude"] == ["cosim/site"]


def test_the_glossary_is_in_order_and_its_places_are_there():
    terms = [[w.lower() for w in re.findall(r"\w+", row[0])] for row in GLOSSARY]
    assert terms == sorted(terms) and len(terms) > 70
    assert [row[3] for row in GLOSSARY if not (ROOT / row[3].strip("`")).is_file()] == []


def test_the_glossary_has_the_words_of_textbooks_and_of_messages():
    told = " ".join(f"{row[0]} {row[1]}" for row in GLOSSARY).lower()
    words = ("plug-in", "cache", "hysteresis", "GLR", "residual", "innovation", "OFC", "Kalman filter", "observer",
             "false alarm", "trim", "ROC", "POD", "FDI", "LMI", "anti-windup", "ambiguous", "runaway",
             "jam", "not valid", "not declared", "achieved", "stayed quiet", "departed", "effectiveness",
             "liquid")  # fmt: skip
    assert [w for w in words if w.lower() not in told] == []


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="the recipe is one of a shell")
def test_the_recipe_of_a_cluster_flies(tmp_path):
    """The four lines of the tutorial as they stand, on a free port, with a smaller campaign."""
    pytest.importorskip("distributed")
    import socket

    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    text = (SITE / "pages" / "tutorials" / "campaign.md").read_text(encoding="utf-8")
    lines = re.findall(r"^    (\S.*)$", text.partition("## On a cluster")[2], re.M)
    assert len(lines) == 4
    (tmp_path / "small.toml").write_text('base = "cruise"\nruns = 3\n[set]\nduration_s = 1.0\n')
    script = "\n".join(lines).replace("8786", str(port))
    code = f"trap 'kill $(jobs -p)' EXIT\n{script}\n"
    bin_ = os.path.dirname(sys.executable)
    done = subprocess.run(["bash", "-ec", code], cwd=tmp_path, text=True, timeout=300, stdin=subprocess.DEVNULL,
                          env={**os.environ, "PATH": f"{bin_}:{os.environ['PATH']}"},
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT)  # fmt: skip
    assert done.returncode == 0, done.stdout
    assert "3 were there already" in " ".join(done.stdout.split()), done.stdout
