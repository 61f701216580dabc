"""Rate of overturning against closed forms, and hazard curves as OpenQuake writes them."""

import json
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import lognorm

from vsr2.cli.main import main
from vsr2.errors import HazardError
from vsr2.fragility import Lognormal
from vsr2.hazard import (
    HazardCurve,
    excluded_age,
    overturning_rate,
    rate_draws,
    read_hazard_curve,
    read_lognormal,
    survival,
)

LEVELS = np.geomspace(0.01, 2.0, 20)


def power_law(k0: float, k: float) -> HazardCurve:
    return HazardCurve("pga_g", LEVELS, k0 * LEVELS**-k)


@pytest.mark.parametrize("k", [0.5, 2.0, 3.5, 12.0])
@pytest.mark.parametrize(("median", "beta"), [(0.3, 0.4), (0.05, 0.8), (5.0, 0.1), (0.3, 1e-6)])
def test_a_power_law_has_its_closed_form(k, median, beta):
    # Rounding of 20 pieces; the largest term is e^(k^2 beta^2 / 2) = 1e20 times the rate at median.
    rate = overturning_rate(power_law(1e-4, k), median, beta).sum(axis=0)
    assert rate == pytest.approx(1e-4 * median**-k * np.exp(0.5 * (k * beta) ** 2), rel=1e-9)


def test_a_curved_hazard_agrees_with_quadrature():
    rates = 1e-3 * np.exp(-((np.log(LEVELS / 0.01)) ** 2) / 6)
    curve = HazardCurve("pga_g", LEVELS, rates)
    # |d lambda| of the polygon, so the quadrature goes from level to level; by parts it is
    # lambda times the density of the fragility, and adaptive quadrature is good to 1e-8.
    law = lognorm(s=0.5, scale=0.4)
    logs = np.log(LEVELS)
    parts = [
        quad(
            lambda u: np.exp(np.interp(u, logs, np.log(rates))) * law.pdf(np.exp(u)) * np.exp(u),
            low,
            high,
        )[0]
        for low, high in pairwise(logs)
    ]
    amid = sum(parts) + rates[0] * law.cdf(LEVELS[0]) - rates[-1] * law.cdf(LEVELS[-1])
    below, found, above = overturning_rate(curve, 0.4, 0.5)[:, 0]
    assert found == pytest.approx(amid, rel=1e-7)
    assert above == pytest.approx(rates[-1] * law.cdf(2.0), rel=0.05)
    assert 0 < below < 1e-6 * found


def test_a_level_stretch_adds_nothing():
    curve = HazardCurve("pga_g", [0.1, 0.2, 0.4, 0.8], [1e-2, 1e-3, 1e-3, 1e-4])
    # A step at 0.3 falls on the level stretch: all that exceeds it overturns, nothing else does.
    assert overturning_rate(curve, 0.3, 1e-4).sum() == pytest.approx(1e-3, rel=1e-9)


def test_the_age_of_one_rate_is_that_of_a_poisson_process():
    assert excluded_age(2e-4, 0.95) == pytest.approx(-np.log(0.05) / 2e-4, rel=1e-9)
    assert survival([2e-4], excluded_age(2e-4, 0.9)) == pytest.approx(0.1, rel=1e-9)


@pytest.mark.parametrize("rates", [1e-320, [1e-310, 1e-320], [1e-320, 1e-3]])
def test_rates_that_exclude_no_age_are_refused(rates):
    with pytest.raises(HazardError, match="1e-320 per year, which excludes no age; check"):
        excluded_age(rates)


def test_what_is_not_known_makes_the_excluded_age_greater():
    # Gamma-distributed rates: the mean of e^(-rate age) is (1 + age theta)^-shape.
    shape, mean = 2.0, 1e-4
    rates = np.random.default_rng(1).gamma(shape, mean / shape, 400_000)
    age = (0.05 ** (-1 / shape) - 1) * shape / mean
    # The mean of 400,000 values that spread by 0.12 about 0.05 has an error of 0.4 %, the age less.
    assert excluded_age(rates) == pytest.approx(age, rel=0.01)
    assert age > excluded_age(mean)


def test_draws_spread_as_the_fit_says():
    # With beta known the logarithm of the rate is normal, k times that of the median.
    k, error = 2.0, 0.2
    ends = 0.4 * np.exp(1.959964 * error * np.array([-1, 1]))
    fit = Lognormal(0.4, *ends, 0.5, 0.5, 0.5, fits=True)
    found = rate_draws(power_law(1e-4, k), fit)
    logs = np.log(found.draws)
    assert logs.mean() == pytest.approx(np.log(found.rate), abs=4 * k * error / 4000**0.5)
    assert logs.std() == pytest.approx(k * error, rel=4 / 8000**0.5)
    low, high = found.interval()
    assert low < found.rate < high
    assert 0 <= found.below < 1
    assert 0 <= found.above < 1


