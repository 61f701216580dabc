"""What a pack must not tell: leaks, decoys, magnitudes, and the baselines that look for them."""

import csv
import shutil
import subprocess
from pathlib import Path
from time import sleep

import numpy as np
import pytest

import vsr2.blind.custodian.pack_making as make_module
from blind_samples import QuickEngine, make, pulses
from vsr2.blind import PackSettings
from vsr2.blind.custodian.campaign_recording import recorded_campaign
from vsr2.blind.custodian.design import draw_protocol
from vsr2.blind.custodian.engine import TrialInput, build_engine
from vsr2.blind.form.diagnosis_form import ReportedVerdict
from vsr2.blind.form.pack_settings import CLASSES
from vsr2.blind.form.seal import open_key
from vsr2.blind.mujoco import Response
from vsr2.blind.scoring.baselines import (
    BASELINES,
    _guess,
    _verdict,
    baseline_cases,
    logistic_in_pga,
    overturn_rate,
    rate_alone,
)
from vsr2.blind.scoring.cases import Case, class_label
from vsr2.blind.scoring.leaks import _leak, find_leaks
from vsr2.blind.scoring.metadata import metadata
from vsr2.blind.scoring.score import right
from vsr2.campaign import (
    Campaign,
    CampaignTrial,
    Specimen,
    load_campaign,
    save_campaign,
)
from vsr2.diagnosis.verdict.statements import VerdictKind


class UnevenEngine(QuickEngine):
    """Ends a trial when effects have it, on a step of its own; what overturns falls flat."""

    def run(self, shakes, series_interval):
        for shake in shakes:
            seen = next(iter(super().run([shake], series_interval)))
            length = (shake.displacement.size - 1) * shake.interval
            length += 0.2 * sum(1 + list(self.effects).index(name) for name in shake.effects)
            time = np.arange(0.0, length, 1.03 * series_interval)
            tilt = seen.peak_tilt * np.sin(np.pi * time / length)
            if seen.overturned:
                tilt = 1.5 * (time / length) ** 2
            turned = np.stack([0 * time, np.sin(tilt / 2), 0 * time, np.cos(tilt / 2)], axis=1)
            yield Response(
                seen.overturned,
                max(seen.peak_tilt, tilt.max()),
                time,
                tilt,
                np.outer(tilt, [0.3, 0.2, 0.1]),
                turned,
            )


def births(data):
    """When the folders of a pack's campaigns were made [s], in order of their names."""
    folders = sorted(path for path in data.glob("c*") if path.is_dir())
    reported = subprocess.run(["stat", "-c", "%.9W", *folders], capture_output=True, text=True)
    return np.array([float(line) for line in reported.stdout.split() if line != "-"])


def test_when_a_campaign_was_made_tells_nothing(uneven, study, tmp_path, monkeypatch) -> None:
    save = make_module.save_campaign

    def slowly(*given, **how):
        sleep(0.2)
        save(*given, **how)

    monkeypatch.setattr(make_module, "save_campaign", slowly)
    make(study, tmp_path)
    made = births(tmp_path / "data")
    if not made.any():
        pytest.skip("this file system does not keep when a folder was made")
    assert (np.diff(made) > 0).all()
    assert np.diff(made).max() < 0.2


@pytest.fixture
def uneven(monkeypatch):
    monkeypatch.setattr(make_module, "build_engine", lambda *given: UnevenEngine())


