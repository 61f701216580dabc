"""A pack's design: what acts in its campaigns, what may not be used, how strong effects are."""

import math
from collections import Counter

import numpy as np
import pytest

from blind_samples import QuickEngine, make
from vsr2.blind import PackSettings
from vsr2.blind.custodian.plan import apart, directions, draw_plan, left_out_with
from vsr2.blind.mujoco import Drawable, Parameter
from vsr2.effects import library
from vsr2.errors import BlindError


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
        own = {effect.name for effect in one.effects}
        own |= {name for effect in own for name in settings.class_of(effect)}
        assert one.exclude
        lacking = own & set(one.exclude)
        assert lacking == (own if one.kind == "unknown" else set())
    kinds = {one.kind for one in plan}
    left_out = {kind: {p.exclude for p in plan if p.kind == kind} for kind in kinds}
    assert all(found == left_out["none"] for found in left_out.values())
    assert len(left_out["none"]) == 3


def test_what_is_declared_alike_is_left_out_too() -> None:
    settings = PackSettings()
    assert left_out_with(("friction",), settings) == ("friction", "friction_rate")
    # In complete classes: base_slope is one with com_offset.
    assert left_out_with(("registration",), settings) == (
        "base_slope", "com_offset", "off_axis_motion", "registration"
    )  # fmt: skip
    assert left_out_with(("unheard_of",), settings) == ("unheard_of",)
    known = library()
    plan, _ = planned(unknown=60, none=60, leave_one_out=1)
    for one in plan:
        for effect in one.effects:
            assert {effect.name, *known[effect.name].confounded_with} <= set(one.exclude)


def test_no_effect_is_left_out_for_two_classes() -> None:
    settings = PackSettings()
    classes = {settings.class_of(name) for name in library()}
    found = apart(sorted(classes), settings)
    names = [name for one in found for name in left_out_with(one, settings)]
    assert len(names) == len(set(names))
    rest = classes - set(found)
    assert all(set(left_out_with(one, settings)) & set(names) for one in rest)


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
    gains = [value for value in values if "table_gain" in value]
    assert sum(cells["unknown", value] for value in gains) == 200


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
