"""Effects through the command line: every parameter alone, and what is refused or warned of."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import yaml

from vsr2 import load_study
from vsr2.campaign import RunOptions, load_campaign, save_campaign, simulate_campaign
from vsr2.cli.main import main
from vsr2.effects import Parameter, in_order, library, registry
from vsr2.errors import ConfigError
from vsr2.motion import Record, write_record

BLOCK = {"shape": "box", "size": [0.4, 0.6, 1.2], "density": 2700}
COSINE = {"mode": "single_cosine", "pga_g": 0.4, "pgv_pga_s": 0.1}


@pytest.fixture(autouse=True)
def own_effects_are_forgotten(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(registry, "_registered", {})
    yield
    registry._found.cache_clear()


def write(folder: Path, effects: object, **changed: object) -> Path:
    study = {
        "name": "s", "rock": BLOCK, "motion": COSINE, "outcome": {"tail": 10.0},
        "output": {"log_every": 0}, "effects": effects, **changed,
    }  # fmt: skip
    path = folder / "s.yaml"
    path.write_text(yaml.safe_dump(study, sort_keys=False))
    return path


def run(path: Path) -> int:
    out = path.parent / "out"
    return main(
        ["run", str(path), "--out", str(out), "--quiet", "--no-figures", "--overwrite",
         "--threads", "1"]
    )  # fmt: skip


def recordings(folder: Path, count: int) -> dict[str, object]:
    time = np.arange(160) * 0.005
    x = 0.02 * np.sin(np.pi * time / time[-1]) ** 4 * np.sin(4 * np.pi * time)
    a = np.gradient(np.gradient(x, 0.005), 0.005)
    for i in range(count):
        write_record(Record(f"r{i}", 0.005, displacement=x, acceleration=a), folder / f"r{i}.csv")
    return {"mode": "all_recordings", "folder": str(folder), "pattern": "r*.csv"}


def value(parameter: Parameter) -> float | str:
    if parameter.choices:
        return parameter.choices[1]
    return parameter.ppf(0.7) if parameter.prior != "fixed" else parameter.upper


ALONE = [
    (effect.name, parameter)
    for effect in in_order(library())
    for parameter in effect.parameters
    if not parameter.secondary
]


@pytest.mark.parametrize(("name", "parameter"), ALONE, ids=lambda one: getattr(one, "name", one))
def test_every_parameter_alone_is_run_and_written_down(
    name: str, parameter: Parameter, tmp_path: Path
) -> None:
    motion = recordings(tmp_path, 2 if library()[name].stage == "order" else 1)
    path = write(tmp_path, {name: {parameter.name: value(parameter)}}, motion=motion)
    assert run(path) == 0
    kept = json.loads((tmp_path / "out" / "provenance.json").read_text())
    if parameter.name == "flips":  # One trial, which chance spares.
        assert kept["effects"] == {}
        return
    given = kept["effects"][name][0]
    assert given[parameter.name] is not None
    assert set(given) == {one.name for one in library()[name].parameters}
    for one in library()[name].parameters:
        if one.name != parameter.name and not np.isfinite(one.null):
            assert given[one.name] is None


def test_a_campaign_of_a_half_given_effect_is_written_and_read(tmp_path: Path) -> None:
    study = load_study(write(tmp_path, {}))
    effects = {"table_saturation": {"velocity": 0.2, "acceleration": float("inf")}}
    made = simulate_campaign(study, effects=effects, run=RunOptions(threads=1))
    save_campaign(made, tmp_path / "c")
    held = load_campaign(tmp_path / "c").provenance["effects"]
    assert held == {"table_saturation": {"velocity": 0.2, "acceleration": None}}


def test_effects_are_refused_by_file_and_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    effects = {
        "edge_rounding": {"radius": 6},
        "waer": {"loss": 0.1},
        "table_gain": {"chang": 0.1},
        "table_pitch": {"frequency": 8},
    }
    path = write(tmp_path, effects)
    lines = path.read_text().splitlines()

    def at(key: str) -> str:
        return (
            f"{path}:{next(i for i, line in enumerate(lines, 1) if line.strip().startswith(key))}"
        )

    reported = [
        f"{at('radius')}: effects.edge_rounding.radius: 6 m is outside 0 to 0.5 m",
        f"{at('waer')}: effects.waer: there is no effect 'waer'; did you mean `wear`",
        f"{at('chang')}: effects.table_gain.chang: has no parameter 'chang'; did you mean `change`",
        f"{at('frequency')}: effects.table_pitch.frequency: does nothing on its own; give `comp",
    ]
    for command in (
        ["run", str(path)],
        ["config", "check", str(path)],
        ["fragility", str(path)],
        ["campaign", "simulate", str(path), "--out", str(tmp_path / "c")],
    ):
        assert main(command) == 2
        errors = capsys.readouterr().err
        assert "4 problems" in errors
        for text in reported:
            assert text in errors, command
    assert "give `compliance` too" in errors
    assert not (tmp_path / "out").exists()


@pytest.mark.filterwarnings("default")
def test_a_value_outside_the_prior_is_reported_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path, {"table_gain": {"change": 0.3}})
    assert run(path) == 0
    assert capsys.readouterr().err.splitlines() == [
        "vsr2: warning: effects.table_gain.change: 0.3 is outside the prior, -0.15 to 0.15"
    ]


@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize(
    "effects", [{"wear": {"loss": 0.1}}, {"change_point": {"slenderness_change": 0.1}}]
)
def test_an_effect_over_a_campaign_of_one_trial_is_warned_of(
    effects: dict[str, object], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name = next(iter(effects))
    assert run(write(tmp_path, effects)) == 0
    (reported,) = capsys.readouterr().err.splitlines()
    assert reported.startswith(f"vsr2: warning: effects.{name}: comes in over a campaign")
    assert "does not act in the only trial; give more motions" in reported


@pytest.mark.parametrize(
    "effects",
    [
        {"table_pitch": {"compliance": 0.01}},
        {"vertical_motion": {"share": 0.1}},
        {"off_axis_motion": {"share": 0.1}},
    ],
)
def test_a_motor_cannot_move_beside_x(
    effects: dict[str, object], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path, effects, motion=COSINE | {"drive": "motor"})
    assert run(path) == 2
    assert f"effects.{next(iter(effects))}: moves the pedestal" in capsys.readouterr().err


def test_a_record_without_the_channel_is_refused_by_the_effects_key(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    x = 0.01 * np.sin(np.linspace(0, np.pi, 100)) ** 4
    write_record(Record("r", 0.005, displacement=x), tmp_path / "r.csv")
    motion = {"mode": "all_recordings", "folder": str(tmp_path), "pattern": "r.csv"}
    assert run(write(tmp_path, {"input_channel": {"channel": "acceleration"}}, motion=motion)) == 2
    errors = capsys.readouterr().err
    assert "effects.input_channel.channel: acceleration cannot be built for 'r'" in errors
    assert "motion.channel" not in errors


def test_an_entry_point_that_fails_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Entry:
        value = "pads:Pad"

        def load(self) -> object:
            raise TypeError("no such luck")

    monkeypatch.setattr(registry, "entry_points", lambda group: [Entry()])
    registry._found.cache_clear()
    with pytest.raises(ConfigError, match=r"entry point pads:Pad .* \(TypeError: no such luck\)"):
        library()
    assert main(["effects", "show", "catch"]) == 2
    assert "pads:Pad" in capsys.readouterr().err


def test_a_mesh_that_is_not_there_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["effects", "check", "catch", "--mesh", "nofile.obj"]) == 2
    assert "nofile.obj: no such file" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["configs/demo.yaml", "nothing/here"])
def test_what_is_no_python_file_is_reported(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["effects", "check", name]) == 2
    assert f"{name}: is no Python file; give a .py file" in capsys.readouterr().err


def test_effects_of_a_file_join_the_library_of_any_verb(monkeypatch, tmp_path, capsys):
    file = Path(__file__).parents[2] / "docs" / "examples" / "soft_pad.py"
    assert main(["effects", "show", "soft_pad"]) == 2
    assert main(["effects", "show", "soft_pad", "--effects", str(file)]) == 0
    assert "soft_pad" in capsys.readouterr().out
    monkeypatch.setattr(registry, "_registered", {})
    for name, words in (("none.py", "no such file"), ("my_effect.txt", "is no Python file")):
        assert main(["effects", "list", "--effects", str(tmp_path / name)]) == 2
        assert words in capsys.readouterr().err
