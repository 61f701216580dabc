"""The independent engine against closed forms of the rigid block."""

import ast
import math
from dataclasses import replace
from importlib.util import resolve_name
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the blind extra installs mujoco")

import vsr2.blind.mujoco as package
from vsr2.blind.mujoco import (
    Situation,
    TableMotion,
    block,
    draw_contact,
    drive,
    ground_motion,
    read_hull,
    run_trial,
)
from vsr2.blind.mujoco.driven_table import low_passed, pitched, resonated, saturated, stretched
from vsr2.blind.mujoco.ground import acceleration_of

G = 9.80665
BLOCK = block(0.4, 0.55, 0.95, 2700.0)
INTERVAL = 0.005


def burst(frequency=1.5, cycles=3, rest=0.2):
    """A smooth burst per unit of peak acceleration, which is towards -x: bodies tip to +x."""
    time = np.arange(0.0, cycles / frequency, INTERVAL)
    middle = time - 0.5 * cycles / frequency
    wave = np.cos(np.pi * middle * frequency / cycles) ** 4
    wave *= np.cos(2 * np.pi * frequency * middle)
    quiet = np.zeros(round(rest / INTERVAL))
    moved = np.concatenate([quiet, wave, quiet])
    return moved / np.abs(acceleration_of(moved, INTERVAL)).max()


def situation(pga=0.0, **changes):
    return replace(Situation(BLOCK, TableMotion(INTERVAL, burst() * pga)), **changes)


def lifts(pga, **changes):
    # Below the threshold contacts give by some 1e-6 rad.
    return run_trial(situation(pga, **changes)).peak_tilt > 5e-5


def peaks(response):
    """Largest tilts between impacts of a free decay, and the slenderness's potential at them."""
    tilt = response.tilt
    inner = (tilt[1:-1] > tilt[:-2]) & (tilt[1:-1] >= tilt[2:]) & (tilt[1:-1] > 0.005)
    return np.flatnonzero(inner) + 1


def energy(tilt, body=BLOCK):
    """Potential energy over m g R of a block that rocks about its edge."""
    alpha = body.slenderness_angle
    return np.cos(alpha - tilt) - math.cos(alpha)


def free_rocking(strength=6.0, **changes):
    """Tilt of a block that a short strong pulse [m/s^2] set rocking, once the table rests."""
    table = TableMotion(INTERVAL, burst(0.8, 1.0, 0.05) * strength)
    shaken = situation(friction=2.0, **changes)
    response = run_trial(replace(shaken, table=table), series_interval=0.001)
    after = response.time > (table.x.size - 1) * INTERVAL + 0.01
    return replace(response, time=response.time[after], tilt=response.tilt[after])


def kept(response, count=2):
    """Energy after over before of the first impacts of a free decay."""
    found = energy(response.tilt[peaks(response)][: count + 1])
    assert len(found) == count + 1
    return found[1:] / found[:-1]


def borrowed(source):
    """Modules of VSR2 outside the package that a module of it imports."""
    names = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        if isinstance(node, ast.ImportFrom):
            names.append(resolve_name("." * node.level + (node.module or ""), package.__name__))
    inside = package.__name__ + "."
    return [n for n in names if n.split(".")[0] == "vsr2" and not (n + ".").startswith(inside)]


def test_it_shares_nothing_with_the_rest() -> None:
    files = sorted(Path(package.__file__).parent.rglob("*.py"))
    assert len(files) > 5
    for path in files:
        assert borrowed(path.read_text()) == [], path
    for source in (
        "import vsr2.motion",
        "from vsr2 import motion",
        "from ...motion import Record",
        "from .. import floor",
        "from ..mujoco_engine import MujocoEngine",
        "def f():\n    from vsr2.blind.custodian.mujoco_engine import MujocoEngine",
    ):
        assert len(borrowed(source)) == 1, source
    assert borrowed("from .table import drive\nfrom . import body\nimport numpy") == []


