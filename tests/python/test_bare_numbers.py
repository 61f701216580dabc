"""Chosen numbers stand in frozen dataclasses, with their source: docs/architecture.md."""

from __future__ import annotations

import ast
import builtins
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from vsr2.blind.custodian.pack_streams import PackStream
from vsr2.causes.margins.margin_streams import MarginStream
from vsr2.ensemble.observed.random_streams import Stream

PACKAGE = Path(__file__).resolve().parents[2] / "python" / "vsr2"
DISPLAY = ("report", "view")
"""Rooms whose numbers only a reader's eye judges."""
LIMIT = re.compile(r"_?(MAX|MIN|LONGEST)_")
"""Names of limits beyond which an input is refused."""
UNTUNED: dict[str, set[str]] = {
    "form of a file": {
        "blind/custodian/pack_making.py:FORM", "blind/form/seal.py:SALT_BYTES",
        "blind/form/seal.py:_MADE", "diagnosis/corrected.py:DIGITS",
        "posterior/files.py:FORMAT", "ensemble/simulated/cache.py:KEY",
        "motion/peer.py:_HEADER_LINES", "motion/recording.py:_LABORATORY_COLUMNS",
        "results/result_folder.py:FORMAT_VERSION", "config/ros2_notes.py:_RECORD_INTERVAL",
    },
    "physics, or a scale that was measured": {
        "blind/mujoco/rigid_body.py:GRAVITY", "motion/units.py:STANDARD_GRAVITY",
        "motion/recording.py:METRES_PER_VOLT", "scene/build.py:CONTACT_POINTS",
    },
    "numbers that stand for names": {
        "blind/custodian/bullet_engine.py:_SCENE_EFFECTS",
        "cli/entry.py:INTERRUPTED, TERMINATED",
        "coverage/planted_campaigns.py:FIRST",
        "ensemble/simulated/campaigns.py:FIRST_NUISANCE",
        "ensemble/simulated/simulator.py:HALF_STEP, FINE_SOLVER",
        "ensemble/simulated/simulator.py:PERTURBED", "simulation/batch.py:_LOST, _COMPLETE",
        "simulation/effect_checks.py:_HULL",
    },
    "convention": {
        "config/section.py:DEFAULT_TIME_STEP", "coverage/coverage_scores.py:LEVELS",
        "effects/geometry.py:_QUARTERS", "effects/parameter.py:NORMAL_ENDS",
        "posterior/naming.py:NEVER",
        "hazard/hazard_curve.py:SITE_ROUNDING",
        "effects/underside.py:_COEFFICIENTS", "motion/two_components.py:STEP",
        "motion/spectrum.py:PERIODS", "scene/rotation.py:IDENTITY",
        "scene/shapes.py:_BOX_SIGNS", "scene/shapes.py:_BOX_FACES",
        "simulation/planning.py:EDGE_ROWS",
    },
    "guard against rounding": {
        "campaign/series.py:NORM_TOLERANCE", "posterior/network.py:FORBIDDEN",
        "ensemble/simulated/library.py:HALVINGS", "ensemble/simulated/simulator.py:RATIO_STEPS",
        "effects/rounding.py:_SAME", "effects/support.py:_UPRIGHT", "effects/underside.py:_LEVEL",
        "motion/motion.py:START_TOLERANCE", "motion/sample_spline.py:BOUND_ROUNDING",
        "motion/sample_spline.py:SETTLED",
        "motion/two_components.py:SAME_INTERVAL",
        "scene/mass.py:DIAGONAL_TOLERANCE", "scene/mass.py:EQUAL_MOMENTS",
        "scene/mass.py:TRIANGLE_TOLERANCE", "scene/rotation.py:ALONG",
    },
    "memory or progress: no result depends on it": {
        "calibration/evaluation.py:MAX_SAMPLES_HELD",
        "campaign/file_problems.py:_LISTED", "coverage/posterior_check.py:CHUNK",
        "ensemble/simulated/cache.py:CHUNK", "ensemble/simulated/linear_algebra.py:BLOCK",
        "ensemble/simulated/scene_simulator.py:KEPT_MOTIONS",
        "ensemble/simulated/scene_simulator.py:KEPT_SCENES", "effects/rounding.py:_PAIRS",
        "fragility/fit.py:_CHUNK",
        "motion/sample_spline.py:BLOCK", "motion/sample_spline.py:MAX_KEPT",
        "simulation/native_scenes.py:MAX_NATIVE_POINTS",
        "simulation/native_scenes.py:MAX_NATIVE_SCENES",
        "simulation/native_scenes.py:POINT_BYTES",
        "results/batch_table.py:_BLOCK", "scene/placement.py:_PAIRS",
        "simulation/planning.py:ROW_BYTES",
    },
}  # fmt: skip
"""Numbers that may stand at a module's top, by what they are."""


