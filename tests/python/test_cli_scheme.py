"""One scheme of names over all verbs; docs/reference/command_line.md states its rules."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from cyclopts import App

from vsr2.cli.main import app, main

REPLACES_NOTHING = {"blind make", "blind diagnose", "blind score"}
"""A pack is made, diagnosed and scored once."""
GOES_ON = {
    *("run", "calibrate", "fragility", "diagnose"),
    *("campaign simulate", "campaign causes", "campaign predict", "blind make"),
    "blind diagnose",
}
"""Verbs that keep unfinished work."""
READS_A_STUDY = {
    *("run", "calibrate", "fragility", "diagnose", "config check", "blind make"),
    *("campaign simulate", "campaign compare", "campaign causes", "campaign predict"),
    "config time-step",
}
SIMULATES = {*GOES_ON, "campaign compare", "config time-step"} - {"blind make"}
"""In threads of the core; the engines of packs are asked one trial at a time."""


def leaves(room: App = app, path: tuple[str, ...] = ()) -> Iterator[tuple[str, App]]:
    """All verbs that do something, with the words that call them."""
    inner = [name for name in room if not name.startswith("-")]
    if not inner:
        yield " ".join(path), room
    for name in inner:
        yield from leaves(room[name], (*path, name))


OPTIONS: dict[str, set[str]] = {}
POSITIONAL: dict[str, set[str]] = {}
for _name, _verb in leaves():
    _names = {one.name for one in _verb.assemble_argument_collection()}
    OPTIONS[_name] = {name for name in _names if name.startswith("--")}
    POSITIONAL[_name] = {name for name in _names if not name.startswith("-")} - {"*"}
WRITES = {verb for verb, options in OPTIONS.items() if "--out" in options}


def taking(option: str) -> set[str]:
    return {verb for verb, options in OPTIONS.items() if option in options}


def test_what_is_written_is_named_by_out_and_by_no_position() -> None:
    assert {
        *GOES_ON,
        *("new", "view", "campaign import-lab", "blind score", "config import-ros2"),
        *("motion convert", "motion generate", "motion fuse", "motion rotate"),
    } == WRITES
    read = {
        *("TEMPLATE", "STUDY", "SCENE", "FOLDER", "CAMPAIGN", "RESULT", "MESH", "FILES", "SOURCE"),
        *("FIRST", "SECOND", "FRAGILITY", "CURVE", "NAME", "WHAT", "KIND"),
        *("DATA", "KEY", "DIAGNOSES"),
    }
    assert set().union(*POSITIONAL.values()) == read


@pytest.mark.parametrize(
    ("option", "verbs"),
    [
        ("--quiet", WRITES),
        ("--overwrite", WRITES - REPLACES_NOTHING),
        ("--resume", GOES_ON),
        ("--set", READS_A_STUDY),
        ("--threads", SIMULATES),
        ("--scheduler", SIMULATES & WRITES),
        ("--exclude", {"diagnose", "campaign causes"}),
        ("--one-contact-model", {"campaign causes"}),
    ],
)
def test_a_name_is_on_all_verbs_that_it_applies_to(option: str, verbs: set[str]) -> None:
    assert taking(option) == verbs


def test_every_verb_takes_v_and_effects() -> None:
    names = {name for one in app.meta.assemble_argument_collection() for name in one.names}
    assert {"--verbose", "-v", "--effects"} <= names


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("campaign simulate s.yaml made", "`vsr2 campaign simulate ... --out made`"),
        ("motion convert a.csv b.csv", "`vsr2 motion convert ... --out b.csv`"),
        ("motion rotate a.csv b.csv c", "`vsr2 motion rotate ... --out c`"),
        ("new block mine.yaml", "`vsr2 new ... --out mine.yaml`"),
        ("run study.yaml made", "`vsr2 run ... --out made`"),
        ("view made --html a.html", "--html is --out: `vsr2 view ... --out FILE.html`"),
    ],
)
def test_the_old_form_is_refused_with_the_new_one(
    line: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(line.split()) == 2
    assert said in capsys.readouterr().err


def test_nothing_is_replaced_unasked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "made.csv"
    target.write_text("mine")
    line = ["motion", "generate", "--pga-g", "0.3", "--pgv-pga-s", "0.1", "--duration", "5"]
    line += ["--out", str(target)]
    assert main(line) == 2
    assert f"{target}: exists; choose another --out, or add --overwrite" in capsys.readouterr().err
    assert target.read_text() == "mine"
    assert main([*line, "--overwrite", "--quiet"]) == 0
    assert capsys.readouterr().out == ""
    assert target.read_text() != "mine"
