"""Sentences about results stand in `report/messages` and its templates: docs/architecture.md."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[2] / "python" / "vsr2"
VALUED, PLAIN = 3, 5
"""Words that make a sentence of a text with values in it, and of one without."""
FAULT = re.compile(
    r"(Error|Exception|warn|debug|info|warning|exception|problems?\.add|found\.add|refuse|Problem"
    r"|real_argument|checked_seed)$"
)
"""Calls whose text ends in an error, a warning or the log."""
LABEL = re.compile(r"set_[xyz]?label$")
"""Calls that label a figure; elsewhere the argument `label` does."""
NO_RESULTS = ("report/messages/", "config/")
"""Rooms that word results, or hold none: the keys of a study and what is wrong with them."""
ELSEWHERE = {
    "argument_names.py:": "faults of a call",
    "blind/custodian/measurements.py:Measurements": "a name in the journal of a pack",
    "blind/custodian/steps.py:": "faults of a pack's steps",
    "blind/form/": "faults of a pack's file",
    "blind/mujoco/model.py:": "a scene in MuJoCo's XML",
    "calibration/calibration_study.py:calibration_schema": "meaning of a key",
    "calibration/evaluation_store.py:_KIND": "faults of a store",
    "campaign/array_files.py:": "faults of a campaign's file",
    "campaign/campaign.py:trial_faults": "faults of a campaign's trials",
    "campaign/description.py:": "meaning of a file's keys",
    "campaign/faults.py:": "faults of names and numbers",
    "campaign/file_problems.py:": "faults of a campaign's files",
    "campaign/laboratory.py:": "description of a laboratory's data, and faults of its table",
    "campaign/trials_table.py:": "faults of a campaign's table",
    "cli/": "help of a verb, and the note in a file of a motion",
    "ensemble/simulated/cache.py:_KIND": "faults of a store",
    "ensemble/simulated/contact_family.py:": "meaning of a nuisance",
    "ensemble/simulated/distributions.py:REMEDIES": "what to do about an error",
    "ensemble/simulated/motion_noise.py:": "meaning of a nuisance",
    "effects/": "meaning of an effect, and a motion's description of what changed it",
    "motion/": "a motion's description: what it was made of, as its files carry it",
    "near_words.py:": "remedies of a mistyped word",
    "report/fragility_page.py:surface_figure": "label of a colour bar",
    "results/atomic.py:_REMEDY": "a remedy",
    "results/journal.py:_KIND": "faults of a store",
    "results/result.py:_columns": "meaning of a column",
    "results/store.py:_reason": "faults of a record",
    "results/trial_log.py:DERIVED": "meaning of a quantity",
    "scene/mesh_files.py:bytes_of": "a remedy",
    "scene/mesh_repair.py:": "a remedy",
    "scene/notes.py:WARNINGS": "templates of warnings",
    "simulation/distributed.py:": "a trial's message, of an exception",
    "simulation/effect_checks.py:EffectChecker": "where an error arose",
    "simulation/native_scenes.py:FAST_REFUSALS": "faults of a scene",
    "simulation/shards.py:merge_shards": "faults of shards",
    "trial/trial.py:_FIELDS": "a remedy",
    "view/": "labels of the page that replays a trial",
}
"""Texts that become part of an error elsewhere, describe an input, or say what a name means: by
module and statement at its top, or by what they begin with."""


def template(node: ast.AST) -> tuple[str, int] | None:
    """A text and the words that make it a sentence; None: the node is none."""
    match node:
        case ast.JoinedStr():
            parts = [v.value if isinstance(v, ast.Constant) else "{}" for v in node.values]
            return "".join(map(str, parts)), VALUED
        case ast.Call(func=ast.Attribute(value=ast.Constant(value=str(text)), attr="format")):
            return text, VALUED
        case ast.BinOp(left=ast.Constant(value=str(text)), op=ast.Mod()):
            return text, VALUED
        case ast.Constant(value=str(text)):
            return text, PLAIN
    return None


def on_the_way_to_a_fault(tree: ast.AST) -> set[int]:
    """Nodes below a raise or a call that words a fault, and what is assigned to a name in one."""
    faults = [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.Raise)
        or (isinstance(node, ast.Call) and FAULT.search(ast.unparse(node.func)))
    ]
    inside = {id(child) for fault in faults for child in ast.walk(fault)}
    for function in ast.walk(tree):
        if not isinstance(function, ast.FunctionDef):
            continue
        nodes = list(ast.walk(function))
        used = {n.id for n in nodes if isinstance(n, ast.Name) and id(n) in inside}
        for node in nodes:
            if isinstance(node, ast.Assign | ast.AugAssign):
                targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                names = {n.id for one in targets for n in ast.walk(one) if isinstance(n, ast.Name)}
                if names & used:
                    inside |= {id(child) for child in ast.walk(node.value)}
    return inside


def in_labels(tree: ast.AST) -> set[int]:
    """Nodes of labels of a figure, which stand beside it."""
    labels = [
        node
        for node in ast.walk(tree)
        if (isinstance(node, ast.keyword) and node.arg == "label")
        or (isinstance(node, ast.Call) and LABEL.search(ast.unparse(node.func)))
    ]
    return {id(child) for label in labels for child in ast.walk(label)}


def sentences(source: str) -> Iterator[tuple[str, str]]:
    """Texts of a module that read as sentences and end in no fault and no label of a figure, each
    after the name of the statement at the module's top that holds it."""
    tree = ast.parse(source)
    passed = on_the_way_to_a_fault(tree) | in_labels(tree)
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            passed.add(id(node.value))
        elif isinstance(node, ast.JoinedStr):
            passed |= {id(part) for part in node.values if isinstance(part, ast.Constant)}
    for top in tree.body:
        targets = getattr(top, "targets", [getattr(top, "target", None)])
        name = getattr(top, "name", "") or getattr(targets[0], "id", "")
        for node in ast.walk(top):
            found = template(node)
            if found is None or id(node) in passed:
                continue
            text, enough = found
            if len(re.findall(r"(?<![\w/.{}`-])[A-Za-z]{2,}(?![\w/`-])", text)) >= enough:
                yield name, text


