"""Samples of a diagnosis for ArviZ, and priors of the command line."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from vsr2.cli.options import prior
from vsr2.diagnosis import Diagnosis
from vsr2.effects import effect, library
from vsr2.ensemble import LogUniform, Normal, Uniform
from vsr2.ensemble.simulated.library import free_parameters
from vsr2.errors import DiagnosisError


def named(name: str, *, complete: bool, draws: int = 20) -> Diagnosis:
    """A diagnosis with samples of one effect, of its free parameters or of all."""
    one = effect(name)
    held = one.parameters if complete else free_parameters(one)
    rng = np.random.default_rng(3)
    return Diagnosis({}, (), {name: rng.normal(size=(draws, len(held)))})


@pytest.mark.parametrize("complete", [False, True])
def test_samples_have_names_units_and_one_chain(complete: bool) -> None:
    pytest.importorskip("arviz")
    some = next(
        e.name for e in library().values() if 0 < len(free_parameters(e)) < len(e.parameters)
    )
    for name in ("table_gain", some):
        found = named(name, complete=complete)
        data = found.to_inference_data().posterior
        free = free_parameters(effect(name))
        assert sorted(data.data_vars) == sorted(f"{name}.{p.name}" for p in free)
        assert dict(data.sizes) == {"chain": 1, "draw": 20}
        held = list(effect(name).parameters if complete else free)
        for parameter in free:
            variable = data[f"{name}.{parameter.name}"]
            column = found.samples[name][:, held.index(parameter)]
            np.testing.assert_array_equal(variable[0], column)
            assert variable.attrs == {"units": parameter.unit, "long_name": parameter.meaning}


def test_arviz_sums_up_what_it_is_given() -> None:
    arviz = pytest.importorskip("arviz")
    found = named("table_gain", complete=True, draws=400)
    summary = arviz.summary(found.to_inference_data(), kind="stats")
    [row] = summary.index
    assert row == "table_gain.change"
    # As it rounds to three digits.
    assert summary.loc[row, "mean"] == pytest.approx(found.samples["table_gain"].mean(), abs=6e-4)


def test_no_samples_and_no_arviz_are_said(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(DiagnosisError, match="names no effect"):
        Diagnosis({}).to_inference_data()
    monkeypatch.setitem(sys.modules, "arviz", None)
    with pytest.raises(DiagnosisError, match=r"pip install vsr2\[arviz\]"):
        named("table_gain", complete=True).to_inference_data()


def test_priors_of_the_command_line_are_distributions() -> None:
    given = {
        "-0.3:0.1": (-0.3, 0.1),
        "uniform:-0.3:0.1": Uniform(-0.3, 0.1),
        "loguniform:0.5:2": LogUniform(0.5, 2.0),
        "normal:0.01:0.02": Normal(sd=0.02, mean=0.01),
    }
    for text, wanted in given.items():
        assert prior(f"table_gain.change={text}") == ("table_gain.change", wanted)
