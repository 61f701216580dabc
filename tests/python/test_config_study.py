"""What a study refuses, and what it takes."""

import math
import re
from enum import StrEnum
from typing import Literal, get_args

import pytest

from vsr2._native import EngineKind, EngineMode
from vsr2.config import study_from_mapping
from vsr2.config.motion_source import Range
from vsr2.config.section import Section
from vsr2.config.study import Contact, Engine, Study
from vsr2.errors import ConfigError

BOX = {"shape": "box", "size": [0.4, 0.5, 1.0], "density": 2600}
COSINE = {"mode": "single_cosine", "pga_g": 0.3, "pgv_pga_s": 0.1}


def build(**sections):
    return study_from_mapping({"rock": BOX, "motion": COSINE, **sections}, ".", check_files=False)


def refusal(**sections):
    with pytest.raises(ConfigError) as caught:
        build(**sections)
    return str(caught.value)


def test_one_line_says_what_a_study_is():
    study = build(name="a" * 40, effects={"wear": {"loss": 0.1}})
    assert repr(study) == (
        f"<Study: name='{'a' * 40}', rock='box', motion='single_cosine', engine='auto', effects=1>"
    )
    assert len(repr(study)) <= 120
    assert study._repr_html_().startswith("<b>Study</b>: name=&#39;aaa")
    assert "effects" not in repr(build())


def test_modes_of_the_engine_are_those_of_the_core():
    modes = list(EngineKind.__members__)
    assert list(get_args(EngineMode)) == modes
    assert [build(engine={"mode": mode}).engine.mode for mode in modes] == modes
    assert "auto, parity, exact or fast" in refusal(engine={"mode": "quick"})


def test_defaults_are_the_supplements_values_but_for_bullets_habits():
    study = build()
    assert study.preset == "physical"
    assert (study.engine.time_step, study.engine.solver_iterations) == (0.001, 150)
    assert (study.engine.linear_damping, study.engine.angular_damping) == (0.0, 0.0)
    best = study.contact.rock
    assert (best.restitution, best.lateral_friction, best.spinning_friction) == (0.35, 0.7, 0.0)
    assert (best.damping, best.stiffness) == (1e7, 2.6e9)
    assert study.contact.pedestal == best


@pytest.mark.parametrize(
    "sections", [{"preset": "original"}, {"engine": {"mode": "parity"}}], ids=["preset", "parity"]
)
def test_the_originals_preset_and_parity_keep_bullets_habits(sections):
    study = build(**sections)
    assert study.preset == "original"
    assert (study.engine.linear_damping, study.engine.angular_damping) == (0.04, 0.04)
    best = study.contact.rock
    assert (best.restitution, best.lateral_friction, best.spinning_friction) == (0.35, 0.7, 0.5)
    assert (best.damping, best.stiffness) == (1e7, 2.6e9)
    assert study.contact.pedestal == best


def test_a_preset_leaves_alone_what_is_given():
    study = build(
        preset="original",
        engine={"linear_damping": 0.01, "time_step": 0.002},
        contact={"rock": {"spinning_friction": 0.1, "stiffness": 1e9}},
    )
    assert (study.engine.linear_damping, study.engine.angular_damping) == (0.01, 0.04)
    assert study.engine.time_step == 0.002
    rock, pedestal = study.contact.rock, study.contact.pedestal
    assert (rock.spinning_friction, rock.stiffness) == (0.1, 1e9)
    assert (pedestal.spinning_friction, pedestal.stiffness) == (0.5, 2.6e9)
    exact = build(preset="physical", engine={"mode": "parity"})
    assert (exact.engine.linear_damping, exact.contact.rock.spinning_friction) == (0.0, 0.0)


def test_a_preset_takes_sections_that_are_built():
    given = {"engine": Engine(mode="parity", gravity=9.8), "contact": Contact()}
    study = Study(rock=BOX, motion=COSINE, **given)
    assert (study.engine.gravity, study.engine.angular_damping) == (9.8, 0.04)
    assert study.contact.pedestal.spinning_friction == 0.5


def test_a_study_is_frozen():
    with pytest.raises(Exception, match="frozen"):
        build().engine.gravity = 1.0


