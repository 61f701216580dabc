"""Callers in Python who mistype an argument, or give an old name, are told the right one."""

from __future__ import annotations

import inspect
import pickle
from collections.abc import Callable
from typing import Any

import pytest

import vsr2
from vsr2.argument_names import checked_names
from vsr2.campaign import Campaign, CampaignTrial, MeasurementNoise, RunOptions, simulate_campaign
from vsr2.diagnosis import Budget, Execution, Hypotheses, iterate
from vsr2.errors import CampaignError, DiagnosisError, MotionError, Renamed, Vsr2Error
from vsr2.motion import Motion, Record

PUBLIC: list[Any] = [getattr(vsr2, name) for name in vsr2.__all__]
PUBLIC = [one for one in PUBLIC if callable(one) and one not in (vsr2.Study, vsr2.Diagnosis)]
"""A study checks its keys as a file's; a diagnosis is made by `diagnose` alone."""
MORE = [Campaign, CampaignTrial, MeasurementNoise, simulate_campaign, Record]
MORE += [Budget, Execution, Hypotheses, iterate]


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


class _Own:
    old = Renamed("new [m]")
    gone = Renamed("something else, a method")

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