def structure(folder):
    """All that a campaign's files say apart from what was measured, and its name."""
    files = sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*"))
    stamps = {p.stat().st_mtime for p in [folder, *folder.rglob("*")]}
    lines = (folder / "campaign.yaml").read_text().splitlines()
    with open(folder / "trials.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    arrays = {}
    for path in sorted(folder.rglob("*.npz")):
        with np.load(path) as content:
            arrays[path.parent.name] = sorted((k, v.dtype.str, v.ndim) for k, v in content.items())
    fixed = [
        [value for key, value in row.items() if key not in ("overturned", "peak_tilt_rad")]
        for row in rows
    ]
    return {
        "files": files,
        "stamps": stamps,
        "description": [line for line in lines if not line.startswith("name:")],
        "columns": list(rows[0]),
        "fixed": fixed,
        "arrays": arrays,
    }


def standing_times(campaign):
    """Times of the series, by trial, of rocks that did not fall."""
    return {t.trial: t.series.time for t in campaign.trials if t.peak_tilt < 1.1}


def on_one_clock(campaigns):
    """Whether all series are sampled at the same times, but for rocks that fell."""
    clock = {}
    for campaign in campaigns:
        for trial, time in standing_times(campaign).items():
            clock.setdefault(trial, time)
            np.testing.assert_array_equal(time, clock[trial], err_msg=f"{campaign.name} {trial}")
    return clock


def same_rounded(values, decimals):
    np.testing.assert_array_equal(np.round(values, decimals), values)


def test_campaigns_differ_in_what_was_measured_alone(uneven, study, tmp_path) -> None:
    make(study, tmp_path)
    data = tmp_path / "data"
    key = open_key(data, tmp_path / "key")
    shapes = {name: structure(data / name) for name in key["campaigns"]}
    first = next(iter(shapes.values()))
    assert all(shape == first for shape in shapes.values())
    assert len(first["stamps"]) == 1
    campaigns = [load_campaign(data / name) for name in key["campaigns"]]
    assert len(on_one_clock(campaigns)) > 4
    fallen = []
    for name, campaign in zip(key["campaigns"], campaigns, strict=True):
        assert campaign.name == name
        assert not campaign.provenance
        assert not campaign.description
        assert all(not trial.note and trial.date is None for trial in campaign.trials)
        for trial in campaign.trials:
            record, series = campaign.record(trial), trial.series
            same_rounded([trial.peak_tilt, trial.pgv_pga_s], 5)
            for values in (series.time, series.tilt, series.position):
                same_rounded(values, 6)
            same_rounded(series.orientation, 7)
            same_rounded(record.displacement, 8)
            same_rounded(record.acceleration, 5)
            # 1.2 rad and five standard errors: whichever engine let it fall, and how far.
            assert max(trial.peak_tilt, series.tilt.max()) < 1.2 + 5 * 0.0005
            if trial.peak_tilt > 1.1:
                fallen.append(float(series.tilt[-1]))
    assert len(fallen) > 10
    assert min(fallen) > 1.1


def test_series_of_either_engine_end_on_one_clock(study, tmp_path) -> None:
    pytest.importorskip("mujoco", reason="the blind extra installs mujoco")
    settings = PackSettings(trials=4, motions=2, sessions=1, catalogue=2)
    motions = pulses(1, 2)
    drawn = draw_protocol(np.random.default_rng(3), motions, [5.5] * 2, settings)
    campaigns = []
    for engine in (build_engine(name, study) for name in ("bullet", "mujoco")):
        for name in (None, "table_bandwidth", "time_scale", "table_saturation", "table_resonance"):
            acting = {}
            if name is not None:
                effect = engine.effects[name]
                sign, (_, most) = next(iter(effect.strength.reach().items()))
                acting = {name: effect.values(sign * most, [0.5] * len(effect.others))}
            shakes = [
                TrialInput(motion.interval, motion.displacement * row.peak_acceleration, acting)
                for row, motion in zip(drawn.rows, drawn.motions, strict=True)
            ]
            seen = list(engine.run(shakes, settings.series_interval))
            rng = np.random.default_rng(1)
            campaigns.append(recorded_campaign(str(name), drawn, seen, settings, rng))
            # The camera runs on until the rock stands still.
            for trial in campaigns[-1].trials:
                assert trial.peak_tilt > 1.1 or abs(trial.series.tilt[-50:]).max() < 0.005
    # 1.195 s of motion and 3 s.
    times = on_one_clock(campaigns)
    assert len(times) == 4
    for time in times.values():
        np.testing.assert_array_equal(time, np.round(0.02 * np.arange(210), 6))
    # The last of these times over 209 is not 0.02.
    save_campaign(campaigns[0], tmp_path / "c")
    assert "series_interval_s: 0.02\n" in (tmp_path / "c" / "campaign.yaml").read_text()


def test_noise_does_not_tell_which_rock_falls() -> None:
    # Series of 40 rocks at rest, which say that they fell or that they did not, scatter as stated.
    settings = PackSettings(trials=40, motions=1, sessions=1, catalogue=1)
    drawn = draw_protocol(np.random.default_rng(3), pulses(1, 1), [5.5], settings)
    time = np.arange(0.0, 20.0, 0.1)
    rest = np.tile([0.0, 0.0, 0.0, 1.0], (time.size, 1))
    for largest in (0.3, 2.0):
        seen = [Response(False, largest, time, 0.1 + 0 * time, np.zeros((time.size, 3)), rest)] * 40
        campaign = recorded_campaign("c", drawn, seen, settings, np.random.default_rng(1))
        series = [trial.series for trial in campaign.trials]
        found = {
            "tilt_noise": np.concatenate([s.tilt for s in series]).std(),
            "position_noise": np.concatenate([s.position for s in series]).std(),
            "orientation_noise": 2 * np.concatenate([s.orientation[:, :3] for s in series]).std(),
        }
        for name, deviation in found.items():
            stated = getattr(settings.tolerances, name)
            # 8,000 rows or more: within 1 %.
            assert deviation == pytest.approx(stated, rel=0.04), (largest, name)


def test_ids_tell_neither_kind_nor_order(quick, study, tmp_path) -> None:
    make(study, tmp_path, single=8, none=8, pair=0, unknown=0)
    key = open_key(tmp_path / "data", tmp_path / "key")
    kinds = [key["campaigns"][name]["kind"] for name in sorted(key["campaigns"])]
    # Sorted by kind is 1 of 6435 arrangements.
    assert kinds not in (sorted(kinds), sorted(kinds, reverse=True))
    text = (tmp_path / "data" / "pack.json").read_text()
    assert "single" not in text
    assert "seed" not in text


def test_what_the_files_say_beside_the_response_tells_nothing(uneven, study, tmp_path) -> None:
    effects = ("restitution", "friction")
    counts = {"single": 16, "none": 2, "trials": 16, "pair": 0, "unknown": 0, "effects": effects}
    packs = []
    for seed in (1, 2):
        make(study, tmp_path / str(seed), seed=seed, **counts)
        data = tmp_path / str(seed) / "data"
        packs += [data, open_key(data, tmp_path / str(seed) / "key")]
    cases = [
        Case(
            id=name,
            tier="M",
            kind=entry["kind"],
            engine=entry["engine"],
            truth=(entry["effects"][0]["name"] if entry["effects"] else "none",),
            effects=tuple(entry["effects"]),
            exclude=(),
            relative=1.0,
            flips=0.5,
            where={},
            trials=(),
            verdict=ReportedVerdict(VerdictKind.NONE),
            classes=(),
        )
        for name, entry in packs[3]["campaigns"].items()
    ]
    judged = baseline_cases(cases, packs[2], packs[0], packs[1])
    assert {case.tier for case in judged} == set(BASELINES)
    assert len(judged) == len(BASELINES) * len(cases)
    for case in judged:
        assert sum(case.verdict.probabilities.values()) == pytest.approx(1.0)
    # Chance is 8 of 16; 14 or more happen by chance in 1 of 480 packs.
    reported = [case for case in judged if case.tier == "metadata" and case.kind == "single"]
    assert sum(right(case) for case in reported) < 14
    assert set(rate_alone(packs[2], packs[3])) == {"none"}


def test_a_planted_leak_is_found_and_a_clean_pack_has_none(uneven, study, tmp_path) -> None:
    counts = {"single": 10, "none": 3, "unknown": 5, "pair": 0, "engines": ("mujoco", "bullet")}
    make(study, tmp_path, **counts)
    data = tmp_path / "data"
    key = open_key(data, tmp_path / "key")
    clean = {leak.question: leak for leak in find_leaks(data, key)}
    assert set(clean) == {"engine", "kind", "class"}
    assert all(leak.p > 0.01 for leak in clean.values())
    entries = key["campaigns"]
    one = [class_label(e["effects"][0]["name"], CLASSES) for e in entries.values() if e["effects"]]
    assert clean["class"].count == sum(one.count(label) > 1 for label in one)
    # What is left out of an unknown campaign's library is left out of no other.
    alone = {name: ["a" if e["kind"] != "unknown" else name] for name, e in entries.items()}
    telling = {"campaigns": {n: e | {"exclude": alone[n]} for n, e in entries.items()}}
    found = {leak.question: leak for leak in find_leaks(data, key | telling)}
    assert found["kind"].p <= 0.01
    assert found["kind"].best == "campaigns_that_lack_the_same_effects"
    labels = {
        "engine": {name: e["engine"] for name, e in entries.items()},
        "kind": {name: e["kind"] for name, e in entries.items()},
        "class": {n: class_label(e["effects"][0]["name"], CLASSES) if e["effects"] else ""
                  for n, e in entries.items()},
    }  # fmt: skip
    for question, answers in labels.items():
        numbers = {answer: i for i, answer in enumerate(sorted(set(answers.values())))}
        shutil.copytree(data, tmp_path / question)
        for name, answer in answers.items():
            # The file is as many bytes longer as the answer's number.
            with (tmp_path / question / name / "campaign.yaml").open("a") as file:
                file.write("#" * (1 + numbers[answer]) + "\n")
        found = {leak.question: leak for leak in find_leaks(tmp_path / question, key)}
        assert found[question].p <= 0.01
        assert found[question].rate == pytest.approx(1.0)
        assert found[question].best == "size_of_campaign_file"


def test_leaks_of_chance_are_as_rare_as_their_p_says() -> None:
    # 60 packs of 40 campaigns with five numbers that tell nothing: p is uniform.
    from scipy.stats import kstest

    rng = np.random.default_rng(2)
    found = [
        _leak(
            "kind", {f"n{i}": rng.standard_normal(40) for i in range(5)}, rng.integers(4, size=40)
        )
        for _ in range(60)
    ]
    assert kstest([leak.p for leak in found], "uniform").pvalue > 0.01


def test_the_response_is_no_metadata(uneven, study, tmp_path) -> None:
    make(study, tmp_path, single=12, none=2, unknown=0, pair=0)
    data = tmp_path / "data"
    numbers = [metadata(load_campaign(f), f) for f in sorted(data.glob("c*"))]
    rates = [overturn_rate(load_campaign(f), f) for f in sorted(data.glob("c*"))]
    assert len({rate[0] for rate in rates}) > 1
    assert all(row == numbers[0] for row in numbers)


def test_baselines_do_not_depend_on_units() -> None:
    rng = np.random.default_rng(1)
    labels = np.repeat(["friction", "none", "wear"], 8)
    x = rng.normal(size=(24, 2)) + (labels == "wear")[:, None]
    z = rng.normal(size=(5, 2))
    names, found = _guess(x, labels, z)
    assert names == ["friction", "none", "wear"]
    scaled = np.array([1e-3, 1e3])
    np.testing.assert_allclose(_guess(5 + x * scaled, labels, 5 + z * scaled)[1], found, rtol=1e-4)


def test_a_baseline_s_set_holds_nine_tenths() -> None:
    reported = _verdict(["friction", "none", "wear"], np.array([0.3, 0.61, 0.09]))
    assert (reported.kind, reported.conformal) == ("none", ("none", "friction"))
    assert _verdict(["friction", "none"], np.array([0.95, 0.05])).conformal == ("friction",)


def test_baselines_know_what_they_are_named_after() -> None:
    """Trials that overturn beyond a PGA, the lower the greater PGV/PGA."""
    rng = np.random.default_rng(0)
    trials = []
    for i in range(400):
        pga, ratio = np.exp(rng.uniform(-1, 1, 2))
        over = rng.random() < 1 / (1 + np.exp(-(4 * np.log(pga) + 2 * np.log(ratio))))
        trials.append(
            CampaignTrial(
                trial=f"T{i}",
                motion=f"m{i}",
                session="1",
                order=i,
                specimen="rock",
                overturned=bool(over),
                pga_g=float(pga),
                pgv_pga_s=float(ratio),
            )
        )
    campaign = Campaign("c", tuple(trials), specimens={"rock": Specimen()})
    share = float(np.mean([t.overturned for t in trials]))
    assert overturn_rate(campaign, Path()) == [pytest.approx(share)]
    _, first, second = logistic_in_pga(campaign, Path())
    # The standard error of a slope is about 0.3.
    assert first == pytest.approx(4, abs=1.2)
    assert second == pytest.approx(2, abs=1.0)
