"""What the maker of a pack keeps between its runs: what it did not write is refused."""

import json
import re
import shutil
from pathlib import Path

import pytest

import vsr2.blind.custodian.pack_making as make_module
from blind_samples import QuickEngine, make
from vsr2.blind.form.seal import read_json
from vsr2.errors import BlindError

BARE = ("1e400", "NaN", "-Infinity")
"""What is no text in the file but stands as it is."""


@pytest.fixture(scope="module")
def begun(study, tmp_path_factory) -> Path:
    """A pack that is made but for its seal."""
    folder = tmp_path_factory.mktemp("begun")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(make_module, "build_engine", lambda *given: QuickEngine())
        make(study, folder)
    (folder / "data" / "pack.json").unlink()
    (folder / "key" / "key.json").unlink()
    return folder


def refusal(study, begun: Path, folder: Path, file: str, key: str, value: object) -> str:
    """What is said where a key of a file has another value; None: where it is missing."""
    shutil.copytree(begun, folder)
    path = folder / "key" / file
    content = read_json(path)
    *outer, name = key.split("|")
    inner = content[outer[0]] if outer else content
    assert name in inner
    if value is None:
        del inner[name]
    else:
        inner[name] = "BARE" if value in BARE else value
    path.write_text(json.dumps(content).replace('"BARE"', str(value)))
    left = path.read_bytes()
    with pytest.raises(BlindError) as refused:
        make(study, folder)
    assert path.read_bytes() == left
    assert str(refused.value).startswith(f"{path}: ")
    return str(refused.value)[len(f"{path}: ") :]


def labels(begun: Path) -> dict[str, str]:
    """A key of `steps.json` of each kind."""
    keys = read_json(begun / "key" / "steps.json")
    kinds = ("overturning_acceleration", "detection limit", "signal", "campaign")
    return {kind: next(key for key in keys if key.startswith(kind)) for kind in kinds}


@pytest.mark.parametrize(
    ("kind", "value"),
    [
        *(("overturning_acceleration", odd) for odd in (1.0, [1.0], [True] * 5, ["1"] * 5)),
        *(("overturning_acceleration", [odd] * 5) for odd in (10**400, -1.0, [1.0])),
        *(("detection limit", odd) for odd in (True, "1", [1.0], 10**400)),
        *(("signal", odd) for odd in (True, "1", {}, 10**400)),
        *(("campaign", odd) for odd in (True, "1", [], {}, 10**400)),
    ],
)
def test_a_step_that_nothing_made_is_refused(study, begun, tmp_path, quick, kind, value) -> None:
    key = labels(begun)[kind]
    said = refusal(study, begun, tmp_path / "pack", "steps.json", key, value)
    assert said.startswith(f"{key} is {str(value)[:20]}" if type(value) is not str else key)
    assert re.search(r"; it should be .+; remove this key, and the step is done again$", said)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        *(("kind", odd) for odd in ("bogus", True, None)),
        *(("data_sha256", odd) for odd in ("", 1, None)),
        *(("protocol", odd) for odd in (True, -1, "0")),
        ("where", {"axis": "none", "weights": ["1"]}),
    ],
)
def test_a_campaign_of_another_form_is_refused(study, begun, tmp_path, quick, key, value) -> None:
    label = labels(begun)["campaign"]
    said = refusal(study, begun, tmp_path / "pack", "steps.json", f"{label}|{key}", value)
    assert said.startswith(f"{label} is ")


@pytest.mark.parametrize("file", ["steps.json", "custodian.json"])
@pytest.mark.parametrize(
    ("value", "wanted"),
    [("1e400", "is no JSON (1e400 "), ("NaN", "is nan"), ("-Infinity", "is -inf")],
)
def test_what_is_no_number_is_refused(study, begun, tmp_path, quick, file, value, wanted) -> None:
    key = {"steps.json": labels(begun)["signal"], "custodian.json": "salt"}[file]
    assert wanted in refusal(study, begun, tmp_path / "pack", file, key, value)


def test_a_campaign_with_a_number_that_is_none_is_refused(study, begun, tmp_path, quick) -> None:
    label = labels(begun)["campaign"]
    said = refusal(study, begun, tmp_path / "pack", "steps.json", f"{label}|nuisances", "NaN")
    assert said.startswith(f"{label} is ")


@pytest.mark.parametrize(
    ("key", "value", "wanted"),
    [
        *(("seed", odd, "seed") for odd in (1.0, True, "one", "", "-1", 10**400, None)),
        *(("salt", odd, "salt is") for odd in ("", "00", "g" * 64, 1, True, None)),
        *(("settings", odd, "was begun with another") for odd in (True, "1", [1], 10**400)),
        ("form", True, "was begun with another form"),
        ("scene_sha256", 1, "was begun with another scene_sha256"),
    ],
)
def test_a_state_that_nothing_wrote_is_refused(
    study, begun, tmp_path, quick, key, value, wanted
) -> None:
    said = refusal(study, begun, tmp_path / "pack", "custodian.json", key, value)
    assert wanted in said


def test_a_step_that_is_removed_is_done_again(study, begun, tmp_path, quick) -> None:
    folder = tmp_path / "pack"
    shutil.copytree(begun, folder)
    path = folder / "key" / "steps.json"
    content = read_json(path)
    for key in labels(begun).values():
        del content[key]
    path.write_text(json.dumps(content))
    make(study, folder)
    assert read_json(path) == read_json(begun / "key" / "steps.json")
