"""Metadata, workflows and forms of the project agree with each other and with the code."""

import re
import tomllib
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
FORMS = sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("[!c]*.yml"))


def test_the_version_is_one():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    build = re.search(r"project\(vsr2 VERSION (\S+) ", (ROOT / "CMakeLists.txt").read_text())
    assert build
    assert PROJECT["project"]["version"] == build[1] == str(citation["version"])


def test_the_changelog_has_the_release_and_its_date():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    sections = re.findall(r"^## (.+)$", text, flags=re.MULTILINE)
    assert sections[0] == "Unreleased"
    assert sections[1] == f"{citation['version']} ({citation['date-released']})"


def test_the_licence_is_one():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    text = (ROOT / "LICENSE").read_text(encoding="utf-8")
    assert PROJECT["project"]["license"] == citation["license"] == "MIT"
    assert PROJECT["project"]["license-files"] == ["LICENSE"]
    assert text.startswith("MIT License")
    assert PROJECT["project"]["authors"][0]["name"] == citation["authors"][0]["name"]
    assert citation["authors"][0]["name"] in text


def test_wheels_are_built_for_the_interpreters_that_the_metadata_name():
    named = re.findall(r"Python :: (3\.\d+)'", str(PROJECT["project"]["classifiers"]))
    built = PROJECT["tool"]["cibuildwheel"]["build"]
    assert built == [f"cp{version.replace('.', '')}-*" for version in named]
    assert PROJECT["project"]["requires-python"] == f">={named[0]}"


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_workflows_run_scripts_that_exist(path):
    workflow = yaml.safe_load(path.read_text(encoding="utf-8"))
    assert workflow["permissions"] == {"contents": "read"}
    runs = [
        step["run"] for job in workflow["jobs"].values() for step in job["steps"] if "run" in step
    ]
    for named in re.findall(r"(?:\./)?((?:scripts|tests)/[\w/.*]+)", "\n".join(runs)):
        assert list(ROOT.glob(named)), named


def test_what_wheels_call_exists():
    text = str(PROJECT["tool"]["cibuildwheel"])
    named = re.findall(r"\{project\}/([\w/.]+)", text)
    assert len(named) == 4
    assert all((ROOT / name).exists() for name in named)


@pytest.mark.parametrize("path", FORMS, ids=lambda path: path.stem)
def test_forms_have_what_a_form_needs(path):
    form = yaml.safe_load(path.read_text(encoding="utf-8"))
    assert {"name", "description", "body"} <= set(form)
    kinds = [part["type"] for part in form["body"]]
    assert set(kinds) <= {"markdown", "textarea", "input", "dropdown", "checkboxes"}
    ids = [part["id"] for part in form["body"] if part["type"] != "markdown"]
    assert len(ids) == len(set(ids))
    assert all(part["attributes"] for part in form["body"])
    assert "markdown" not in kinds or kinds.index("markdown") == 0


def test_the_container_copies_what_exists_and_is_let_in():
    text = (ROOT / "Containerfile").read_text(encoding="utf-8")
    let_in = (ROOT / ".containerignore").read_text(encoding="utf-8").splitlines()
    copied = [line.split()[1:-1] for line in text.splitlines() if line.startswith("COPY ")]
    names = [name for names in copied for name in names if not name.startswith(("--from", "/"))]
    assert set(names) == {name[1:] for name in let_in if name.startswith("!")}
    assert all((ROOT / name).exists() for name in names)
