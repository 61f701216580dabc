"""Callers in Python who mistype an argument, or give an old name, read the right one."""

from __future__ import annotations

import inspect
import pickle
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import pytest

import vsr2
from vsr2.argument_names import checked_names
from vsr2.campaign import Campaign, CampaignTrial, MeasurementNoise, RunOptions, simulate_campaign
from vsr2.diagnosis import Budget, iterate
from vsr2.ensemble import Execution, Hypotheses
from vsr2.errors import CampaignError, DiagnosisError, MotionError, Renamed, Vsr2Error
from vsr2.fragility import run_fragility
from vsr2.motion import (
    Motion,
    Record,
    cosine_parameters,
    from_signal,
    read_record,
    response_spectrum,
    synthetic_motion,
)
from vsr2.scene.mesh import mesh_from_arrays

PUBLIC: list[Any] = [getattr(vsr2, name) for name in vsr2.__all__]
PUBLIC = [one for one in PUBLIC if callable(one) and one not in (vsr2.Study, vsr2.Diagnosis)]
"""A study checks its keys as a file's; a diagnosis is made by `diagnose` alone."""
MORE = [Campaign, CampaignTrial, MeasurementNoise, simulate_campaign, Record]
MORE += [Budget, Execution, Hypotheses, iterate]
MORE += [cosine_parameters, synthetic_motion]


@pytest.mark.parametrize("of", [*PUBLIC, *MORE], ids=lambda one: one.__name__)
def test_every_public_callable_names_the_argument_that_is_meant(of: Callable[..., Any]) -> None:
    stated = inspect.signature(of).parameters.values()
    known = [one.name for one in stated if one.kind is not one.VAR_KEYWORD]
    name = max(known, key=len)
    with pytest.raises(Vsr2Error) as raised:
        of(**{f"{name}s": 1})
    text = f"{of.__name__}({name}s=...): is no argument; did you mean `{name}`?"
    assert str(raised.value) == text


@pytest.mark.parametrize(
    ("call", "error", "said"),
    [
        (lambda: CampaignTrial(pga=0.3), CampaignError, "(pga=...): is gone; use pga_g [g]"),
        (lambda: CampaignTrial(pgv_pga=0.1), CampaignError, "is gone; use pgv_pga_s [s]"),
        (lambda: synthetic_motion(pgv_pga=0.1), MotionError, "did you mean `pgv_pga_s`?"),
        (lambda: cosine_parameters(pgv_pga=0.1), MotionError, "did you mean `pgv_pga_s`?"),
        (lambda: RunOptions(thread=1), CampaignError, "did you mean `threads`?"),
        (lambda: Motion(tiem_step=1), MotionError, "did you mean `time_step`?"),
        (lambda: Budget(minute=1), DiagnosisError, "did you mean `minutes`?"),
        (lambda: Budget(zzz=1), DiagnosisError, "known are minutes, simulations, campaigns"),
    ],
)
def test_what_is_said(call: Callable[[], Any], error: type[Vsr2Error], said: str) -> None:
    with pytest.raises(error) as raised:
        call()
    assert said in str(raised.value)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: Motion.from_acceleration([0.0], dt=0.01),
         "from_acceleration(dt=...): is no argument; did you mean `interval`?"),
        (lambda: from_signal([0.0], dt=0.01), "is no argument; did you mean `interval`?"),
        (lambda: Motion(dt=0.01), "Motion(dt=...): is no argument; did you mean `time_step`?"),
        (lambda: Motion.from_acceleration([0.0], zzz=1), "known are acceleration, interval, units"),
        (lambda: vsr2.apply_effects(object.__new__(vsr2.Trial), {}), "got one Trial; give a list"),
        (lambda: vsr2.run_batch({"rock": {}}), "`vsr2.Study.from_dict(mapping)` makes a study"),
        (lambda: mesh_from_arrays("x.obj"), "is of type str; for a mesh in a file, name it in the"),
        (lambda: vsr2.hazard.read_hazard_curve("no.csv"), "no.csv: cannot be read (No such file"),
        (lambda: vsr2.hazard.read_lognormal("no", "pga_g"), "cannot be read (No such file"),
        (lambda: Motion.from_acceleration([0.0], 0.01, unit="g"), "did you mean `units`?"),
        (lambda: Motion.from_obspy(None), "from_obspy: `units` is missing; give it"),
        (lambda: vsr2.build_scene("b.yaml"), "build_scene: got 'b.yaml', a str; give a Study"),
        (lambda: run_fragility("b.yaml"), "run_fragility: got 'b.yaml', a str; give what"),
        (lambda: simulate_campaign("b.yaml"), "got 'b.yaml', a str; give a Study"),
        (lambda: simulate_campaign([1]), "got 1, a int; give a Study"),
        (lambda: vsr2.load_study("b.yaml", overrides="seed=1"), "give a list, as ['seed=1']"),
        (lambda: response_spectrum(3, [1.0]), "got a int; give a Motion"),
        (lambda: read_record("a.csv", format="peeer"), "is unknown; did you mean 'peer'?"),
        (lambda: Budget(minutes="a"), "budget_minutes is a; give a finite number"),
    ],
)  # fmt: skip
def test_calls_that_read_like_another_librarys(call: Callable[[], Any], said: str) -> None:
    with pytest.raises(Vsr2Error) as raised:
        call()
    assert said in str(raised.value)


