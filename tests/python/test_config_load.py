"""Reading studies from YAML: bounds, places in errors, paths, and the way back."""

import math
import os
import tempfile
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from vsr2.config import dump_study, load_study, study_from_mapping
from vsr2.config.yaml_file import MAX_BYTES, parse_yaml
from vsr2.errors import ConfigError

MINIMAL = """\
rock:
  shape: box
  size: [0.4, 0.5, 1.0]
  density: 2.6e3
motion:
  mode: single_cosine
  pga_g: 0.3
  pgv_pga_s: 0.1
"""

FULL = """\
name: quarry 7
seed: 3
engine: {gravity: 9.8, time_step: 5e-4, substeps: 2}
pedestal:
  shape: mesh
  file: table.obj
  mass: 1e5
rock:
  shape: mesh
  file: ../rocks/rock.stl
  mass: 353.8
  start: {mode: pose, position: [0, 0, 2.78], orientation: [0, 0, 0, 1]}
contact:
  rock: &granite {restitution: 0.2, stiffness: 1e9}
  pedestal: {<<: *granite, restitution: 0.3}
motion:
  mode: all_recordings
  folder: motions
  pattern: "*.npz"
  drive: motor
  filter: {}
output: {contacts_every: 5, contact_trials: [0, 2]}
"""


def write(folder, text, name="study.yaml"):
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def refusal(folder, text):
    with pytest.raises(ConfigError) as caught:
        load_study(write(folder, text))
    return str(caught.value).replace(str(folder) + os.sep, "")


def test_scientific_notation_is_a_number(tmp_path):
    # YAML 1.1 reads these as text.
    text = MINIMAL + "contact: {rock: {stiffness: 1e7, damping: 2E+5}, pedestal: {damping: .5e6}}\n"
    contact = load_study(write(tmp_path, text)).contact
    assert (contact.rock.stiffness, contact.rock.damping) == (1e7, 2e5)
    assert contact.pedestal.damping == 5e5


@pytest.mark.parametrize(
    ("text", "value"),
    [
        *[("1e-3", 1e-3), (".5e6", 5e5), ("5.", 5.0), ("-0", 0), ("12e345678", math.inf)],
        *[("010", 10), ("0o10", 8), ("0x1F", 31), ("+7", 7), ("~", None), ("", None)],
        *[("true", True), ("FALSE", False), ("on", "on"), ("yes", "yes"), ("tRue", "tRue")],
        *[("1_000", "1_000"), ("1:30", "1:30"), ("2021-06-30", "2021-06-30"), ("0b1", "0b1")],
        *[("'12'", "12"), ('"true"', "true"), ("!!float 2", 2.0), ("-0x1", "-0x1"), ("=", "=")],
    ],
)
def test_values_are_read_by_the_core_schema_of_yaml_1_2(text, value):
    read = parse_yaml(f"key: {text}\n".encode(), "label").data["key"]
    assert (read, type(read)) == (value, type(value))


def test_merging_keeps_own_keys(tmp_path):
    contact = load_study(write(tmp_path, FULL), check_files=False).contact
    assert contact.pedestal.stiffness == contact.rock.stiffness == 1e9
    assert (contact.rock.restitution, contact.pedestal.restitution) == (0.2, 0.3)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "study.yaml: the file is empty"),
        ("# only a comment\n", "study.yaml: the file is empty"),
        ("- 1\n", "study.yaml:1: the file holds no mapping"),
        ("just text", "study.yaml:1: the file holds no mapping"),
        (b"\x7fELF\x02\x01\x01\x00\x00", "does not belong in a text file; is it binary?"),
        (b"\xff\xfe\x00\x01", "byte 0xff at offset 0 is not UTF-8"),
        ("rock: [1, 2\n", "not valid YAML"),
        ('rock: "\\UFFFFFFFF"\n', "study.yaml:1: not valid YAML"),
        ('rock: "\\ud800"\n', "study.yaml:1: text holds half of a surrogate pair"),
        ("a: 1\nb: 2\na: 3\n", "study.yaml:3: key `a` is given twice (first in line 1)"),
        ("a:\n  b: 1\n  b: 1\n", "study.yaml:3: key `b` is given twice (first in line 2)"),
        ("1: 2\n", "study.yaml:1: a key must be text"),
        ("? [a]\n: 1\n", "study.yaml:1: a key must be text"),
        ("<<: 5\n", "`<<` takes a mapping"),
        ("a: 1\n---\nb: 2\n", "expected a single document"),
        ("name: !!python/object/apply:os.getcwd []\n", "study.yaml:1: tag 'tag:yaml.org,2002:py"),
        ("name: !!python/name:os.system\n", "study.yaml:1: tag"),
        ("name: !mine x\n", "study.yaml:1: tag '!mine' is not allowed"),
        ("name: !!binary aGk=\n", "study.yaml:1: tag"),
        ("seed: !!int x\n", "'x' is not of the type its tag !!int says"),
        ("a: &a [*a]\n", "nested deeper than 20"),
        ("a: " + "[" * 5000, "nested deeper than 20"),
        ("a: [" + "1, " * 30_000 + "]", "more than 20000 values"),
    ],
)
def test_broken_files_are_refused_with_their_place(tmp_path, text, words):
    assert words in refusal(tmp_path, text)


