"""What simulates the campaigns of a pack: rocks, nuisances, effects, draws."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest

import vsr2.blind.custodian.pack_making as make_module
from blind_samples import SCENE, QuickEngine
from vsr2.blind import (
    PackSettings,
    make_pack,
)
from vsr2.blind.custodian.engine import Nuisances as DrawnNuisances
from vsr2.blind.custodian.engine import TrialInput, build_engine
from vsr2.blind.form.pack_form import Entry
from vsr2.blind.form.reader import parsed
from vsr2.blind.form.seal import folder_sha256
from vsr2.blind.mujoco import ContactModel
from vsr2.config import Study
from vsr2.effects import library
from vsr2.ensemble import DEFAULT_NUISANCES
from vsr2.errors import BlindError, SimulationError


def test_a_rock_that_does_not_rest_is_placed_again(study, tmp_path, monkeypatch) -> None:
    restless = []

    class Restless(QuickEngine):
        def run(self, shakes, series_interval):
            if series_interval < 1.0 and restless and restless.pop(0):
                raise SimulationError("settling_timeout")
            return super().run(shakes, series_interval)

    monkeypatch.setattr(make_module, "build_engine", lambda *args: Restless())
    settings = PackSettings(single=0, none=2, unknown=0, pair=0, trials=20)

    def made(name, fails):
        restless[:] = fails
        make_pack(study, tmp_path / name, tmp_path / f"{name}-key", settings, seed=3)
        assert not restless
        return [folder_sha256(p) for p in sorted((tmp_path / name / "data").glob("c*"))]

    calm, moved = made("calm", [False, False]), made("moved", [True, True, False, False])
    # One of the two, drawn a third time.
    assert len(set(calm) & set(moved)) == 1
    with pytest.raises(SimulationError, match="settling_timeout"):
        made("never", [True] * 6)


def test_the_scene_rocks_under_all_nuisances(study) -> None:
    # It would slide below a friction of b / h; the diagnosis' prior is exp(N(0, 0.1)).
    friction = study.contact.rock.lateral_friction * study.contact.pedestal.lateral_friction
    width, _, height = study.rock.size
    (deviation,) = (one.prior.sd for one in DEFAULT_NUISANCES if one.name == "friction")
    assert friction * math.exp(-3 * deviation) > 1.3 * width / height


def test_rocks_that_an_engine_cannot_simulate_are_refused(study, tmp_path) -> None:
    pytest.importorskip("mujoco", reason="the blind extra installs mujoco")
    turned = study.model_dump(mode="json", exclude_unset=True)
    turned["rock"]["start"] = {"mode": "pose", "position": [0.0, 0.0, 3.0]}
    with pytest.raises(BlindError, match=r"rock\.start\.mode is 'pose', but .* takes yaw"):
        build_engine("bullet", Study.model_validate(turned))
    meshed = study.model_copy(update={"rock": SimpleNamespace(shape="mesh")})
    with pytest.raises(BlindError, match=r"rock\.shape is 'mesh', but .* takes box"):
        build_engine("bullet", meshed)
    with pytest.raises(BlindError, match="not known"):
        build_engine("ode", study)
    assert build_engine("mujoco", study).static_acceleration == pytest.approx(9.80665 * 0.4 / 0.95)


@pytest.mark.parametrize("name", ["mujoco", "bullet"])
def test_all_nuisances_reach_the_simulation(name, study) -> None:
    if name == "mujoco":
        pytest.importorskip("mujoco", reason="the blind extra installs mujoco")
    engine = build_engine(name, study)
    time = np.arange(0.0, 2.0, 0.005)
    moved = np.cos(2 * np.pi * 0.8 * (time - 1.0)) * np.sin(np.pi * time / 2.0) ** 4
    base = TrialInput(0.005, moved * 6.0 / (np.abs(np.diff(moved, 2)).max() / 0.005**2), yaw=0.02)

    def seen(**changes):
        own = {key: changes.pop(key) for key in ("yaw", "offset", "effects") if key in changes}
        shake = dataclasses.replace(base, nuisances=DrawnNuisances(**changes), **own)
        return next(iter(engine.run([shake], 0.02)))

    plain = seen()
    assert 0.02 < plain.peak_tilt < 0.3
    assert seen().peak_tilt == plain.peak_tilt
    # Wider and lower blocks are steadier.
    assert seen(width=1.03).peak_tilt < 0.95 * plain.peak_tilt
    assert seen(height=0.97).peak_tilt < 0.95 * plain.peak_tilt
    # Before the first impact its energy does not count, later it does.
    lively, dull = (energy(seen(energy_ratio=ratio)) for ratio in (1.1, 0.8))
    assert dull < 0.9 * energy(plain) < energy(plain) < 0.95 * lively
    # At a quarter of the friction, .2, the block slides.
    slid = seen(friction=0.25)
    assert slid.peak_tilt < 0.5 * plain.peak_tilt
    assert np.abs(slid.position[-1, 0]) > 0.01 > np.abs(plain.position[-1, 0])
    for changed in (seen(depth=1.1), seen(yaw=0.05)):
        assert changed.peak_tilt != plain.peak_tilt
    # A table that does not turn is the same everywhere; this one's edge goes up and down.
    pitching = {"table_pitch": {"compliance": 0.01, "frequency": 10.0}}
    there, here = seen(effects=pitching, offset=(0.02, 0.0)), seen(effects=pitching)
    assert there.peak_tilt != pytest.approx(here.peak_tilt, rel=1e-6)


def energy(seen):
    """Sum over the rows of the squares of tilt: of how high, and how long, the block rocks."""
    return float((seen.tilt**2).sum())


@pytest.mark.parametrize("weight", [{"density": 2700.0}, {"mass": 2700.0 * 0.4 * 0.55 * 0.95}])
def test_an_obj_of_a_box_rocks_as_the_box(study, weight) -> None:
    pytest.importorskip("mujoco", reason="the blind extra installs mujoco")
    given = study.model_dump(mode="json", exclude_unset=True)
    rocks = [
        {"shape": "box", "size": [0.4, 0.55, 0.95], "density": 2700.0},
        {"shape": "mesh", "file": str(SCENE.parents[1] / "models" / "block.obj")} | weight,
    ]
    time = np.arange(0.0, 2.0, 0.005)
    moved = 0.05 * np.cos(2 * np.pi * 0.8 * (time - 1.0)) * np.sin(np.pi * time / 2.0) ** 4
    wider = DrawnNuisances(width=1.01, height=0.99)
    peaks = []
    for rock in rocks:
        engine = build_engine("mujoco", Study.model_validate(given | {"rock": rock}))
        shakes = [TrialInput(0.005, factor * moved, nuisances=wider) for factor in (1.0, 4.4)]
        peaks.append([seen.peak_tilt for seen in engine.run(shakes, 0.02)])
    assert peaks[0][1] > 0.02
    # Corners are written with five decimals of a metre, and stand in another order.
    np.testing.assert_allclose(peaks[1], peaks[0], rtol=1e-3, atol=1e-5)


def test_the_two_engines_agree_on_a_calm_trial(study) -> None:
    # Rocking in a single pulse, before responses diverge: largest tilts within 5 %.
    pytest.importorskip("mujoco", reason="the blind extra installs mujoco")
    time = np.arange(0.0, 2.0, 0.005)
    moved = np.cos(2 * np.pi * 0.8 * (time - 1.0)) * np.sin(np.pi * time / 2.0) ** 4
    peak = np.abs(np.diff(moved, 2)).max() / 0.005**2
    shakes = [TrialInput(0.005, moved * pga / peak) for pga in (3.5, 5.6)]
    study = study.model_copy(
        update={"engine": study.engine.model_copy(update={"time_step": 0.001})}
    )
    found = {
        name: [seen.peak_tilt for seen in build_engine(name, study).run(shakes, 0.02)]
        for name in ("mujoco", "bullet")
    }
    assert max(found["mujoco"][0], found["bullet"][0]) < 1e-3
    np.testing.assert_allclose(found["mujoco"][1:], found["bullet"][1:], rtol=0.05)


def test_the_contact_model_reaches_the_simulation(study) -> None:
    pytest.importorskip("mujoco", reason="the blind extra installs mujoco")
    time = np.arange(0.0, 2.0, 0.005)
    moved = np.cos(2 * np.pi * 0.8 * (time - 1.0)) * np.sin(np.pi * time / 2.0) ** 4
    shake = TrialInput(0.005, moved * 5.6 / (np.abs(np.diff(moved, 2)).max() / 0.005**2))
    engines = [
        build_engine("mujoco", study),
        build_engine("mujoco", study, ContactModel(time_constant=0.004, damping_ratio=1.2)),
    ]
    nominal, other = (next(iter(engine.run([shake], 0.02))).peak_tilt for engine in engines)
    assert other != nominal
    assert other == pytest.approx(nominal, rel=0.05)


def test_the_library_is_drawn_from(study) -> None:
    effects = build_engine("bullet", study).effects
    assert effects["restitution"].strength.null == 1.0
    assert effects["table_bandwidth"].strength.reciprocal
    assert effects["wear"].drifts
    assert [other.name for other in effects["base_slope"].others] == ["azimuth"]
    # What would act at any strength is not drawn beside it.
    strengths = {"registration": "yaw", "session": "registration_yaw"}
    assert {name: effects[name].strength.name for name in strengths} == strengths
    for name in effects:
        drawn = {other.name for other in effects[name].others}
        assert drawn == {
            p.name for p in library()[name].parameters if p.secondary and p.prior != "fixed"
        }
    assert effects["change_point"].strength.name == "slenderness_change"
    # Names and units of strengths are the same on both engines, so that one verdict fits both.
    both = build_engine("mujoco", study).effects
    for name in set(effects) & set(both):
        if name != "table_saturation":
            assert effects[name].strength.name == both[name].strength.name, name
            assert effects[name].strength.unit.replace("1", "") in (
                both[name].strength.unit.replace("1", ""),
                "",
            ), name


def test_effects_of_the_scene_act_before_those_that_are_drawn(study) -> None:
    own = {"table_gain": {"change": 0.1}, "restitution": {"energy_ratio": 0.8}}
    bare = build_engine("bullet", study)
    engine = build_engine("bullet", study.model_copy(update={"effects": own}))
    time = np.arange(0.0, 2.0, 0.005)
    moved = np.cos(2 * np.pi * 0.8 * (time - 1.0)) * np.sin(np.pi * time / 2.0) ** 4
    base = TrialInput(0.005, moved * 5.6 / (np.abs(np.diff(moved, 2)).max() / 0.005**2))

    def seen(of, ratio=1.0, **effects):
        nuisances = DrawnNuisances(energy_ratio=ratio)
        shake = dataclasses.replace(base, nuisances=nuisances, effects=effects)
        return next(iter(of.run([shake], 0.02)))

    assert seen(engine).peak_tilt == seen(bare, **own).peak_tilt != seen(bare).peak_tilt
    # The nuisance is relative to the scene's ratio, and a drawn ratio takes its place.
    assert energy(seen(engine, 0.9)) == pytest.approx(energy(seen(bare, 0.9, **own)))
    assert engine.effects["restitution"].strength.null == 0.8
    drawn = {"table_gain": {"change": 0.05}, "restitution": {"energy_ratio": 0.9}}
    both = {"table_gain": {"change": 1.1 * 1.05 - 1}, "restitution": {"energy_ratio": 0.9}}
    assert seen(engine, **drawn).peak_tilt == pytest.approx(seen(bare, **both).peak_tilt)
    pitching = {"table_pitch": {"compliance": 0.01}}
    engine = build_engine("bullet", study.model_copy(update={"effects": pitching}))
    assert set(bare.effects) - set(engine.effects) == {"table_pitch"}
    # In the first trial nothing acts yet.
    chipped = {"change_point": {"at": 0.5, "edge_rounding_radius": 0.004}}
    engine = build_engine("bullet", study.model_copy(update={"effects": chipped}))
    assert set(bare.effects) - set(engine.effects) == {"edge_rounding"}


def test_draws_of_the_scene_are_no_draws_of_the_custodian(study) -> None:
    turned = study.model_copy(update={"effects": {"placement": {"yaw": 5.0}}})
    shake = TrialInput(0.005, np.zeros(100))

    def yaws(number: int) -> list[float]:
        context = dataclasses.replace(shake.context, campaign_seed=number)
        inputs = [dataclasses.replace(shake, context=context)] * 4
        engine = build_engine("bullet", turned)
        bare = engine._trials(inputs, DrawnNuisances(), 0.02)
        drawn = engine._with_effects(bare, inputs, {"placement": {"yaw": 5.0}})
        assert len({one.values for trial in drawn for one in trial.effects}) == 8
        return [dict(trial.effects[0].values)["yaw"] for trial in drawn]

    assert yaws(1) == yaws(1) != yaws(2)


@pytest.mark.parametrize("name", ["bullet", "mujoco"])
def test_a_key_may_seal_whatever_an_engine_draws(name, study) -> None:
    """Both ends of each parameter can be simulated by the library, and nulls are its own."""
    pytest.importorskip("mujoco", reason="the blind extra installs mujoco")
    for effect in build_engine(name, study).effects.values():
        own = effect.strength
        sealed = {"strength": own.name, "null": own.null if math.isfinite(own.null) else None}
        for end in ("low", "high"):
            values = {one.name: getattr(one, end) for one in effect.parameters}
            if values[own.name] == own.null:
                continue
            entry = {
                "kind": "single", "engine": name, "data_sha256": "0" * 64,
                "effects": [{"name": effect.name, "values": values, **sealed}],
                "where": {"axis": "conditions", "weights": []},
            }  # fmt: skip
            assert parsed(Entry, entry, "key.json").names == [effect.name]