@pytest.mark.parametrize("of", [*PUBLIC, *MORE], ids=lambda one: one.__name__)
def test_a_signature_can_be_read(of: Callable[..., Any]) -> None:
    text = str(inspect.signature(of))
    assert " at 0x" not in text
    assert len(text) < 1000


def test_settings_show_what_is_given() -> None:
    assert (repr(Budget()), repr(Hypotheses())) == ("Budget()", "Hypotheses()")
    assert repr(Budget(minutes=2.0, waterfall=True)) == "Budget(minutes=2.0, waterfall=True)"
    assert repr(Execution(threads=2)) == "Execution(threads=2)"


@pytest.mark.parametrize(("name", "near"), [("runbatch", "run_batch"), ("simulaton", "simulation")])
def test_a_mistyped_name_of_the_package_gets_its_neighbour(name: str, near: str) -> None:
    with pytest.raises(AttributeError, match=f"no attribute '{name}'; did you mean '{near}'"):
        getattr(vsr2, name)


def test_rooms_are_there_without_an_import_of_their_own() -> None:
    done = subprocess.run(
        [sys.executable, "-c", "import vsr2; print(vsr2.hazard.excluded_age.__name__)"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == "excluded_age\n"


class _Own:
    old = Renamed("new", " [m]")
    gone = Renamed("something", " else, a method")

    def __init__(self, new: float, *, other: int = 0) -> None:
        self.new, self.other = new, other


Own = checked_names(CampaignError)(_Own)


def test_good_calls_signatures_and_pickles_stay_as_they_are() -> None:
    assert (Own(1.0, other=2).new, Own(new=3.0).new) == (1.0, 3.0)
    assert list(inspect.signature(Own).parameters) == ["new", "other"]
    assert pickle.loads(pickle.dumps(Own(4.0))).new == 4.0


def test_a_missing_argument_is_named_and_other_errors_of_type_stay() -> None:
    with pytest.raises(CampaignError, match="_Own: `new` is missing; give it"):
        Own(other=1)
    with pytest.raises(TypeError, match="takes 2 positional arguments but 3"):
        Own(1.0, 2)

    @checked_names(CampaignError)
    def broken(new: float) -> float:
        return new + "text"  # type: ignore[operator]

    with pytest.raises(TypeError, match="unsupported operand"):
        broken(1.0)


def test_an_old_name_is_named_only_where_the_new_one_is_an_argument() -> None:
    with pytest.raises(CampaignError, match=r"_Own\(old=\.\.\.\): is gone; use new \[m\]"):
        Own(old=1.0)
    with pytest.raises(CampaignError, match=r"is no argument; known are new, other"):
        Own(gone=1.0)