@pytest.mark.parametrize(
    ("sections", "words"),
    [
        # Wrong types: booleans and text are no numbers.
        ({"engine": {"gravity": True}}, "engine.gravity: must be a number, without quotes"),
        ({"engine": {"gravity": "9.81"}}, "engine.gravity: must be a number"),
        ({"engine": {"substeps": 2.0}}, "engine.substeps: must be a whole number"),
        ({"engine": {"cone_friction": 1}}, "engine.cone_friction: must be true or false (is 1)"),
        ({"engine": 5}, "engine: must hold the keys mode, gravity"),
        ({"engine": 5, "preset": "original"}, "engine: must hold the keys mode, gravity"),
        ({"contact": {"rock": 5}, "preset": "original"}, "contact.rock: must hold the keys"),
        ({"preset": "phisical"}, "preset: must be physical or original (is 'phisical')"),
        ({"name": 5}, "name: must be text; put it in quotes (is 5)"),
        ({"name": "../etc"}, "name: must begin with a letter or digit and hold only letters"),
        ({"pedestal": {"size": [1, 2]}}, "pedestal.size[2]: is missing"),
        ({"pedestal": {"size": [1, 2, 3, 4]}}, "pedestal.size: must have 3 values"),
        ({"pedestal": {"size": 4}}, "pedestal.size: must be a list such as"),
        # Wrong values.
        ({"engine": {"gravity": math.nan}}, "engine.gravity: must be finite (is nan)"),
        ({"engine": {"gravity": math.inf}}, "engine.gravity: must be finite (is inf)"),
        ({"engine": {"time_step": 0}}, "engine.time_step: must be at least 1e-06 (is 0)"),
        ({"engine": {"time_step": 1.0}}, "engine.time_step: must be at most 0.02"),
        (
            {"engine": {"mode": "partiy"}},
            "engine.mode: must be auto, parity, exact or fast (is 'partiy')",
        ),
        ({"rock": {**BOX, "density": -1}}, "rock.density: must be greater than 0 (is -1)"),
        ({"rock": {**BOX, "density": 10**400}}, "rock.density: must be"),
        ({"rock": {**BOX, "mass": 10.0}}, "rock: give exactly one of `density`"),
        ({"rock": {"shape": "box", "size": [1, 1, 1]}}, "rock: give exactly one of `density`"),
        ({"rock": {"size": [1, 1, 1]}}, "rock.shape: is missing; give box, mesh or urdf"),
        ({"rock": {"shape": ["box"]}}, "rock.shape: must be box, mesh or urdf"),
        ({"rock": 7}, "rock: must hold keys, among them `shape`"),
        (
            {
                "rock": {
                    **BOX,
                    "start": {"mode": "pose", "position": [0, 0, 0], "orientation": [0] * 4},
                }
            },
            "rock.start.orientation: is no rotation",
        ),
        ({"motion": {"mode": "grid"}}, "did you mean grid_cosine?"),
        ({"motion": {**COSINE, "frequency": 2.0}}, "motion: give `amplitude` and `frequency`, or"),
        ({"motion": {**COSINE, "pgv_pga_s": 1e-4}}, "less than 10 time steps"),
        (
            {"motion": {"mode": "all_recordings", "folder": "x", "pattern": "../*"}},
            "motion.pattern: is matched against file names",
        ),
        (
            {"motion": {"mode": "single_recording", "file": "x", "filter": {"low": 30.0}}},
            "motion.filter: low (30.0 Hz) must be below high (25.0 Hz)",
        ),
        ({"motion": {"mode": "single_recording", "file": "a\0b"}}, "motion.file: is no file name"),
        ({"outcome": {"toppled_tilt": 1.5}}, "must not decrease in this order"),
        ({"settling": {"window": 5.0, "timeout": 4.0}}, "window (5.0 s) is longer than timeout"),
        (
            {"output": {"contact_trials": [-1], "contacts_every": 1}},
            "contact_trials[0]: must be at",
        ),
        # Keys without effect.
        ({"engine": {"split_impulse": False}}, "engine.split_impulse: has no effect"),
        (
            {"engine": {"split_impulse_penetration_threshold": 1.0}},
            "engine.split_impulse_penetration_threshold: has no effect",
        ),
        ({"pedestal": {"mass": 2.0e5}}, "pedestal.mass: has no effect with `motion.drive: presc"),
        ({"output": {"npy": True, "log_every": 0}}, "output.npy: has no effect without a log"),
        ({"output": {"contact_trials": [1]}}, "output.contact_trials: has no effect"),
        # Unknown keys, with the nearest valid one.
        ({"enginee": {}}, "enginee: is no key here; did you mean `engine`?"),
        (
            {"motion": {"mode": "single_cosine", "pga_g": 0.3, "pgv_pga": 0.1}},
            "motion.pgv_pga: is no key here; did you mean `pgv_pga_s`?",
        ),
        ({"engine": {"timestep": 1e-3}}, "engine.timestep: is no key here; did you mean `time_s"),
        ({"rock": {**BOX, "densty": 1}}, "rock.densty: is no key here; did you mean `density`?"),
        (
            {"rock": {**BOX, "start": {"yav": 1}}},
            "rock.start.yav: is no key here; did you mean `ya",
        ),
        ({"rock": {**BOX, "inertia": "aabb"}}, "rock.inertia: applies only with `shape: mesh`"),
        ({"rock": {**BOX, "solver_iterations": 1}}, "did you mean `engine.solver_iterations`?"),
        (
            {"contact": {"rock": {"lateralFriction": 1.0}}},
            "contact.rock.lateralFriction: is no key here; did you mean `lateral_friction`?",
        ),
        ({"output": {"zzzzzz": 1}}, "output.zzzzzz: is no key here; known are log_every, log_s"),
    ],
)
def test_refusals_name_key_value_and_remedy(sections, words):
    message = refusal(**sections)
    assert message.startswith("study: ")
    assert words in message
    # Pydantic's tags of unions (`rock.box.density`) are not keys of the user's.
    assert not re.search(r"\.(box|mesh|single_cosine|pose|yaw)\.", message)