def test_a_bomb_of_aliases_is_refused(tmp_path):
    bomb = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n"
    for i in range(12):
        bomb += f"a{i + 1}: &a{i + 1} [{', '.join([f'*a{i}'] * 9)}]\n"
    assert "more than 20000 values once aliases are followed" in refusal(tmp_path, bomb)


def test_size_is_bounded_before_reading(tmp_path):
    path = write(tmp_path, "x")
    with path.open("r+b") as stream:
        stream.truncate(2**40)  # sparse: reading it all would end the test
    with pytest.raises(ConfigError, match=f"larger than {MAX_BYTES} bytes"):
        load_study(path)


def test_what_is_no_file_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe")  # opening it would wait for a writer for ever
    for name, words in (
        ("none.yaml", "no such file"),
        (".", "not a file"),
        ("pipe", "not a file"),
        ("nul\0", "cannot be read"),
        ("x" * 1000, "cannot be read"),
    ):
        with pytest.raises(ConfigError, match=words):
            load_study(tmp_path / name)


def test_python_tags_run_nothing(tmp_path):
    trace = tmp_path / "trace"
    text = f"name: !!python/object/apply:os.mkdir ['{trace}']\n{MINIMAL}"
    assert "tag" in refusal(tmp_path, text)
    assert not trace.exists()


@pytest.mark.parametrize(
    "value", [".nan", ".inf", "-.inf", "1e999", "9" * 500, "nan", "1:30", "1_000", "2021-06-30"]
)
def test_numbers_that_are_none_are_refused_in_their_line(tmp_path, value):
    message = refusal(tmp_path, MINIMAL + f"engine:\n  gravity: {value}\n")
    assert message.startswith("study.yaml:10: engine.gravity: must be ")


def test_errors_name_the_line_of_the_key_or_of_its_section(tmp_path):
    message = refusal(
        tmp_path,
        "rock:\n  shape: mesh\n  fil: x\n  mass: -2\nmotion: {mode: single_cosine, pga_g: 1}\n",
    )
    assert message.splitlines() == [
        "study.yaml: 4 problems",
        "  study.yaml:4: rock.mass: must be greater than 0 (is -2)",
        "  study.yaml:1: rock.file: is missing; give it: OBJ, STL or PLY, watertight, in metres "
        "[m].",
        "  study.yaml:3: rock.fil: is no key here; did you mean `file`?",
        "  study.yaml:5: motion: give `amplitude` and `frequency`, or `pga_g` and `pgv_pga_s`",
    ]


def test_files_are_found_relative_to_the_study_not_to_the_process(tmp_path, monkeypatch):
    home = tmp_path / "studies"
    (home / "motions").mkdir(parents=True)
    (tmp_path / "rocks").mkdir()
    for name in ("studies/table.obj", "rocks/rock.stl"):
        (tmp_path / name).touch()
    write(home, FULL)
    monkeypatch.chdir(tmp_path)
    study = load_study("studies/study.yaml")
    assert study.rock.file.is_absolute()
    assert study.rock.file.samefile(tmp_path / "rocks/rock.stl")
    assert study.pedestal.file == home / "table.obj"
    assert study.motion.folder == home / "motions"
    monkeypatch.chdir("/")
    assert study.rock.file.exists()


