"""What the index, the citation and the workflow say of the package agrees with what the package is."""

import os
import re
import tomllib
from importlib.metadata import version

import pytest
import structure
import yaml

ROOT = structure.ROOT
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
WORKFLOW = yaml.safe_load((ROOT / ".github/workflows/check.yml").read_text(encoding="utf-8"))


def test_the_version_of_the_citation_is_that_of_the_package():
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert cited["version"] == PROJECT["version"] == version("cosim-fdi")
    assert cited["license"] == PROJECT["license"]
    assert [a["name"] for a in cited["authors"]] == [a["name"] for a in PROJECT["authors"]]


@pytest.mark.parametrize("name", structure.PACKAGES)
def test_type_hints_of_the_packages_are_published(name):
    assert (ROOT / name / "py.typed").is_file()


def test_the_workflow_runs_every_supported_python_on_three_systems():
    matrix = WORKFLOW["jobs"]["tests"]["strategy"]["matrix"]
    told = [c.rpartition(" ")[2] for c in PROJECT["classifiers"] if re.fullmatch(r".* 3\.\d+", c)]
    assert matrix["python"] == told and PROJECT["requires-python"] == f">={told[0]}"
    assert [name.partition("-")[0] for name in matrix["os"]] == ["ubuntu", "macos", "windows"]
    assert WORKFLOW["jobs"]["lowest"]["steps"][1]["with"]["python-version"] == told[0]


def test_the_workflow_runs_scripts_that_are_there_and_actions_by_their_digest():
    steps = [step for job in WORKFLOW["jobs"].values() for step in job["steps"]]
    scripts = {step["run"] for step in steps if "run" in step}
    assert scripts == {".ci/run", ".ci/lowest", ".ci/package"}
    assert all((ROOT / name).is_file() for name in scripts)
    assert os.name == "nt" or all(os.access(ROOT / name, os.X_OK) for name in scripts)
    assert all(re.fullmatch(r"[\w/-]+@[0-9a-f]{40}", step["uses"]) for step in steps if "uses" in step)


def test_every_dependency_has_a_lowest_and_a_highest_version():
    every = [*PROJECT["dependencies"], *(d for more in PROJECT["optional-dependencies"].values() for d in more)]
    assert [d for d in every if not d.startswith("cosim-fdi[") and not re.search(r">=[\d.]+,<[\d.]+$", d)] == []
