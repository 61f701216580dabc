"""The core's numbers: chosen ones are stated with results, contact parameters act in one place."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from vsr2 import Study, _native, run_batch
from vsr2.simulation.run_constants import run_constants

CORE = Path(__file__).resolve().parents[2] / "cpp"
CONSTANTS = CORE / "include" / "vsr2" / "constants.hpp"
BLOCK = {"shape": "box", "size": [0.25, 0.5, 1.0], "density": 2700.0}
UNTUNED = {
    "Bullet's or PyBullet's": {
        "contact_model.cpp:kMaxFriction", "contact_sweeps.hpp:kGreatestImpulse",
        "drive_law.hpp:maximum_force", "drive_law.hpp:position_gain", "drive_law.hpp:speed_limit",
        "drive_law.hpp:velocity_gain", "fast_advance.cpp:kGreatestTurn",
        "fast_advance.cpp:kGreatestVelocity", "fast_advance.cpp:kLinearSlop",
        "fast_stepper.cpp:kFlatVolume", "trial.cpp:kManifoldPoints",
    },
    "count or index of what there is": {
        "bullet_world.cpp:kSpatialJoints", "contact_jump.cpp:kMostVariables",
        "exact_solver.hpp:kJoints", "trial.hpp:kTime",
    },
    "speed or memory: no bit depends on it": {
        "contact_jump.cpp:kMostPowers", "exact_solver.cpp:kSurelyMoving", "hull_scan.hpp:kBlock",
        "low_vertices.cpp:kFar", "low_vertices.cpp:kFarBand", "low_vertices.cpp:kLeastFarBand",
        "low_vertices.cpp:kNear", "low_vertices.cpp:kNearBand",
    },
    "limit": {
        "recorded_world.hpp:kMaxSteps", "rock_mechanics.hpp:kSupports", "world.cpp:tolerance",
    },
    "rounding": {"bullet_world.cpp:kPrescribedMass", "contact_jump.cpp:kRounding"},
    "room for the rows of two full manifolds": {
        "exact_solver.cpp:contacts", "exact_solver.cpp:entries", "exact_solver.cpp:rows",
    },
    "range of a contact parameter": {
        "contact_model.hpp:kFraction", "contact_model.hpp:kNotNegative",
        "contact_model.hpp:kPositive",
    },
}  # fmt: skip
"""Numbers of the core that stand beside their use, by what they are."""


def bare_numbers() -> Iterator[str]:
    """Constants of the core whose value begins with a number."""
    number = re.compile(r"\bconstexpr [\w:]+ (\w+) ?(?:=|\{) ?-?[\d.]")
    for path in sorted(CORE.rglob("*.?pp")):
        for name in number.findall(path.read_text()):
            yield f"{path.name}:{name}"


def test_no_chosen_number_of_the_core_stands_bare() -> None:
    assert set(bare_numbers()) == set().union(*UNTUNED.values())


def test_every_number_of_the_core_is_exported_and_said() -> None:
    """The core does not compile where a member lacks its name; here: no name is another's."""
    declared = {}
    for body in re.findall(r"struct \w+Constants \{\n(.*?)\n\};", CONSTANTS.read_text(), re.DOTALL):
        members = re.findall(r"^  (?:double|std::int64_t) (\w+) = (\S+);", body, re.MULTILINE)
        assert members
        assert "///" in body
        declared[tuple(name for name, _ in members)] = [float(value) for _, value in members]
    exported = _native.core_constants()
    assert len(declared) == len(exported)
    for names, values in declared.items():
        (one,) = [found for found in exported.values() if set(found) == set(names)]
        assert [one[name] for name in names] == values


def test_a_result_states_the_numbers_and_the_sources_of_its_core() -> None:
    assert run_constants()["core"] == _native.core_constants()
    study = {
        "name": "one",
        "rock": BLOCK,
        "motion": {"mode": "single_cosine", "amplitude": 0.01, "frequency": 2.0},
    }
    provenance = run_batch(Study.from_dict(study), threads=1).provenance
    assert provenance["constants"]["core"] == _native.core_constants()
    assert re.fullmatch(r"[0-9a-f]{64}", provenance["build"]["sources"])


def test_a_contact_parameter_acts_in_one_place() -> None:
    """Beside it: the lever's rule of a pair, and the mechanism that sets impacts."""
    names = "|".join(one.name for one in _native.contact_parameters())
    read = re.compile(rf"(?:\[|ContactKey \w+ = )\"({names})\"")
    found: dict[str, set[str]] = {}
    for path in CORE.rglob("*.?pp"):
        if here := set(read.findall(path.read_text())):
            found[path.name] = here
    assert found.pop("contact_laws.hpp")
    assert found == {"contact_model.cpp": {"lateral_friction"}, "scene.cpp": {"restitution"}}
