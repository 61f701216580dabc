"""What a pack must not tell: leaks, decoys, magnitudes, and the baselines that look for them."""

import csv
import math
import shutil
import subprocess
from collections import Counter
from pathlib import Path
from time import sleep

import numpy as np
import pytest

import vsr2.blind.custodian.make as make_module
from blind_samples import QuickEngine, make, pulses
from vsr2.blind import PackSettings
from vsr2.blind.custodian.campaign_recording import recorded_campaign
from vsr2.blind.custodian.design import draw_protocol
from vsr2.blind.custodian.engine import TrialInput, build_engine
from vsr2.blind.custodian.plan import directions, draw_plan
from vsr2.blind.form.diagnosis_form import Verdict
from vsr2.blind.form.pack_settings import CLASSES
from vsr2.blind.form.seal import open_key
from vsr2.blind.mujoco import Drawable, Parameter, Response
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
from vsr2.errors import BlindError


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
            same_rounded([trial.peak_tilt, trial.pgv_pga], 5)
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
                TrialInput(motion.interval, motion.displacement * row.pga, acting)
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


def drawn_plan(seed, settings, effects, limits):
    """Campaigns where the signal is in proportion to the magnitude, and the limits are true."""

    def measure(engine, protocol, effect, values):
        strength = effect.strength
        value = values[strength.name]
        size = 1 / value if strength.reciprocal else value - strength.null
        return abs(size) / limits[engine, effect.name, 1 if size > 0 else -1]

    return draw_plan(seed, settings, effects, limits, measure).campaigns


def test_what_may_not_be_used_does_not_tell_the_kind() -> None:
    # Kind, exclude, protocol and place in the list of 900 campaigns: independent.
    from scipy.stats import chi2_contingency, kruskal

    settings = PackSettings(single=0, none=450, pair=0, unknown=450, protocols=3, hidden=4)
    limits = {("mujoco", name, 1): 0.05 for name in QuickEngine.effects}
    plan = drawn_plan(5, settings, {"mujoco": QuickEngine.effects}, limits)
    assert len({p.exclude for p in plan}) == 4
    for trait in ("exclude", "protocol"):
        cells = Counter((p.kind, getattr(p, trait)) for p in plan)
        kinds, values = zip(*cells, strict=True)
        table = [[cells[k, v] for v in sorted(set(values))] for k in sorted(set(kinds))]
        assert chi2_contingency(table).pvalue > 0.01, trait
    for key in (lambda p: p.id, lambda p: p.index):
        ordered = [p.kind for p in sorted(plan, key=key)]
        indices = [[i for i, k in enumerate(ordered) if k == kind] for kind in ("none", "unknown")]
        assert kruskal(*indices).pvalue > 0.01


def planned(seed=5, engines=("mujoco",), limits=None, **changes):
    """A plan of many campaigns, and its settings."""
    counts = {"single": 0, "none": 0, "pair": 0, "unknown": 0}
    settings = PackSettings(engines=engines, **(counts | changes))
    known = {name: QuickEngine.effects for name in engines}
    limits = limits or {(e, name, 1): 0.05 for e in engines for name in known[e]}
    return drawn_plan(seed, settings, known, limits), settings


def only_one_class_drawn():
    """A plan in which every draw but one effect's is measured far beyond six limits."""
    effects = {"mujoco": QuickEngine.effects}
    limits = {("mujoco", name, 1): 0.05 for name in QuickEngine.effects}

    def measure(engine, protocol, effect, values):
        return 2.0 if effect.name == "wear" else 99.0

    settings = PackSettings(single=1, none=1, pair=0, unknown=2)
    return draw_plan(5, settings, effects, limits, measure)


def test_each_campaign_lacks_a_class_that_is_not_its_own() -> None:
    plan, settings = planned(single=40, none=40, pair=40, unknown=40, reference=4, hidden=3)
    assert [one.exclude for one in plan if one.kind == "reference"] == [()] * 4
    plan = [one for one in plan if one.kind != "reference"]
    for one in plan:
        own = {settings.class_of(effect.name) for effect in one.effects}
        assert one.exclude
        assert (settings.class_of(one.exclude[0]) in own) == (one.kind == "unknown")
    kinds = {one.kind for one in plan}
    left_out = {kind: {p.exclude for p in plan if p.kind == kind} for kind in kinds}
    assert all(found == left_out["none"] for found in left_out.values())
    assert len(left_out["none"]) == 3


def test_how_often_a_class_is_left_out_does_not_tell_the_kind() -> None:
    # Decoys of a class are in proportion to its unknown campaigns, up to what dealing whole
    # campaigns and a campaign's own class allow. Dealt at random they have a deviation of 3.
    engines, reported = ("mujoco", "bullet"), []
    for seed in range(30):
        plan, _ = planned(
            seed, engines, single=(30, 10), none=(16, 4), unknown=(10, 4), pair=(10, 2), hidden=4
        )
        counts = Counter((p.exclude, p.kind == "unknown") for p in plan)
        for members in {p.exclude for p in plan}:
            assert abs(counts[members, False] - 72 / 14 * counts[members, True]) < 2.0
        alike = Counter(p.exclude for p in plan)
        unknown, others = (
            np.array([alike[p.exclude] for p in plan if (p.kind == "unknown") == asked])
            for asked in (True, False)
        )
        reported.append(
            (unknown[:, None] < others).mean() + (unknown[:, None] == others).mean() / 2
        )
    assert np.mean(reported) == pytest.approx(0.5, abs=0.01)
    # Where each effect is left out in turn, as far as there are campaigns for it.
    plan, _ = planned(leave_one_out=1, none=6)
    counts = Counter((p.exclude, p.kind) for p in plan)
    assert all(counts[members, "none"] == counts[members, "unknown"] for members, _ in counts)