def test_the_block_has_its_closed_form_mass_properties() -> None:
    alpha = math.atan(0.4 / 0.95)
    assert BLOCK.slenderness_angle == pytest.approx(alpha)
    assert BLOCK.pivot_inertia == pytest.approx(4 / 3 * BLOCK.mass * BLOCK.radius**2)
    assert BLOCK.housner_ratio == pytest.approx((1 - 1.5 * math.sin(alpha) ** 2) ** 2)


def test_a_hull_is_the_block_it_is_the_hull_of(tmp_path: Path) -> None:
    corners = [(x, y, z) for x in (0, 0.4) for y in (0, 0.55) for z in (1, 1.95)]
    (tmp_path / "block.obj").write_text("".join(f"v {x} {y} {z}\n" for x, y, z in corners))
    hull = read_hull(tmp_path / "block.obj", 2700.0)
    assert hull.mass == pytest.approx(BLOCK.mass)
    np.testing.assert_allclose(hull.inertia, BLOCK.inertia, atol=1e-9 * BLOCK.mass)
    np.testing.assert_allclose(hull.center, BLOCK.center, atol=1e-12)
    assert {tuple(p) for p in hull.points.round(9)} == {tuple(p) for p in BLOCK.points.round(9)}


def test_it_lifts_at_the_static_threshold() -> None:
    threshold = G * math.tan(BLOCK.slenderness_angle)
    assert not lifts(0.97 * threshold)
    assert lifts(1.03 * threshold)


def test_impacts_keep_the_energy_that_housner_says() -> None:
    # Contacts take about 4 ms, in which gravity acts on: some per cent.
    np.testing.assert_allclose(kept(free_rocking()), BLOCK.housner_ratio, rtol=0.04)


@pytest.mark.parametrize(("ratio", "near"), [(0.7, 0.08), (0.8, 0.05), (0.9, 0.05), (1.08, 0.05)])
def test_the_impact_ratio_scales_that_energy(ratio: float, near: float) -> None:
    # Contacts give a little back after the velocity was scaled: at a ratio of 0.7 4 % in the first
    # impact, 7 % in the second, which is slower.
    first, second = kept(free_rocking(impact_energy_ratio=ratio)) / BLOCK.housner_ratio
    assert first == pytest.approx(ratio, rel=0.05)
    assert second == pytest.approx(ratio, rel=near)


def test_small_blocks_slide_at_the_friction_angle() -> None:
    stout = block(1.0, 1.0, 0.4, 2700.0)

    def slid(pga):
        base = situation(pga, body=stout, friction=0.3)
        end = run_trial(base).position[-1, 0] - base.table.x[-1]
        return abs(end) > 1e-3

    # A burst that slides both ways ends near where it began, hence the margin above.
    assert not slid(0.95 * 0.3 * G)
    assert slid(1.4 * 0.3 * G)


def test_what_slides_hops() -> None:
    """Why `friction` is no effect of this engine: below b / h = 0.42 a rigid block only slides."""
    assert run_trial(situation(8.0, friction=0.38)).peak_tilt > 0.05


def test_what_leans_at_the_end_has_overturned() -> None:
    from vsr2.blind.mujoco.mujoco_trial import _judged

    for lean, fallen in ((0.55, True), (0.45, False)):
        half = lean * BLOCK.slenderness_angle / 2
        rows = np.zeros((50, 7))
        rows[:, 3], rows[:, 5] = math.cos(half), math.sin(half)
        judged = _judged(rows, np.array([0, 0, 0, 1.0, 0, 0, 0]), situation(), 1, 0.001)
        assert judged.peak_tilt == pytest.approx(2 * half)
        assert judged.overturned == fallen