INSIDE: dict[str, set[str]] = {
    "form of a file, or of the system": {
        "blind/custodian/campaign_recording.py: 3.14159", "blind/custodian/pack_making.py: 448",
        "cli/options.py: 130", "cli/verb_calibrate.py: 130",
        "cli/verb_campaign.py: 130", "config/yaml_file.py: 20", "motion/peer.py: 300",
        "motion/recording.py: 2000", "results/atomic.py: 384", "results/atomic.py: 438",
        "results/store.py: 438", "scene/mesh_files.py: 100000", "scene/mesh_files.py: 50",
        "scene/mesh_files.py: 80", "scene/mesh_files.py: 84",
    },
    "most that an integer holds": {
        "blind/custodian/detection_limit.py: 31", "blind/custodian/pack_making.py: 31",
        "blind/custodian/pack_making.py: 63",
        "calibration/search.py: 31", "ensemble/simulated/nuisance_draws.py: 63",
        "ensemble/simulated/motion_noise.py: 31", "results/journal.py: 63", "results/store.py: 63",
    },
    "definition or formula": {
        "motion/fusion.py: 20", "motion/measures.py: 0.05", "motion/measures.py: 0.75",
        "motion/measures.py: 0.95", "motion/processing.py: 15", "motion/spectrum.py: 0.05",
        "motion/synthetic.py: 15", "motion/two_components.py: 50",
    },
    "text that is cut for a message or a name": {
        "campaign/simulate.py: 80", "config/problems.py: 57", "config/yaml_file.py: 57",
        "posterior/files.py: 200", "motion/npz.py: 200", "motion/recording.py: 200",
        "motion/seismology.py: 200", "scene/mesh_files.py: 200", "scene/urdf.py: 57",
    },
    "default that the caller sees and sets": {
        "cli/verb_motion.py: 15", "cli/verb_view.py: 8080", "coverage/posterior_check.py: 200",
    },
    "of a frozen dataclass, in a function that makes its default": {
        "simulation/effect_checks.py: 0.0003", "simulation/effect_checks.py: 0.002",
        "simulation/effect_checks.py: 0.01", "simulation/effect_checks.py: 0.1",
        "simulation/effect_checks.py: 30.0",
    },
    "drawing": {"motion/plot.py: 0.6", "motion/plot.py: 0.8"},
}  # fmt: skip
"""Numbers that may stand inside a function, by what they are."""


def is_plain(value: float) -> bool:
    """Whether a number inside a function speaks for itself: small whole numbers, halves, powers of
    two, whole decimals, parts of a circle or an hour, and guards against rounding."""
    if not float(value).is_integer():
        return value == 0.5 or value <= 1e-6
    if value >= 1e12:  # beyond whatever is measured
        return True
    exact = int(value)
    return exact <= 12 or exact & (exact - 1) == 0 or exact in {60, 90, 100, 180, 360, 1000, 3600}


def inside(source: str) -> Iterator[float]:
    """Numbers inside functions that do not speak for themselves, those shown in a text aside."""
    tree = ast.parse(source)
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.Lambda)]
    texts = {
        id(part)
        for node in ast.walk(tree)
        if isinstance(node, ast.FormattedValue)
        for part in ast.walk(node)
    }
    seen: set[int] = set()
    for node in (part for function in functions for part in ast.walk(function)):
        if isinstance(node, ast.Constant) and type(node.value) in (int, float):
            if id(node) not in seen | texts and not is_plain(node.value):
                yield node.value
            seen.add(id(node))


def is_numeric(value: ast.expr) -> bool:
    """Whether an expression holds numbers, and beside them no more than keys, built-in functions,
    the mathematics library and numpy."""
    nodes = list(ast.walk(value))
    keys = {id(key) for node in nodes if isinstance(node, ast.Dict) for key in node.keys}
    bound = {
        name.id
        for node in nodes
        if isinstance(node, ast.comprehension)
        for name in ast.walk(node.target)
        if isinstance(name, ast.Name)
    }
    known = {"math", "np", *dir(builtins), *bound}
    constants = [node for node in nodes if isinstance(node, ast.Constant) and id(node) not in keys]
    return (
        any(type(one.value) in (int, float) for one in constants)
        and all(type(one.value) in (int, float, type(None)) for one in constants)
        and all(node.id in known for node in nodes if isinstance(node, ast.Name))
        and not any(isinstance(node, ast.Lambda) for node in nodes)
    )


def bare_numbers(source: str) -> Iterator[tuple[str, bool]]:
    """Numbers at a module's top: name, and whether a docstring says what it is."""
    body = ast.parse(source).body
    for node, after in zip(body, [*body[1:], None], strict=True):
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
            target = node.targets[0] if isinstance(node, ast.Assign) else node.target
            said = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
            if is_numeric(node.value):
                yield ast.unparse(target).strip("()"), said


def all_bare() -> dict[str, bool]:
    """Of the package, by place and name."""
    return {
        f"{place}:{name}": said
        for path in sorted(PACKAGE.rglob("*.py"))
        if (place := path.relative_to(PACKAGE).as_posix()).split("/")[0] not in DISPLAY
        for name, said in bare_numbers(path.read_text())
    }