def test_too_few_classes_to_leave_out_are_refused(quick, study, tmp_path) -> None:
    for change in (
        {"single": 2, "pair": 1, "hidden": 2},
        {"single": 2, "none": 1, "effects": ("friction",)},
        {"none": 1, "unknown": 1, "effects": ("table_gain", "slenderness")},
        {"pair": 1, "effects": ("friction", "wear")},
        {"leave_one_out": 1, "none": 1, "effects": ("friction",)},
    ):
        counts = {"single": 0, "none": 0, "pair": 0, "unknown": 0}
        with pytest.raises(BlindError, match="would tell the kind"):
            make(study, tmp_path, **(counts | change))
        # Before any work.
        assert not (tmp_path / "key").exists()
    limits = {("mujoco", name, 1): 0.05 for name in ("wear", "friction")}
    with pytest.raises(BlindError, match="this pack needs 3"):
        planned(single=2, pair=1, limits=limits)
    assert len(planned(single=2, none=2, unknown=2, limits=limits)[0]) == 6
    # All decoys would be of the one unknown effect's class but those of campaigns that have it.
    with pytest.raises(BlindError, match="of one class alone"):
        PackSettings(engines=("bullet", "mujoco"), single=2, unknown=1)
    with pytest.raises(BlindError, match="all unknown effects that could be drawn"):
        only_one_class_drawn()
    PackSettings(single=0, pair=0, none=2, unknown=1)
    PackSettings(engines=("bullet", "mujoco"), single=2, unknown=(2, 1))
    assert len(planned(leave_one_out=2, limits=limits)[0]) == 4


def test_where_each_effect_is_left_out_so_is_each_class_as_a_decoy() -> None:
    from scipy.stats import chi2_contingency

    plan, _ = planned(none=600, leave_one_out=100, hidden=2)
    cells = Counter((p.kind, p.exclude) for p in plan)
    values = sorted({p.exclude for p in plan})
    # table_gain and slenderness are one class: it comes twice as often in both.
    assert len(values) == 5
    table = [[cells[kind, value] for value in values] for kind in ("none", "unknown")]
    assert chi2_contingency(table).pvalue > 0.01
    assert cells["unknown", ("slenderness", "table_gain", "table_pitch")] == 200


def test_magnitudes_lie_from_half_a_limit_to_six() -> None:
    # As a tether: strong wherever it acts, here from 2, 5, 7 and 100 limits on.
    engine = {
        name: Drawable(name, Parameter("slack", "1", 0.0, low, 0.9))
        for name, low in (("weak", 0.02), ("some", 0.05), ("strong", 0.07), ("tether", 0.5))
    }
    engine["catch"] = Drawable("catch", Parameter("slack", "1", math.inf, 5.0, 25.0, True))
    engine["gain"] = Drawable("gain", Parameter("change", "1", 0.0, -0.3, 0.3))
    limits = {("mujoco", name, 1): 0.01 for name in engine if name != "tether"}
    limits |= {
        ("mujoco", "tether", 1): 0.005,
        ("mujoco", "gain", -1): 0.2,
    }
    limits["mujoco", "catch", 1] = 0.006
    assert directions({"mujoco": engine}, limits, "mujoco") == [
        ("gain", -1), ("gain", 1), ("some", 1), ("weak", 1)
    ]  # fmt: skip
    settings = PackSettings(single=400, none=0, pair=0, unknown=0)
    drawn = [p.effects[0] for p in drawn_plan(1, settings, {"mujoco": engine}, limits)]
    relative = {name: [e.relative for e in drawn if e.name == name] for name in engine}
    assert max(max(found, default=0.0) for found in relative.values()) <= 6.0
    assert 2.0 <= min(relative["weak"]) < 2.2
    assert 5.0 <= min(relative["some"]) < 5.2
    assert 0.5 <= min(relative["gain"]) < 0.7
    assert not relative["strong"] + relative["tether"] + relative["catch"]


def test_unknown_effects_are_several_and_drawn_as_single_ones_are() -> None:
    settings = PackSettings(single=120, none=0, pair=0, unknown=120, hidden=6)
    limits = {("mujoco", name, 1): 0.02 for name in QuickEngine.effects}
    plan = drawn_plan(2, settings, {"mujoco": QuickEngine.effects}, limits)
    unknown = [p.effects[0] for p in plan if p.kind == "unknown"]
    classes = Counter(settings.class_of(e.name) for e in unknown)
    assert len(classes) == 5
    assert set(classes.values()) == {24}
    single = [p.effects[0] for p in plan if p.kind == "single"]
    assert Counter(e.name for e in single) == dict.fromkeys(QuickEngine.effects, 20)
    from scipy.stats import ks_2samp

    assert ks_2samp([e.relative for e in unknown], [e.relative for e in single]).pvalue > 0.01


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
            verdict=Verdict(VerdictKind.NONE),
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
                pga=float(pga),
                pgv_pga=float(ratio),
            )
        )
    campaign = Campaign("c", tuple(trials), specimens={"rock": Specimen()})
    share = float(np.mean([t.overturned for t in trials]))
    assert overturn_rate(campaign, Path()) == [pytest.approx(share)]
    _, first, second = logistic_in_pga(campaign, Path())
    # The standard error of a slope is about 0.3.
    assert first == pytest.approx(4, abs=1.2)
    assert second == pytest.approx(2, abs=1.0)