def test_a_body_that_a_pitching_table_carries_is_at_rest_on_it() -> None:
    from scipy.spatial.transform import Rotation

    from vsr2.blind.mujoco.step_actions import RelativeMotion

    turn = Rotation.from_euler("zyx", [0.4, 0.2, -0.1])
    x, y, z, w = turn.as_quat()
    moved, speed, rate, pivot = 0.03, 0.2, 0.5, 0.3
    body = np.array([0.1, -0.05, 0.6])

    class Data:
        qpos = np.array([moved, 0.02, *body, w, x, y, z])
        qvel = np.array([speed, rate, *np.zeros(6)])

    found = RelativeMotion(Data(), ["x", "pitch"], pivot).table()
    # The table turns about y, a pivot's depth below its surface.
    turning = np.array([0.0, rate, 0.0])
    carried = np.array([speed, 0, 0]) + np.cross(turning, body - [moved, 0.0, -pivot])
    np.testing.assert_allclose(found[:3], carried, atol=1e-12)
    np.testing.assert_allclose(found[3:], turn.inv().apply(turning), atol=1e-12)


def test_a_series_is_distinguished_from_the_rest_before() -> None:
    response = run_trial(situation(6.0, yaw=0.3, offset=(0.01, -0.02)))
    np.testing.assert_allclose(response.orientation[0], [0, 0, 0, 1], atol=1e-12)
    np.testing.assert_array_equal(response.position[0], 0.0)
    assert response.tilt[0] == 0
    assert response.tilt.max() <= response.peak_tilt


def test_a_fallen_block_ends_the_trial() -> None:
    response = run_trial(situation(table=TableMotion(INTERVAL, burst(0.8) * 8.0)))
    assert response.overturned
    assert response.peak_tilt > 1.2


@pytest.mark.parametrize("pga", [6.0, 7.0])
def test_a_trial_does_not_end_where_the_body_turns_back(pga: float) -> None:
    # It stands still for a moment there; at 7 m/s^2 just when the trial looks whether it rests.
    response = run_trial(situation(pga))
    assert response.overturned or response.tilt[-1] < 1e-3


def test_a_trial_repeats_bit_for_bit() -> None:
    one, two = (run_trial(situation(7.0, impact_energy_ratio=0.9)) for _ in range(2))
    np.testing.assert_array_equal(one.position, two.position)


# --- table --------------------------------------------------------------------------------------


def test_the_table_is_driven_through_its_samples() -> None:
    time = np.arange(0, 1.0001, INTERVAL)
    wave = np.sin(np.pi * time) ** 4
    position, velocity, acceleration = drive(wave, INTERVAL, 0.001)
    fine = np.arange(len(position)) * 0.001
    np.testing.assert_allclose(position, np.sin(np.pi * fine) ** 4, atol=1e-6)
    slope = 4 * np.pi * np.sin(np.pi * fine) ** 3 * np.cos(np.pi * fine)
    np.testing.assert_allclose(velocity, slope, atol=2e-3)
    np.testing.assert_allclose(velocity, np.gradient(position, 0.001), atol=0.05)
    assert np.abs(acceleration - np.gradient(velocity, 0.001)).max() < 0.5


def sine(frequency, seconds=6.0):
    time = np.arange(0, seconds, INTERVAL)
    return np.sin(2 * np.pi * frequency * time)