class Turn(StrEnum):
    LEFT = "left"
    BOTH = "left or right"


class Chosen(Section):
    one: Literal["it's, or not", "a or b", "c, d"] = "c, d"
    some: tuple[Literal["x", "y"] | None, ...] = ()
    turn: Turn | None = None


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"one": "a or c"}, "one: must be it's, or not, a or b or c, d (is 'a or c'); did you me"),
        ({"some": ["x", "z"]}, "some[1]: must be x or y (is 'z')"),
        ({"turn": "lef"}, "turn: must be left or left or right (is 'lef'); did you mean left?"),
    ],
)
def test_choices_are_those_of_the_key_whatever_words_they_hold(given, words):
    with pytest.raises(ConfigError, match=re.escape(words)):
        Chosen(**given)


def test_missing_sections_are_named_with_their_meaning():
    with pytest.raises(ConfigError, match=r"2 problems\n.*rock: is missing.*\n.*motion: is miss"):
        study_from_mapping({}, ".")


def test_every_problem_is_listed_at_once():
    message = refusal(engine={"gravity": -1, "foo": 1}, output={"log_every": "x"})
    assert message.splitlines()[0] == "study: 3 problems"
    assert len(message.splitlines()) == 4


def test_a_key_that_is_no_text_is_refused():
    with pytest.raises(ConfigError, match="a key must be text"):
        study_from_mapping({5: 1, "rock": BOX, "motion": COSINE}, ".")


def test_no_mapping_is_refused():
    with pytest.raises(ConfigError, match="must be a mapping"):
        study_from_mapping([1], ".")


def test_values_whose_repr_fails_do_not_hide_the_error():
    class Odd:
        def __repr__(self):
            raise RuntimeError("no")

    assert "a Odd" in refusal(engine={"gravity": Odd()})


def test_the_tag_of_pedestal_and_start_may_be_left_out():
    study = build(pedestal={"size": [1, 2, 3]}, rock={**BOX, "start": {"yaw": 30}})
    assert study.pedestal.shape == "prism"
    assert study.rock.start.mode == "yaw"
    assert study.rock.start.yaw == 30.0


def test_the_pedestals_mass_is_taken_where_it_acts():
    assert build(pedestal={"mass": 5.0}, motion={**COSINE, "drive": "motor"}).pedestal.mass == 5.0


@pytest.mark.parametrize(
    ("low", "high", "step", "count"),
    [(0.1, 0.5, 0.2, 3), (0.1, 0.1, 1.0, 1), (0.1, 0.49, 0.2, 2), (0.1, 1.0, 0.1, 10)],
)
def test_range_counts_its_end_despite_rounding(low, high, step, count):
    assert Range(min=low, max=high, step=step).count == count


def test_a_grid_too_large_for_any_machine_is_refused():
    fine = {"min": 0.1, "max": 1.0, "step": 1e-5}
    message = refusal(motion={"mode": "grid_cosine", "pga_g": fine, "pgv_pga_s": fine})
    assert "90001 x 90001 trials are more than 1000000" in message


def test_orientations_are_kept_as_given():
    # Parity needs the quaternion unnormalised, as the original hands it on.
    given = (0.0, 0.0, 0.70711, 0.70711)
    start = {"mode": "pose", "position": [0, 0, 2], "orientation": list(given)}
    assert build(rock={**BOX, "start": start}).rock.start.orientation == given


def test_python_may_build_sections_directly():
    study = Study(rock=build().rock, motion=build().motion)
    assert study == build()