def test_missing_files_are_named_with_their_key_and_line(tmp_path):
    message = refusal(tmp_path, FULL)
    assert "study.yaml: 3 problems" in message
    assert "study.yaml:6: pedestal.file: no such file (table.obj)" in message
    assert "study.yaml:10: rock.file: no such file (../rocks/rock.stl)" in message
    assert "study.yaml:18: motion.folder: no such folder (motions)" in message


def test_a_folder_is_no_file_and_a_file_no_folder(tmp_path):
    (tmp_path / "table.obj").mkdir()
    (tmp_path / "motions").touch()
    message = refusal(tmp_path, FULL)
    assert "pedestal.file: is no file" in message
    assert "motion.folder: is no folder" in message


def test_a_written_study_moves_with_its_folder(tmp_path):
    study = load_study(write(tmp_path, FULL), check_files=False)
    text = dump_study(study, relative_to=tmp_path)
    assert str(tmp_path) not in text
    other = tmp_path / "other"
    other.mkdir()
    moved = load_study(write(other, text), check_files=False)
    assert moved.pedestal.file == other / "table.obj"
    assert moved.model_copy(update={"rock": None, "pedestal": None, "motion": None}) == (
        study.model_copy(update={"rock": None, "pedestal": None, "motion": None})
    )


def test_a_written_study_reads_the_same_in_yaml_1_1(tmp_path):
    # Other tools read our files with YAML 1.1; nothing there may turn numbers into text.
    study = load_study(write(tmp_path, FULL), check_files=False)
    data = yaml.safe_load(dump_study(study))
    assert study_from_mapping(data, tmp_path, check_files=False) == study


# Round trip of any study.

number = st.floats(1e-3, 1e3)
tilt = st.floats(0.001, 3.0)
file_name = st.text(min_size=1, max_size=12).filter(
    lambda text: "\0" not in text and text.isprintable() and text.strip("./")
)
size = st.lists(number, min_size=3, max_size=3)
starts = st.one_of(
    st.fixed_dictionaries(
        {"mode": st.just("pose"), "position": st.lists(number, min_size=3, max_size=3)},
        optional={"orientation": st.sampled_from([[0, 0, 0, 1], [0.6, 0.0, 0.8, 0.0]])},
    ),
    st.fixed_dictionaries({}, optional={"yaw": number, "position_xy": st.just([1, -2.5])}),
)
massive = {"mass": number}
rocks = st.one_of(
    st.fixed_dictionaries(
        {"shape": st.just("box"), "size": size, "density": number}, optional={"start": starts}
    ),
    st.fixed_dictionaries(
        {"shape": st.just("mesh"), "file": file_name, "mass": number},
        optional={"start": starts, "scale": number, "repair": st.booleans()},
    ),
    st.fixed_dictionaries(
        {"shape": st.just("urdf"), "file": file_name},
        optional={"start": starts, "inertia": st.sampled_from(["file", "mesh", "aabb"])},
    ),
)
drives = {"drive": st.sampled_from(["motor", "prescribed"])}
ranges = st.just({"min": 0.1, "max": 0.5, "step": 0.1})
motions = st.one_of(
    st.fixed_dictionaries(
        {
            "mode": st.just("single_cosine"),
            "pga_g": st.floats(0.01, 2),
            "pgv_pga_s": st.floats(0.1, 1),
        },
        optional=drives,
    ),
    st.fixed_dictionaries(
        {"mode": st.just("grid_cosine"), "pga_g": ranges, "pgv_pga_s": ranges}, optional=drives
    ),
    st.fixed_dictionaries(
        {"mode": st.just("single_recording"), "file": file_name},
        optional={**drives, "filter": st.just({"high": 20.0})},
    ),
    st.fixed_dictionaries(
        {"mode": st.just("all_recordings"), "folder": file_name},
        optional={**drives, "pattern": st.sampled_from(["*", "*.npz", "1e7", "~", "yes", "0x1"])},
    ),
)
studies = st.fixed_dictionaries(
    {"rock": rocks, "motion": motions},
    optional={
        "name": st.from_regex(r"\A[A-Za-z0-9][A-Za-z0-9._ -]{0,8}\Z"),
        "seed": st.integers(0, 2**63 - 1),
        "engine": st.fixed_dictionaries({}, optional={"gravity": number, "substeps": st.just(3)}),
        "pedestal": st.fixed_dictionaries({}, optional={"size": size}),
        "output": st.just({"contacts_every": 1, "contact_trials": [0, 5]}),
    },
)


