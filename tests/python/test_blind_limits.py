"""Signals over noise: how they are measured, and that what is sealed was measured."""

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from pydantic import TypeAdapter

from blind_samples import SMALL, QuickEngine, make, moved, protocol, pulses, strength_of
from vsr2.blind import PackSettings
from vsr2.blind.custodian.design import catalogue, draw_protocol
from vsr2.blind.custodian.detection_limit import (
    RULES,
    SignalMeter,
    squared_signal,
)
from vsr2.blind.custodian.engine import Nuisances, TrialInput, build_engine
from vsr2.blind.custodian.plan import draw_plan, not_drawn
from vsr2.blind.form.seal import open_key, read_json
from vsr2.blind.mujoco import Drawable, Parameter
from vsr2.errors import BlindError


def test_the_squared_signal_is_that_of_the_mean_however_observations_go_together() -> None:
    # Eight observations that one nuisance moves as one, in a metric that is not theirs.
    rng = np.random.default_rng(1)
    mean = 0.4 * rng.standard_normal(8)
    covariance = np.diag(rng.uniform(0.5, 2.0, 8)) + 0.3
    together = np.ones((8, 8)) + 0.1 * np.eye(8)
    draws = rng.multivariate_normal(mean, together, size=(4000, 6))
    found = np.array([squared_signal(changes, covariance) for changes in draws])
    true = mean @ np.linalg.inv(covariance) @ mean
    error = found.std() / math.sqrt(len(found))
    assert found.mean() == pytest.approx(true, abs=4 * error)
    # What takes off each observation's own noise alone, with the same draws, is beside it.
    inverse = np.linalg.inv(covariance)
    own = [
        d.mean(axis=0) @ inverse @ d.mean(axis=0) - np.diag(inverse) @ d.var(axis=0, ddof=1) / 6
        for d in draws
    ]
    assert abs(np.mean(own) - true) > 10 * error


def test_a_signal_of_equal_changes_is_their_length() -> None:
    change = np.array([1.0, -2.0, 0.5])
    covariance = np.diag([4.0, 1.0, 0.25])
    for count in (2, 7):
        changes = np.tile(change, (count, 1))
        assert squared_signal(changes, covariance) == pytest.approx(0.25 + 4.0 + 1.0)


def meter(engine=None, seed=3, **changes):
    settings = PackSettings(**(SMALL | {"replicates": 12} | changes))
    return SignalMeter(engine or QuickEngine(), protocol(settings), settings, seed)


def test_the_limit_is_where_signal_over_noise_is_three() -> None:
    found = meter()
    effect = QuickEngine.effects["table_gain"]
    limit = found.limit(effect, 1)
    assert found.signal("table_gain", {"change": limit}) == pytest.approx(3.0, rel=0.3)
    assert found.signal("table_gain", {"change": 0.0}) == 0.0
    assert found.signal("table_gain", {"change": 4 * limit}) > 6.0


def test_signals_rise_with_the_magnitude_and_hardly_with_the_seed() -> None:
    sizes = [0.02, 0.04, 0.08, 0.16]
    found = np.array(
        [[meter(seed=s).signal("table_gain", {"change": v}) for v in sizes] for s in range(6)]
    )
    assert (np.diff(found, axis=1) > 0).all()
    off = np.abs(np.log(found / np.median(found, axis=0)))
    assert np.mean(off < math.log(1.5)) >= 0.8


class SlopingEngine(QuickEngine):
    """Width moves ln tilt of all trials alike; the effect moves every other one the other way."""

    def run(self, shakes, series_interval):
        for shake in shakes:
            seen = next(iter(super().run([replace(shake, effects={})], series_interval)))
            self.place = getattr(self, "place", 0) + 1
            up = 0.05 * (-1) ** self.place if shake.effects else 0.0
            tilt = 0.1 * math.exp(40 * (shake.nuisances.width - 1) + up)
            yield replace(seen, overturned=False, peak_tilt=tilt)


def test_what_nuisances_do_is_no_scatter() -> None:
    # What lies across the nuisances' direction is seen as if they were known: against 0.05 of own
    # scatter in 8 observations, scaled by 8 trials of 12 and by five slopes from 60 draws.
    expected = 0.05 / 0.05 * math.sqrt(8 / (8 / 12 + 5 / 60))
    assert meter(SlopingEngine()).signal("wear", {"loss": 0.1}) == pytest.approx(expected)


class DeafEngine(QuickEngine):
    def run(self, shakes, series_interval):
        for shake in shakes:
            yield from super().run([replace(shake, effects={})], series_interval)