@pytest.mark.parametrize(
    "line",
    [
        "POLL = 0.1", "STEPS: int = 2 ** 25", "LOW, HIGH = 0.1, 0.2", "CORNERS = np.array([1, 2])",
        "AZIMUTHS = tuple(float(a) for a in range(0, 360, 15))", "LOSS = {'low': 1e-3}",
        "HALF = 0.5 * math.pi",
    ],
)  # fmt: skip
def test_a_number_is_found_in_every_form(line: str) -> None:
    assert len(list(bare_numbers(line))) == 1


@pytest.mark.parametrize("line", ["A = B", "A = 'x'", "A = f(3)", "A = ('x', 3)", "A = None"])
def test_other_values_are_no_numbers(line: str) -> None:
    assert list(bare_numbers(line)) == []


def test_no_chosen_number_stands_bare() -> None:
    found = all_bare()
    known = set().union(*UNTUNED.values())
    limits = {at for at in found if LIMIT.match(at.partition(":")[2])} - known
    assert set(found) - limits == known


@pytest.mark.parametrize("body", ["return 0.3 * x", "return f(x, draws=4000)", "return x > 1e-3"])
def test_a_number_inside_a_function_is_found(body: str) -> None:
    assert len(list(inside(f"def one(x):\n    {body}\n"))) == 1


@pytest.mark.parametrize("body", ["return 0.5 * x", "return x[3] > 1e-9", "return 360.0 < 1e30"])
def test_plain_numbers_are_no_choices(body: str) -> None:
    assert list(inside(f"def one(x):\n    {body}\n")) == []


def test_no_chosen_number_stands_inside_a_function() -> None:
    found = {
        f"{place}: {value!r}"
        for path in sorted(PACKAGE.rglob("*.py"))
        if (place := path.relative_to(PACKAGE).as_posix()).split("/")[0] not in DISPLAY
        for value in inside(path.read_text())
    }
    assert found == set().union(*INSIDE.values())


def test_level_and_replicates_of_intervals_stand_once() -> None:
    again = re.compile(
        r"\b0?\.975\b|\blevel\b.* = 0?\.95\b|\b(replicates|resamples)\b.* = 2_?000\b"
    )
    found = {
        path.name: [line.strip() for line in path.read_text().splitlines() if again.search(line)]
        for path in sorted(PACKAGE.rglob("*.py"))
    }
    once = ["level: float = 0.95", "replicates: int = 2000"]
    assert {name: lines for name, lines in found.items() if lines} == {"intervals.py": once}


OF_A_CAMPAIGN = ("ensemble", "posterior", "diagnosis", "prediction", "coverage", "causes")
"""Rooms that draw for what is asked of a campaign."""


@pytest.mark.parametrize(
    ("rooms", "source", "streams"),
    [
        (OF_A_CAMPAIGN, "ensemble/observed/random_streams.py", Stream),
        (OF_A_CAMPAIGN, "causes/margins/margin_streams.py", MarginStream),
        (("blind/custodian",), "blind/custodian/pack_streams.py", PackStream),
    ],
)
def test_a_stream_of_random_numbers_has_one_purpose(rooms, source, streams) -> None:
    """Its name stands in one module, but its number in none."""
    users: dict[str, set[str]] = {one.name: set() for one in streams}
    for path in (path for room in rooms for path in (PACKAGE / room).rglob("*.py")):
        if path == PACKAGE / source:
            continue
        text = path.read_text()
        assert not re.search(r"(default_rng|SeedSequence)\(\[\w+, \d", text), path
        for name in re.findall(rf"\b{streams.__name__}\.(\w+)", text):
            users[name].add(path.name)
    assert {name: len(files) for name, files in users.items()} == dict.fromkeys(users, 1)


@pytest.mark.parametrize("room", [*OF_A_CAMPAIGN, "blind"])
def test_a_seed_is_not_reckoned_with(room: str) -> None:
    """Nor drawn from alone, but where nuisances are: the next seed would draw the same again."""
    reckoned = re.compile(r"\b\w*seed\b *[-+*^] *[\w(]|[\w)] *[-+^] *(self\.)?_?seed\b")
    alone = re.compile(r"(default_rng|SeedSequence)\((self\.)?_?seed\)")
    found: dict[str, list[str]] = {}
    for path in sorted((PACKAGE / room).rglob("*.py")):
        for line in path.read_text().splitlines():
            if reckoned.search(line) or alone.search(line):
                found.setdefault(path.name, []).append(line.strip())
    own = "shift = np.random.default_rng(seed).random(count)"
    assert found == ({"simulator.py": [own]} if room == "ensemble" else {})


def test_streams_of_one_seed_have_numbers_of_their_own() -> None:
    numbers = [*Stream, *MarginStream]
    assert len({int(one) for one in numbers}) == len(numbers)


def test_every_bare_number_says_what_it_is() -> None:
    assert [at for at, said in all_bare().items() if not said] == []
