"""Small campaigns for tests, and equality of campaigns."""

import datetime
from dataclasses import fields

import numpy as np

from vsr2.campaign import Campaign, CampaignTrial, MeasurementNoise, Series, Specimen
from vsr2.motion import Record


def record(name="m", interval=0.005, scale=1.0, acceleration=True):
    time = np.arange(400) * interval
    displacement = scale * 0.02 * (1 - np.cos(2 * np.pi * time))
    return Record(
        name=name,
        sample_interval=interval,
        displacement=displacement,
        acceleration=np.gradient(np.gradient(displacement, interval), interval)
        if acceleration
        else None,
    )


def series(rows=20):
    time = np.arange(rows) * 0.02
    half = 0.05 * time
    turn = np.stack([0 * half, np.sin(half), 0 * half, np.cos(half)], axis=1)
    return Series(
        time=time,
        tilt=0.1 * time,
        position=np.stack([0.01 * time, 0 * time, 0.002 * time], axis=1),
        orientation=turn,
        noise_tilt=0.002,
    )


def campaign(**changes):
    values = {
        "name": "sample",
        "description": "three trials",
        "trials": (
            CampaignTrial(
                trial="A1",
                motion="pulse one",
                session="2021-06-21",
                order=3,
                specimen="block",
                overturned=False,
                motion_file="pulse",
                peak_tilt=0.0123456789012345,
                pga_g=1.25,
                pgv_pga_s=0.08,
                date=datetime.date(2021, 6, 21),
                extra={"x_peer": 1.0, "x_other": -2.5e-7},
                series=series(),
            ),
            CampaignTrial(
                trial="A2",
                motion="pulse one",
                session="2021-06-21",
                order=4,
                specimen="block",
                overturned=True,
                motion_file="pulse",
                note='caught, "by hand"',
                extra={"x_peer": 0.0},
            ),
            CampaignTrial(trial="B", motion="other", session="2", order=9, specimen="rock"),
        ),
        "motions": {"pulse": record("pulse")},
        "specimens": {"block": Specimen("granite", 120.5), "rock": Specimen()},
        "noise": MeasurementNoise(displacement=4.5e-5, peak_tilt=0.002),
        "provenance": {"seed": 3, "text": "1e7", "list": [1, 2.5e-07, None], "on": True},
    }
    return Campaign(**(values | changes))


def grid(motions=12, scalings=9, seed=1):
    """Trials whose outcome follows a threshold per motion."""
    rng = np.random.default_rng(seed)
    trials = []
    for m in range(motions):
        ratio = float(rng.uniform(0.02, 0.2))
        for _ in range(scalings):
            pga = float(rng.uniform(0.5, 10.0))
            trials.append(
                CampaignTrial(
                    trial=f"T{len(trials)}",
                    motion=f"M{m}",
                    session="1",
                    order=len(trials),
                    specimen="rock",
                    overturned=pga > 4.0 + rng.normal(0, 0.5),
                    pga_g=pga,
                    pgv_pga_s=ratio,
                )
            )
    return Campaign(name="grid", trials=tuple(trials), specimens={"rock": Specimen()})


def assert_equal(one, other):
    """Everything but where files lie."""
    assert (one.name, one.description, one.noise) == (other.name, other.description, other.noise)
    assert one.provenance == other.provenance
    assert set(one.specimens) == set(other.specimens)
    for key, specimen in one.specimens.items():
        assert (specimen.description, specimen.mass) == (
            other.specimens[key].description,
            other.specimens[key].mass,
        )
    assert set(one.motions) == set(other.motions)
    for key, motion in one.motions.items():
        assert motion.sample_interval == other.motions[key].sample_interval
        for channel in ("displacement", "acceleration"):
            same(getattr(motion, channel), getattr(other.motions[key], channel))
    assert len(one) == len(other)
    for left, right in zip(one.trials, other.trials, strict=True):
        for field in fields(CampaignTrial):
            if field.name != "series":
                assert getattr(left, field.name) == getattr(right, field.name), field.name
        assert (left.series is None) == (right.series is None)
        if left.series is not None:
            for field in fields(Series):
                same(getattr(left.series, field.name), getattr(right.series, field.name))


def same(left, right):
    assert (left is None) == (right is None)
    if left is not None:
        np.testing.assert_array_equal(left, right)