class JumpyEngine(QuickEngine):
    """One trial falls under the effect in one draw of some; nothing else changes."""

    def __init__(self, draws=3):
        super().__init__()
        self.draws = draws

    def run(self, shakes, series_interval):
        for i, shake in enumerate(shakes):
            acts = shake.effects and i == 0 and shake.context.campaign_seed % self.draws == 0
            seen = next(iter(super().run([replace(shake, effects={})], series_interval)))
            yield replace(seen, peak_tilt=1.0) if acts else seen


def test_one_trial_that_an_effect_makes_uncertain_is_no_strong_signal() -> None:
    # Without the effect its ln tilt scatters by a few hundredths; the effect moves it by 2 or more
    # in a third of the draws.
    assert meter(JumpyEngine()).signal("wear", {"loss": 0.1}) < 2.0
    assert meter(DeafEngine()).signal("wear", {"loss": 0.1}) == 0.0


def test_one_trial_that_leaps_counts_for_three_of_its_standard_deviations() -> None:
    # Scatters are scaled by 8 trials of 12 and by five slopes from 60 draws.
    most = 3 / math.sqrt(8 / 12 + 5 / 60)
    found = meter(JumpyEngine(draws=1)).signal("wear", {"loss": 0.1})
    assert 0.9 * most < found <= most * (1 + 1e-9)


class SteepEngine(QuickEngine):
    """An effect that is felt in full however weak it is."""

    def run(self, shakes, series_interval):
        for shake in shakes:
            full = {
                name: {key: 0.3 * np.sign(v) for key, v in values.items()}
                for name, values in shake.effects.items()
            }
            yield from super().run([replace(shake, effects=full)], series_interval)


def test_what_nobody_can_see_and_what_jumps_have_no_limit() -> None:
    assert meter(DeafEngine()).limit(QuickEngine.effects["wear"], 1) == math.inf
    assert meter(SteepEngine()).limit(QuickEngine.effects["friction"], 1) == math.inf


def test_sessions_of_a_campaign_are_those_of_its_part() -> None:
    # Effects step between sessions: each has trials in the design.
    settings = PackSettings(trials=150, sessions=8, motions=5, catalogue=5)
    found = SignalMeter(QuickEngine(), protocol(settings), settings, 1)
    rows = protocol(settings).rows
    assert Counter(rows[i].session for i in found.trials).keys() == set(range(8))
    assert len(found.trials) == settings.signal_trials


# --- what is drawn ------------------------------------------------------------------------------

LIMITS = {("mujoco", name, 1): 0.05 for name in QuickEngine.effects}


def plan(measure, limits=LIMITS, seed=1, **counts):
    settings = PackSettings(**({"single": 0, "none": 0, "pair": 0, "unknown": 0} | counts))
    return draw_plan(seed, settings, {"mujoco": QuickEngine.effects}, limits, measure)


def test_what_is_sealed_is_what_was_measured() -> None:
    # The proposed limit is 5 times too high for one effect and as much too low for another.
    true = {"friction": 0.01, "inertia": 0.25}
    asked = []

    def measure(engine, number, effect, values):
        asked.append((effect.name, number))
        return moved(effect.name, values) / true.get(effect.name, 0.05)

    found = plan(measure, single=120, pair=30, unknown=30, protocols=2)
    assert not found.refused
    for campaign in found.campaigns:
        for effect in campaign.effects:
            expected = moved(effect.name, effect.values) / true.get(effect.name, 0.05)
            assert effect.relative == pytest.approx(expected, rel=1e-3)
            assert 0.5 <= effect.relative <= 6.0
    relative = [e.relative for c in found.campaigns for e in c.effects]
    # Log-uniform from 0.5 to 6 has its median at 1.73; of 210 it lies within 25 %.
    assert np.median(relative) == pytest.approx(math.sqrt(3), rel=0.25)
    assert {number for _, number in asked} == {0, 1}


def test_a_draw_is_measured_on_the_protocol_of_its_campaign() -> None:
    asked = []

    def measure(engine, number, effect, values):
        asked.append((number, effect.name, values[strength_of(effect.name)]))
        return moved(effect.name, values) / 0.05

    found = plan(measure, single=30, unknown=6, protocols=3)
    for campaign in found.campaigns:
        for effect in campaign.effects:
            assert (
                campaign.protocol,
                effect.name,
                effect.values[strength_of(effect.name)],
            ) in asked