OPENQUAKE = (
    "#,,,,\"generated_by='OpenQuake engine 3.16.3', start_date='2024-01-01T00:00:00', "
    "checksum=1, kind='mean', investigation_time=50.0, imt='PGA'\"\n"
    "lon,lat,depth,poe-0.1000000,poe-0.2000000,poe-0.4000000,poe-0.8000000\n"
    "-117.10000,34.20000,0.00000,9.932621E-01,3.934693E-01,4.877058E-02,0.000000E+00\n"
)


def test_a_curve_of_openquake_becomes_rates(tmp_path):
    path = tmp_path / "hazard_curve-mean-PGA_1.csv"
    path.write_text(OPENQUAKE)
    curve = read_hazard_curve(path)
    assert curve.measure == "pga_g"
    assert curve.levels == pytest.approx([0.1, 0.2, 0.4])  # 0.8 g is never exceeded
    # P = 1 - e^(-rate 50): the file has seven digits.
    assert curve.rates == pytest.approx([0.1, 0.01, 0.001], rel=1e-5)
    assert "mean at -117.1, 34.2" in curve.source


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("investigation_time=50.0, ", "", "investigation_time"),
        ("imt='PGA'", "imt='SA(1.0)'", "export PGA"),
        ("lon,lat", "x,y", "lon, lat and poe-LEVEL"),
        ("3.934693E-01", "high", "numbers"),
        ("3.934693E-01", "1.5", "between 0 and 1"),
        ("3.934693E-01", "9.99E-01", "must rise and rates must not"),
        ("9.932621E-01,3.934693E-01", "0,0", "two or more"),
    ],
)
def test_other_files_are_refused(tmp_path, old, new, said):
    path = tmp_path / "curve.csv"
    path.write_text(OPENQUAKE.replace(old, new))
    with pytest.raises(HazardError, match=said) as caught:
        read_hazard_curve(path)
    assert str(path) in str(caught.value)


def test_a_site_is_chosen_by_its_coordinates(tmp_path):
    path = tmp_path / "curve.csv"
    row = OPENQUAKE.splitlines()[2]
    path.write_text(OPENQUAKE + row.replace("34.2", "35.2").replace("4.87", "2.87") + "\n")
    with pytest.raises(HazardError, match=r"2 sites .*--site LON LAT"):
        read_hazard_curve(path)
    with pytest.raises(HazardError, match="0 rows have the site"):
        read_hazard_curve(path, site=(0.0, 0.0))
    assert "35.2" in read_hazard_curve(path, site=(-117.1, 35.2)).source


def test_a_fragility_without_a_curve_is_refused(tmp_path):
    with pytest.raises(HazardError, match="vsr2 fragility"):
        read_lognormal(tmp_path, "pga_g")
    head = (
        "measure,azimuth_deg,median,median_lower,median_upper,beta,beta_lower,beta_upper,fits,note"
    )
    (tmp_path / "lognormal.csv").write_text(f"{head}\npga_g,all,,,,,,,,all_stood\n")
    with pytest.raises(HazardError, match="all_stood"):
        read_lognormal(tmp_path, "pga_g")
    with pytest.raises(HazardError, match="no curve in pgv_m_s"):
        read_lognormal(tmp_path, "pgv_m_s")
    (tmp_path / "lognormal.csv").write_text(f"{head}\npga_g,all,0.5,0.4,0.6,0.3\n")
    with pytest.raises(HazardError, match=r"its row in pga_g lacks beta_lower, beta_upper; run "):
        read_lognormal(tmp_path, "pga_g")
    (tmp_path / "lognormal.csv").write_text(f"{head}\npga_g,all,0.5,0.4,0.6,0.3,0.2,0.4,1,\n")
    assert read_lognormal(tmp_path, "pga_g") == Lognormal(0.5, 0.4, 0.6, 0.3, 0.2, 0.4, fits=True)


def test_the_verb_prints_what_the_functions_give(tmp_path, capsys):
    curve = tmp_path / "curve.csv"
    curve.write_text(OPENQUAKE)
    head = "measure,azimuth_deg,median,median_lower,median_upper,beta,beta_lower,beta_upper,fits"
    (tmp_path / "lognormal.csv").write_text(f"{head}\npga_g,all,0.5,0.4,0.6,0.3,0.2,0.4,1\n")
    assert main(["hazard", str(tmp_path), str(curve), "--age", "5000", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    expected = rate_draws(read_hazard_curve(curve), read_lognormal(tmp_path, "pga_g"))
    assert found["rate_per_year"] == pytest.approx(expected.rate)
    assert found["excluded_age_years"] == pytest.approx(excluded_age(expected.draws))
    assert found["survival"] == pytest.approx(survival(expected.draws, 5000))
    assert found["excluded_age_lower_years"] < found["excluded_age_years"]
    assert main(["hazard", str(tmp_path), str(curve), "--age", "5000"]) == 0
    assert f"{expected.rate:.3g} per year" in capsys.readouterr().out
    assert main(["hazard", str(tmp_path), str(curve), "--age", "-1"]) == 2
    assert "--age" in capsys.readouterr().err