@pytest.mark.parametrize(
    "source",
    [
        'def f(r):\n    return f"{r.n} of {r.m} trials overturned"\n',
        'def f(r):\n    return "{} of {} trials overturned".format(r.n, r.m)\n',
        'def f(r):\n    return "%d of %d trials overturned" % (r.n, r.m)\n',
        'WHY = "No effect of the library explains the gap."\n',
        'def f(p, r):\n    p.set_title(f"{r.n} of {r.m} trials overturned")\n',
    ],
)
def test_a_sentence_about_a_result_is_seen(source: str) -> None:
    assert len(list(sentences(source))) == 1


def test_faults_labels_and_docstrings_are_no_sentences_about_results() -> None:
    source = (
        'def f(r):\n    """Says a lot of a result in one line."""\n'
        '    why = f"{r.n} of {r.m} trials overturned"\n    raise ValueError(why)\n'
        'def g(p, r):\n    p.set_xlabel("share of trials in which it was true [1]")\n'
        '    p.plot(r.x, label=f"share of {r.n} trials that overturned")\n'
    )
    assert list(sentences(source)) == []


def test_results_are_worded_in_the_report_alone() -> None:
    found = {
        f"{place}:{name}": text
        for path in sorted(PACKAGE.rglob("*.py"))
        if not (place := path.relative_to(PACKAGE).as_posix()).startswith(NO_RESULTS)
        for name, text in sentences(path.read_text())
    }
    assert {at: text for at, text in found.items() if not at.startswith(tuple(ELSEWHERE))} == {}
    unused = [one for one in ELSEWHERE if not any(at.startswith(one) for at in found)]
    assert unused == [], "remove what no longer stands there"


def test_one_module_says_how_a_value_shows_itself() -> None:
    shows = {"__repr__", "_repr_html_"}
    found = {
        path.relative_to(PACKAGE).as_posix()
        for path in PACKAGE.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.FunctionDef) and node.name in shows
    }
    assert found == {"one_line.py"}
