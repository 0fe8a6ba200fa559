"""What the index and the citation say of the package agrees with what the package is."""

import re
import tomllib
from importlib.metadata import version

import pytest
import structure
import yaml

ROOT = structure.ROOT
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def test_the_version_of_the_citation_is_that_of_the_package():
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert cited["version"] == PROJECT["version"] == version("cosim-fdi")
    assert cited["license"] == PROJECT["license"]
    assert [a["name"] for a in cited["authors"]] == [a["name"] for a in PROJECT["authors"]]


@pytest.mark.parametrize("name", structure.PACKAGES)
def test_type_hints_of_the_packages_are_published(name):
    assert (ROOT / name / "py.typed").is_file()


def test_every_dependency_has_a_lowest_and_a_highest_version():
    every = [*PROJECT["dependencies"], *(d for more in PROJECT["optional-dependencies"].values() for d in more)]
    assert [d for d in every if not d.startswith("cosim-fdi[") and not re.search(r">=[\d.]+,<[\d.]+$", d)] == []