def amplitude(samples):
    return np.abs(samples[len(samples) // 2 :]).max()


@pytest.mark.parametrize("frequency", [1.0, 5.0, 12.0])
def test_the_lag_has_its_transfer_function(frequency: float) -> None:
    moved = low_passed(sine(frequency), INTERVAL, corner=5.0)
    # -3 dB at the corner, as a corner is defined.
    power = (frequency / 5.0) ** 2 * (math.sqrt(2) - 1)
    assert amplitude(moved) == pytest.approx(1 / (1 + power), abs=0.01)


def test_a_delay_moves_the_motion() -> None:
    moved = low_passed(sine(1.0), INTERVAL, corner=1e3, delay=0.02)
    np.testing.assert_allclose(moved[20:], sine(1.0)[16:-4], atol=2e-3)


@pytest.mark.parametrize("amplification", [1.2, 1.8])
def test_a_mode_amplifies_as_den_hartog_has_it(amplification: float) -> None:
    damping = 0.5 / math.sqrt(amplification**2 - 1)
    # Straight lines between ever fewer samples take a little of a sine.
    for frequency, loss in ((0.5, 1e-4), (4.0, 0.004), (8.0, 0.01), (14.0, 0.02)):
        r = frequency / 8.0
        c = (2 * damping * r) ** 2
        exact = math.sqrt((1 + c) / ((1 - r**2) ** 2 + c))
        moved = resonated(sine(frequency), INTERVAL, 8.0, amplification)
        assert amplitude(moved) == pytest.approx(exact, rel=loss)
    assert exact < 1 < amplification


def test_saturation_caps_the_acceleration() -> None:
    moved = burst() * 8.0
    capped = saturated(moved, INTERVAL, math.inf, 4.0)
    assert np.abs(np.diff(capped, 2)).max() / INTERVAL**2 <= 4.0 * 1.05
    free = saturated(moved, INTERVAL, math.inf, math.inf)
    np.testing.assert_allclose(free, moved, atol=1e-12)


def test_stretching_scales_the_acceleration() -> None:
    moved = stretched(burst(), 1.1)
    assert np.abs(acceleration_of(moved, INTERVAL)).max() == pytest.approx(1 / 1.21, rel=0.01)


def test_the_table_leans_back_in_proportion_to_its_acceleration() -> None:
    steady = np.concatenate([np.zeros(100), np.full(1000, 2.0)])
    assert pitched(steady, INTERVAL, 0.02, 8.0)[-1] == pytest.approx(-0.02 * 2.0 / G, rel=1e-3)
    # At its own frequency a mode with damping ratio 0.1 answers 1 / (2 x 0.1) times as much.
    # Straight lines between 25 samples a period take (pi / 25)^2 / 3 of a sine, a peak between two
    # of them (pi / 25)^2 / 2: 1.3 % at most.
    resonant = np.abs(pitched(sine(8.0), INTERVAL, 0.02, 8.0)[-200:]).max()
    assert resonant == pytest.approx(5 * 0.02 / G, rel=0.015)


def test_ground_motions_are_at_rest_at_both_ends() -> None:
    for seed in range(8):
        motion = ground_motion("m", np.random.default_rng(seed))
        felt = acceleration_of(motion.displacement, motion.interval)
        assert np.abs(felt).max() == pytest.approx(1.0)
        assert np.ptp(motion.displacement[:30]) == 0 == np.ptp(motion.displacement[-30:])
        assert motion.displacement[0] == 0 == motion.displacement[-1]


@pytest.mark.parametrize("seed", range(4))
def test_every_contact_model_of_the_family_is_correct(seed) -> None:
    contact = draw_contact(np.random.default_rng(seed), development=bool(seed % 2))
    np.testing.assert_allclose(kept(free_rocking(contact=contact)), BLOCK.housner_ratio, rtol=0.04)
    threshold = G * math.tan(BLOCK.slenderness_angle)
    assert not lifts(0.97 * threshold, contact=contact)
    assert lifts(1.03 * threshold, contact=contact)


def test_the_family_differs_in_what_a_campaign_shows() -> None:
    peaks = {
        run_trial(
            situation(6.0, contact=draw_contact(np.random.default_rng(seed), development=True))
        ).peak_tilt
        for seed in range(3)
    }
    assert len(peaks) == 3
    assert max(peaks) < 1.1 * min(peaks)


def test_development_and_scored_packs_have_no_member_in_common() -> None:
    found = [
        {draw_contact(np.random.default_rng(s), development=d).time_constant for s in range(200)}
        for d in (True, False)
    ]
    least, most = 0.002, 0.005
    cells = [{int(8 * math.log(t / least) / math.log(most / least)) for t in of} for of in found]
    assert cells == [{0, 2, 4, 6}, {1, 3, 5, 7}]