def test_what_is_never_measured_inside_gives_way_to_the_next_and_is_leak() -> None:
    calls = Counter()

    def measure(engine, number, effect, values):
        calls[effect.name] += 1
        if effect.name == "friction":
            return 38.0
        return 0.0 if effect.name == "inertia" else moved(effect.name, values) / 0.05

    found = plan(measure, single=24, pair=4, unknown=12)
    assert len(found.campaigns) == 40
    names = {e.name for c in found.campaigns for e in c.effects}
    assert names == set(QuickEngine.effects) - {"friction", "inertia"}
    assert set(found.refused["mujoco"]) == {"friction", "inertia"}
    for name, count in found.refused["mujoco"].items():
        assert calls[name] == RULES.attempts * count
    with pytest.raises(BlindError, match="no effect that may still be drawn"):
        plan(lambda *args: 38.0, single=1)


def test_left_out_in_turn_is_what_can_be_measured() -> None:
    def measure(engine, number, effect, values):
        return 0.0 if effect.name == "inertia" else moved(effect.name, values) / 0.05

    found = plan(measure, leave_one_out=2)
    names = Counter(c.effects[0].name for c in found.campaigns)
    assert names == dict.fromkeys(set(QuickEngine.effects) - {"inertia"}, 2)
    assert found.refused == {"mujoco": {"inertia": 2}}


def test_sides_that_cannot_be_drawn_are_leak() -> None:
    effects = {
        name: Drawable(name, Parameter("change", "1", 1.0, 0.7, 1.3)) for name in ("both", "one")
    }
    effects["none"] = Drawable("none", Parameter("change", "1", math.inf, 3.0, 40.0, True))
    limits = {("bullet", n, s): 0.1 for n in ("both", "one") for s in (1, -1)}
    limits["bullet", "one", -1] = math.inf
    limits["bullet", "none", 1] = math.inf
    assert not_drawn({"bullet": effects}, limits, "bullet") == ["none", "one below 1"]


def test_the_key_holds_the_signal_on_the_campaigns_own_protocol(quick, study, tmp_path) -> None:
    made = make(study, tmp_path, protocols=2)
    key = open_key(tmp_path / "data", tmp_path / "key")
    settings = TypeAdapter(PackSettings).validate_python(key["settings"])
    seed = int(key["seed"])
    motions = catalogue(seed, settings.catalogue)
    thresholds = read_json(tmp_path / "key" / "steps.json")["overturning_acceleration"]
    meters = []
    for i in range(2):
        rng = np.random.default_rng([seed, 402, i])
        drawn = draw_protocol(rng, motions, thresholds, settings)
        meters.append(SignalMeter(QuickEngine(), drawn, settings, seed))
    found = [e for e in key["campaigns"].values() if e["effects"]]
    assert len({entry["protocol"] for entry in found}) == 2
    for entry in found:
        for effect in entry["effects"]:
            signal = meters[entry["protocol"]].signal(effect["name"], effect["values"])
            own = signal / RULES.detected
            assert effect["relative"] == pytest.approx(own, rel=1e-3)
    assert made.refused.keys() == {"mujoco"}


def test_bumps_have_no_limit_as_the_least_of_them_is_felt(study, monkeypatch) -> None:
    # A block on the native core that stands on bumps of 2 um rocks about other points at once.
    settings = PackSettings(trials=150, motions=3, catalogue=3, replicates=4, signal_trials=6)
    engine = build_engine("bullet", study)
    drawn = draw_protocol(np.random.default_rng(3), pulses(4, 3), [4.5, 5.0, 5.5], settings)
    found = SignalMeter(engine, drawn, settings, 4)
    measure, tried = found.signal, []
    monkeypatch.setattr(found, "signal", lambda *a, **k: tried.append(a[1]) or measure(*a, **k))
    assert found.limit(engine.effects["base_asperity"], 1) == math.inf
    assert [values["height"] for values in tried] == [pytest.approx(2e-6)]
    assert math.isfinite(found.limit(engine.effects["slenderness"], 1))


def test_a_nuisance_may_carry_a_draw_beyond_its_prior(study) -> None:
    # Warnings are errors here: a ratio of 1.1 ends the prior, the nuisance adds 2 %.
    motion = pulses(4, 1)[0]
    shake = TrialInput(
        motion.interval,
        motion.displacement * 3.0,
        {"restitution": {"energy_ratio": 1.1}},
        Nuisances(energy_ratio=1.02),
    )
    assert len(list(build_engine("bullet", study).run([shake], 1.0))) == 1
