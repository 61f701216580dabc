"""Stable poses, slenderness and frequency parameter against closed forms for blocks."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
import trimesh

from vsr2.config.study import BoxRock, FixedStart, PrismPedestal, YawStart
from vsr2.errors import GeometryError
from vsr2.report.messages.data import inertia_text
from vsr2.scene import (
    RockBody,
    build_pedestal,
    build_rock,
    inertia_summary,
    slenderness,
    stable_poses,
    start_support,
    support_polygon,
)

MODELS = Path(__file__).resolve().parents[2] / "models"
SIZE = (0.4, 0.55, 0.95)


def block(yaw: float = 0.0) -> RockBody:
    rock = BoxRock(shape="box", size=SIZE, density=2500.0, start=YawStart(yaw=yaw))
    return build_rock(rock, build_pedestal(PrismPedestal()), clearance=0.002)


def report(path: Path, **options: float) -> str:
    return inertia_text(inertia_summary(path, **options))


def test_block_slenderness_and_frequency_parameter() -> None:
    """Housner (1963): alpha = atan(b/h), R = sqrt(b^2 + h^2) to the edge, p^2 = 3 g / 4 R."""
    along_x, along_y = slenderness(block(), [0.0, 90.0], gravity=9.81)
    for row, half in ((along_x, 0.2), (along_y, 0.275)):
        assert row.alpha == pytest.approx(math.atan2(half, 0.475), rel=1e-12)
        assert row.radius == pytest.approx(math.hypot(half, 0.475), rel=1e-12)
        assert row.frequency_parameter == pytest.approx(
            math.sqrt(3 * 9.81 / (4 * row.radius)), rel=1e-12
        )


def test_distance_is_measured_along_the_azimuth() -> None:
    (row,) = slenderness(block(), [30.0])
    # 30 degrees leaves through the face x = 0.2, which is 0.2 / cos 30 away along the azimuth.
    assert row.distance == pytest.approx(0.2 / math.cos(math.radians(30.0)), rel=1e-12)
    assert row.radius == pytest.approx(math.hypot(0.2, 0.475), rel=1e-12)


@pytest.mark.parametrize("yaw", [15.0, 90.0, 200.0])
def test_yaw_of_the_start_turns_the_azimuths(yaw: float) -> None:
    turned = slenderness(block(yaw), [yaw, yaw + 40.0, yaw - 77.0])
    plain = slenderness(block(), [0.0, 40.0, -77.0])
    for a, b in zip(turned, plain, strict=True):
        assert a.alpha == pytest.approx(b.alpha, rel=1e-9)
        assert a.frequency_parameter == pytest.approx(b.frequency_parameter, rel=1e-9)


def test_round_base_has_one_slenderness_for_all_azimuths() -> None:
    rod = trimesh.creation.cylinder(radius=0.15, height=1.0, sections=256)
    support = support_polygon(np.array(rod.vertices), np.zeros(3), (0.0, 0.0, 0.0, 1.0))
    # The inscribed polygon of 256 corners falls short by 1 - cos(pi / 256) = 7.5e-5.
    assert support.margin == pytest.approx(0.15, rel=1e-4)
    assert support.height == pytest.approx(0.5)


def test_support_tolerance() -> None:
    """A block tilted by 0.5 degree counts as standing with 1 %, as an edge with a millionth."""
    half = math.radians(0.25)
    tilt = (0.0, math.sin(half), 0.0, math.cos(half))
    corners = np.array(trimesh.creation.box(extents=SIZE).vertices)
    support = support_polygon(corners, np.zeros(3), tilt)
    assert len(support.polygon) == 4
    assert support.tolerance == pytest.approx(0.01 * support.height)
    with pytest.raises(GeometryError, match="on one line"):
        support_polygon(corners, np.zeros(3), tilt, tolerance=1e-6)


def test_a_mass_centre_beside_the_support_is_reported() -> None:
    body = block()
    leaning = RockBody(
        parts=body.parts,
        mass=type(body.mass)(1.0, np.array([0.25, 0.0, 0.0]), np.ones(3), np.eye(3)),
        start=body.start,
    )
    assert start_support(leaning).margin == pytest.approx(-0.05)
    assert start_support(body).margin == pytest.approx(0.2)
    with pytest.raises(GeometryError, match=r"0\.05 m outside"):
        slenderness(leaning)


def test_block_rests_on_its_six_faces() -> None:
    poses = stable_poses(trimesh.creation.box(extents=SIZE), threshold=0.0)
    assert len(poses) == 6
    assert sum(pose.probability for pose in poses) == pytest.approx(1.0, abs=1e-9)
    heights = sorted(round(pose.height, 9) for pose in poses)
    assert heights == [0.2, 0.2, 0.275, 0.275, 0.475, 0.475]
    # Solid angle of a face of 2a x 2b at distance h: 4 asin(a b / sqrt((a^2+h^2)(b^2+h^2))).
    for pose in poses:
        halves = {0.2: (0.275, 0.475), 0.275: (0.2, 0.475), 0.475: (0.2, 0.275)}
        h = round(pose.height, 9)
        a, b = halves[h]
        angle = 4 * math.asin(a * b / math.sqrt((a * a + h * h) * (b * b + h * h)))
        assert pose.probability == pytest.approx(angle / (4 * math.pi), rel=1e-6)
        assert pose.min_slenderness == pytest.approx(math.atan2(min(a, b), h), rel=1e-9)


def test_a_mass_centre_outside_the_hull_is_an_error_not_a_hang() -> None:
    box = trimesh.creation.box()
    for center in ([2.0, 0.0, 0.0], [0.5, 0.0, 0.0]):
        with pytest.raises(GeometryError, match="outside the hull"):
            stable_poses(box, mass_center=np.array(center))


def test_report_of_the_block_says_what_the_closed_forms_say() -> None:
    text = report(MODELS / "block.obj", mass=500.0)
    assert "mass            500 kg" in text
    alpha = math.atan2(0.2, 0.475)
    assert f"{alpha:11.4f}" in text
    assert "in the given orientation" in text
    assert "assumed" not in text
    assert "assumed" in report(MODELS / "block.obj")


def test_summary_is_json_and_falls_back_to_a_stable_pose() -> None:
    half = math.radians(25.0) / 2.0
    summary = inertia_summary(
        MODELS / "block.obj",
        density=1000.0,
        orientation=(math.sin(half), 0.0, 0.0, math.cos(half)),
        azimuths=[0.0, 90.0],
    )
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary
    assert not summary["slenderness_as_given"]
    # Tilted by 25 degrees it falls back on the tall pose: heights and widths as upright.
    assert summary["slenderness"][0]["radius"] <= math.hypot(0.275, 0.475) + 1e-9
    assert summary["mass_kg"] == pytest.approx(1000.0 * 0.4 * 0.55 * 0.95)


def test_report_of_a_urdf_uses_its_own_mass() -> None:
    text = report(MODELS / "pbr_scan.urdf")
    assert "446.606 kg" in text
    with pytest.raises(GeometryError, match="own mass"):
        report(MODELS / "pbr_scan.urdf", mass=1.0)
    with pytest.raises(GeometryError, match="not both"):
        report(MODELS / "block.obj", mass=1.0, density=1.0)


def test_fixed_start_is_judged_in_its_orientation() -> None:
    lying = FixedStart(
        mode="pose",
        position=(0.0, 0.0, 2.7),
        orientation=(0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5)),
    )
    rock = BoxRock(shape="box", size=SIZE, mass=1.0, start=lying)
    body = build_rock(rock, build_pedestal(PrismPedestal()), clearance=0.002)
    (row,) = slenderness(body, [0.0])
    assert row.alpha == pytest.approx(math.atan2(0.475, 0.2), rel=1e-9)