@settings(deadline=None)  # the wall time of files is the machine's load
@given(studies)
def test_every_study_survives_writing_and_reading(mapping):
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        study = study_from_mapping(mapping, folder, check_files=False)
        for relative_to in (None, folder):
            path = write(folder, dump_study(study, relative_to=relative_to))
            assert load_study(path, check_files=False) == study


# Nothing but ConfigError gets out.

SEEDS = [FULL.encode(), MINIMAL.encode()]
PIECES = [b".nan", b"1e999", b"-1", b"[]", b"{}", b"~", b"&a", b"*a", b"<<: *a", b"!!python/name:x"]
PIECES += [b"- ", b": ", b"? ", b"\t", b"\0", b"\xff", b"|", b">", b"---\n", b"%YAML 1.1\n", b"'"]
PIECES += [b'"', b"\\U00110000", b"{{", b"shape: urdf", b"mode: pose", b"true", b"9" * 400]


@st.composite
def mutated(draw):
    """A real file with pieces replaced, removed and put in."""
    content = draw(st.sampled_from(SEEDS))
    for _ in range(draw(st.integers(0, 6))):
        start = draw(st.integers(0, len(content)))
        end = min(len(content), start + draw(st.integers(0, 20)))
        piece = draw(st.one_of(st.sampled_from(PIECES), st.binary(max_size=6)))
        content = content[:start] + piece + content[end:]
    return content


@settings(deadline=None)
@given(st.one_of(mutated(), st.binary(max_size=200)))
def test_any_bytes_give_a_study_or_a_config_error(content):
    with tempfile.TemporaryDirectory() as name:
        path = write(Path(name), content)
        try:
            study = load_study(path, check_files=False)
        except ConfigError as error:
            message = str(error)
        else:
            message = str(path)
            text = dump_study(study)
            assert load_study(write(Path(name), text), check_files=False) == study
        assert str(path) in message


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3)
    ),
    max_leaves=6,
)


@given(values, st.randoms(use_true_random=False), st.booleans())
def test_any_value_at_any_key_gives_a_study_or_a_config_error(value, choose, check_files):
    data = parse_yaml(FULL.encode(), "full").data
    target = data
    while True:
        key = choose.choice(sorted(target))
        if not isinstance(target[key], dict) or not target[key] or choose.random() < 0.3:
            break
        target = target[key]
    target[key] = value
    message = "study: "
    try:
        study_from_mapping(data, "/nowhere", check_files=check_files)
    except ConfigError as error:
        message = str(error)
    assert message.startswith("study: ")


def test_overrides_replace_settings(tmp_path: Path) -> None:
    path = tmp_path / "study.yaml"
    path.write_text(
        "rock: {shape: box, size: [1, 1, 1], mass: 10}\n"
        "motion: {mode: single_cosine, amplitude: 0.1, frequency: 1.0}\n"
    )
    study = load_study(path, overrides=["contact.rock.restitution=0.5", "rock.mass=1e3"])
    assert study.contact.rock.restitution == 0.5
    assert study.rock.mass == 1000.0


@pytest.mark.parametrize("override", ["rock.mass", "=1", "rock..mass=1", "rock.mass.deep=1"])
def test_bad_overrides_are_refused(tmp_path: Path, override: str) -> None:
    path = tmp_path / "study.yaml"
    path.write_text(
        "rock: {shape: box, size: [1, 1, 1], mass: 10}\n"
        "motion: {mode: single_cosine, amplitude: 0.1, frequency: 1.0}\n"
    )
    with pytest.raises(ConfigError, match="override"):
        load_study(path, overrides=[override])


def test_of_two_overrides_of_one_key_the_later_counts(tmp_path: Path) -> None:
    path = tmp_path / "study.yaml"
    path.write_text("motion: {mode: single_cosine, amplitude: 0.1, frequency: 1.0}\n")
    rock = "rock={shape: box, size: [1, 1, 1], mass: 10}"
    assert load_study(path, overrides=[rock, "seed=1", "seed=2"]).seed == 2


def test_an_override_may_set_a_part_of_an_earlier_one(tmp_path: Path) -> None:
    path = tmp_path / "study.yaml"
    path.write_text("motion: {mode: single_cosine, amplitude: 0.1, frequency: 1.0}\n")
    rock = "rock={shape: box, size: [1, 1, 1]}"
    assert load_study(path, overrides=[rock, "rock.mass=20"]).rock.mass == 20.0
