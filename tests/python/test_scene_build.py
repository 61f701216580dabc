"""From configuration to bodies, the models of this repository, and their generator."""

from __future__ import annotations

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from vsr2.config import Study, study_from_mapping
from vsr2.config.study import (
    Base,
    BoxRock,
    FixedStart,
    MeshPedestal,
    MeshRock,
    PrismPedestal,
    UrdfRock,
    YawStart,
)
from vsr2.errors import GeometryError
from vsr2.scene import (
    Box,
    Hull,
    SceneNote,
    SceneWarning,
    Triangles,
    build_pedestal,
    build_rock,
    build_scene,
    height_above,
    load_mesh,
    slenderness,
    start_support,
)
from vsr2.scene.rotation import matrix_from_quaternion
from vsr2.scene.shapes import hull_surface, rock_points
from vsr2.simulation import native_scene, run_batch

MODELS = Path(__file__).resolve().parents[2] / "models"
PRISM = build_pedestal(PrismPedestal())
TOPOGRAPHY = MODELS / "pedestal_topography.obj"


def test_prism_stands_on_its_base() -> None:
    body = build_pedestal(PrismPedestal(size=(3.0, 4.0, 0.6), base=Base(size=(9.0, 8.0, 1.5))))
    assert body.parts == (Box((3.0, 4.0, 0.6)),)
    assert body.origin == pytest.approx((0.0, 0.0, 1.8))
    assert body.top == pytest.approx(2.1)
    assert body.base_size == (9.0, 8.0, 1.5)
    assert body.mass == 2e5


@pytest.mark.parametrize("collision", ["triangles", "hull", "decomposition"])
def test_mesh_pedestal_stands_on_its_base(collision: str) -> None:
    if collision == "decomposition":
        pytest.importorskip("vhacdx")
    body = build_pedestal(MeshPedestal(shape="mesh", file=TOPOGRAPHY, collision=collision))
    assert body.origin == (0.0, 0.0, 2.0)
    points = np.vstack(
        [part.vertices if isinstance(part, Triangles) else part.points for part in body.parts]
    )
    # A decomposition voxelises: it may miss the surface by a cell of some centimetres.
    slack = 0.05 if collision == "decomposition" else 1e-12
    assert points[:, 2].min() == pytest.approx(0.0, abs=slack)
    assert body.top == pytest.approx(2.0 + points[:, 2].max(), abs=1e-12)
    assert body.top == pytest.approx(2.0 + 0.41807, abs=max(slack, 1e-9))
    assert all(
        isinstance(part, Triangles if collision == "triangles" else Hull) for part in body.parts
    )


def test_decomposition_keeps_a_hollow_that_the_hull_fills(tmp_path: Path) -> None:
    pytest.importorskip("vhacdx")
    # A U: two walls on a floor, one closed prism extruded along y.
    outline = np.array([[-1, 0], [1, 0], [1, 1], [0.6, 1], [0.6, 0.4], [-0.6, 0.4], [-0.6, 1],
                        [-1, 1]], dtype=float)  # fmt: skip
    count = len(outline)
    front = np.column_stack([outline[:, 0], np.full(count, -1.0), outline[:, 1]])
    vertices = np.vstack([front, front + np.array([0.0, 2.0, 0.0])])
    lids = np.array([[0, 5, 7], [5, 6, 7], [0, 1, 5], [1, 4, 5], [1, 2, 4], [2, 3, 4]])
    sides = [[i, (i + 1) % count, (i + 1) % count + count] for i in range(count)]
    sides += [[i, (i + 1) % count + count, i + count] for i in range(count)]
    faces = np.vstack([lids, lids[:, ::-1] + count, np.array(sides)[:, ::-1]])
    path = tmp_path / "u.obj"
    path.write_text(trimesh.Trimesh(vertices, faces, process=False).export(file_type="obj"))
    load_mesh(path)  # closed and oriented, or the comparison below means nothing
    rock = BoxRock(shape="box", size=(0.2, 0.2, 0.2), mass=1.0)
    heights = {}
    for collision in ("triangles", "hull", "decomposition"):
        pedestal = build_pedestal(MeshPedestal(shape="mesh", file=path, collision=collision))
        heights[collision] = build_rock(rock, pedestal, clearance=0.0).start.position[2] - 2.1
    assert heights["triangles"] == pytest.approx(0.4, abs=1e-9)
    assert heights["hull"] == pytest.approx(1.0, abs=1e-9)
    assert heights["decomposition"] == pytest.approx(0.4, abs=0.06)


def test_decomposition_is_repeatable() -> None:
    pytest.importorskip("vhacdx")
    config = MeshPedestal(shape="mesh", file=TOPOGRAPHY, collision="decomposition")
    first, second = build_pedestal(config), build_pedestal(config)
    assert len(first.parts) == len(second.parts)
    for a, b in zip(first.parts, second.parts, strict=True):
        assert isinstance(a, Hull)
        assert isinstance(b, Hull)
        np.testing.assert_array_equal(a.points, b.points)


def test_decomposition_without_its_package_names_the_remedy(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "vhacdx", None)
    with pytest.raises(GeometryError, match="pip install vhacdx"):
        build_pedestal(MeshPedestal(shape="mesh", file=TOPOGRAPHY, collision="decomposition"))


def test_open_topography_serves_as_triangles_only(tmp_path: Path) -> None:
    path = tmp_path / "sheet.obj"
    # Faces downwards on purpose: the body turns them up.
    path.write_text("v -1 -1 5\nv 1 -1 5\nv 1 1 5.1\nv -1 1 5\nf 1 3 2\nf 1 4 3\n")
    body = build_pedestal(MeshPedestal(shape="mesh", file=path, collision="triangles"))
    (part,) = body.parts
    assert isinstance(part, Triangles)
    assert part.vertices[:, 2].min() == 0.0
    corners = part.vertices[part.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (normal[:, 2] > 0).all()
    with pytest.raises(GeometryError, match="not watertight"):
        build_pedestal(MeshPedestal(shape="mesh", file=path, collision="decomposition"))


def test_a_mesh_beside_the_base_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "far.obj"
    path.write_text("v 400 0 0\nv 401 0 0\nv 400 1 0\nf 1 2 3\n")
    with pytest.raises(GeometryError, match="move the mesh to the origin"):
        build_pedestal(MeshPedestal(shape="mesh", file=path, collision="triangles"))
    with pytest.raises(GeometryError, match="choose `collision: triangles`"):
        build_pedestal(MeshPedestal(shape="mesh", file=path))


def test_box_rock() -> None:
    body = build_rock(BoxRock(shape="box", size=(0.4, 0.5, 1.0), density=2000.0), PRISM,
                      clearance=0.002)  # fmt: skip
    assert body.parts == (Box((0.4, 0.5, 1.0)),)
    assert body.mass.mass == pytest.approx(400.0)
    assert body.start.position == pytest.approx((0.0, 0.0, 3.002))
    assert body.surface is not None
    assert body.notes == ()


def test_the_hash_tells_whose_a_part_is_and_how_the_pedestal_slopes() -> None:
    scene = build_scene(study_from_mapping(
        {"rock": {"shape": "box", "size": [0.4, 0.5, 1.0], "density": 2000.0},
         "motion": {"mode": "single_cosine", "pga_g": 0.3, "pgv_pga_s": 0.1}},
        MODELS,
    ))  # fmt: skip
    rock, pedestal = scene.rock, scene.pedestal
    small = Box((0.1, 0.1, 0.1), center=(0.0, 0.0, 0.8))
    lines = [Hull(np.random.default_rng(3).random((count, 3))) for count in (5, 6)]
    joined = Hull(np.concatenate([one.points for one in lines]))
    scenes = [
        scene,
        replace(scene, rock=replace(rock, parts=(*rock.parts, small))),
        replace(scene, pedestal=replace(pedestal, parts=(small, *pedestal.parts))),
        replace(scene, pedestal=replace(pedestal, slope=(0.0, 0.01, 0.0, 0.99995))),
        replace(scene, rock=replace(rock, parts=tuple(lines))),
        replace(scene, rock=replace(rock, parts=(joined,))),
    ]
    assert len({one.sha256 for one in scenes}) == len(scenes)


def test_integers_are_numbers() -> None:
    scene = build_scene(study_from_mapping(
        {"rock": {"shape": "box", "size": [1, 1, 2], "density": 2000.0},
         "motion": {"mode": "single_cosine", "pga_g": 0.3, "pgv_pga_s": 0.1}},
        MODELS,
    ))  # fmt: skip
    rock = replace(scene.rock, parts=(Box((1, 1, 2)),))
    pedestal = replace(scene.pedestal, origin=(0, 0, 2), parts=(Box((1, 1, 2)),))
    native_scene(replace(scene, rock=rock, pedestal=pedestal))


@pytest.mark.parametrize("inertia", ["mesh", "aabb"])
def test_mesh_rock_rules(inertia: str) -> None:
    rock = MeshRock(shape="mesh", file=MODELS / "pbr_scan.obj", density=2650.0, inertia=inertia)
    body = build_rock(rock, PRISM, clearance=0.002)
    assert body.inertia_from_aabb == (inertia == "aabb")
    assert body.mass.mass == pytest.approx(446.606, rel=1e-5)
    (part,) = body.parts
    assert isinstance(part, Hull)
    assert part.points.shape == (3 * 5120, 3)
    assert body.surface is not None
    assert body.surface.faces.shape == (5120, 3)
    assert len(body.sha256) == 64
    if inertia == "aabb":
        np.testing.assert_array_equal(body.mass.mass_center, 0.0)


def test_mesh_and_urdf_of_the_same_rock_agree() -> None:
    start = YawStart(yaw=25.0)
    mesh = build_rock(
        MeshRock(shape="mesh", file=MODELS / "pbr_scan.obj", density=2650.0, start=start),
        PRISM,
        clearance=0.002,
    )
    urdf = build_rock(
        UrdfRock(shape="urdf", file=MODELS / "pbr_scan.urdf", start=start), PRISM, clearance=0.002
    )
    np.testing.assert_array_equal(rock_points(mesh), rock_points(urdf))
    assert urdf.mass.mass == pytest.approx(mesh.mass.mass, rel=1e-8)
    # The URDF holds nine digits.
    np.testing.assert_allclose(urdf.mass.mass_center, mesh.mass.mass_center, atol=1e-9)
    np.testing.assert_allclose(urdf.mass.principal_inertia, mesh.mass.principal_inertia, rtol=1e-7)
    np.testing.assert_allclose(urdf.mass.principal_axes, mesh.mass.principal_axes, atol=1e-6)
    np.testing.assert_allclose(urdf.start.position, mesh.start.position, atol=1e-8)
    assert urdf.notes == ()


def test_notes_of_a_doubtful_start() -> None:
    def notes(z: float, x: float = 0.0, size: float = 1.0) -> list[tuple[str, list[float]]]:
        rock = BoxRock(
            shape="box", size=(size,) * 3, mass=1.0,
            start=FixedStart(mode="pose", position=(x, 0.0, z)),
        )  # fmt: skip
        found = build_rock(rock, PRISM, clearance=0.002).notes
        return [
            (note.code, [value for value in note.values.values() if isinstance(value, float)])
            for note in found
        ]

    assert notes(3.0) == notes(3.002) == []
    assert notes(3.5) == [(SceneNote.ABOVE_PEDESTAL, pytest.approx([0.5]))]
    assert notes(2.95) == [(SceneNote.INSIDE_PEDESTAL, pytest.approx([0.05]))]
    with pytest.raises(GeometryError, match="inside the pedestal"):
        notes(2.8)
    assert notes(3.0, x=5.2) == [(SceneNote.BESIDE_PEDESTAL, [5.2, 0.0])]
    assert notes(2.502, size=0.005) == [(SceneNote.UNUSUAL_SIZE, [0.005])]


def block(**changes: object) -> Study:
    rock = {"shape": "box", "size": [0.4, 0.5, 1.0], "density": 2600.0}
    motion = {"mode": "single_cosine", "pga_g": 0.3, "pgv_pga_s": 0.1}
    return study_from_mapping({"rock": rock, "motion": motion, **changes}, ".", check_files=False)


def test_a_rock_larger_than_its_prism_is_refused() -> None:
    wide = {"shape": "box", "size": [10.1, 0.5, 1.0], "density": 2600.0}
    with pytest.raises(GeometryError, match=r"10.1 m x 0.5 m in plan.*enlarge pedestal.size"):
        build_scene(block(rock=wide))
    build_scene(block(rock=wide, pedestal={"size": [10.2, 1.0, 0.5]}))
    # Along the longer side of the top it fits.
    turned = {**wide, "start": {"mode": "yaw", "yaw": 90.0}}
    build_scene(block(rock=turned, pedestal={"size": [1.0, 10.2, 0.5]}))


def test_a_mesh_in_millimetres_is_a_warning_in_python(tmp_path: Path) -> None:
    box = trimesh.creation.box(extents=(40.0, 50.0, 100.0))
    box.export(tmp_path / "block.obj")
    rock = {"shape": "mesh", "file": str(tmp_path / "block.obj"), "mass": 500.0}
    with pytest.warns(SceneWarning, match=r"100 m long; .* not the metre, scale it: `scale`"):
        build_scene(block(rock=rock, pedestal={"size": [60.0, 60.0, 0.5]}))


def test_a_mesh_in_millimetres_that_could_be_a_boulder_hears_of_its_unit(tmp_path: Path) -> None:
    """Nine metres are no unusual size, but no contact is made for 1,310 t."""
    trimesh.creation.box(extents=(7.0, 8.0, 9.0)).export(tmp_path / "block.obj")
    rock = {"shape": "mesh", "file": str(tmp_path / "block.obj"), "density": 2600.0}
    with pytest.warns(SceneWarning, match=r"rock of 1\.31e\+06 kg .* needs `scale: 0\.001`"):
        build_scene(block(rock=rock, pedestal={"size": [10.0, 10.0, 0.5]}))


@pytest.mark.parametrize("mode", ["fast", "exact"])
def test_a_rock_that_sinks_into_a_soft_pedestal_is_a_warning(mode: str) -> None:
    soft = {"stiffness": 2.0e4, "damping": 2.0e3}
    study = block(
        engine={"mode": mode},
        contact={"rock": soft, "pedestal": soft},
        motion={"mode": "single_cosine", "pga_g": 0.01, "pgv_pga_s": 0.1},
        output={"log_every": 1, "log_settling": True},
    )
    with pytest.warns(SceneWarning, match="at least 0.128 m into the pedestal") as caught:
        result = run_batch(study)
    assert "raise contact.rock.stiffness" in str(caught[0].message)
    height = result.logs[0].position[:, 2]
    # m g / (4 k) with the pair's k of 1e4 N/m, from where the margins touch.
    assert height[0] - height[-1] - 0.002 == pytest.approx(520.0 * 9.81 / 4e4, rel=0.02)


LIVELY = {"restitution": 0.8, "stiffness": 2.6e9, "damping": 1e5}
"""The pair: e 0.64, and of a penetration a step of 4 ms undoes 0.963."""


def test_impacts_that_may_gain_energy_are_a_warning() -> None:
    contact = {"rock": LIVELY, "pedestal": LIVELY}
    with pytest.warns(SceneWarning, match="impacts may gain energy") as caught:
        build_scene(block(engine={"time_step": 0.004}, contact=contact))
    said = str(caught[0].message)
    assert "restitution of 0.64" in said
    assert "undoes, 0.963" in said
    assert "time_step to 8.65e-05 s or less" in said
    # Two solver steps of 8.6e-5 s each.
    assert build_scene(block(engine={"time_step": 1.72e-4, "substeps": 2}, contact=contact))
    dull = {**LIVELY, "restitution": 0.0}
    assert build_scene(block(contact={"rock": dull, "pedestal": LIVELY})).rock.notes == ()


def test_stiff_contacts_do_not_warn() -> None:
    assert build_scene(block()).rock.notes == ()


def test_the_scan_stands_with_a_margin() -> None:
    rock = MeshRock(shape="mesh", file=MODELS / "pbr_scan.obj", density=2650.0)
    body = build_rock(rock, PRISM, clearance=0.002)
    assert body.notes == ()
    # The base is a plane, so the strictest tolerance must find the support.
    loaded = load_mesh(MODELS / "pbr_scan.obj")
    alphas = [row.alpha for row in slenderness(body, range(0, 360, 3), tolerance=1e-6)]
    assert 0.2 < min(alphas) < max(alphas) < 0.35
    assert start_support(body, tolerance=1e-6).margin > 0.09
    assert 0.95 < np.ptp(loaded.mesh.vertices[:, 2]) < 1.05
    assert 3000 <= len(loaded.mesh.faces) <= 6000
    assert 300 <= len(hull_surface(loaded.hull_points[0]).vertices) <= 600
    assert (MODELS / "pbr_scan.obj").stat().st_size < 600_000


def test_the_scan_is_lowered_onto_the_topography() -> None:
    pedestal = build_pedestal(MeshPedestal(shape="mesh", file=TOPOGRAPHY))
    rock = MeshRock(shape="mesh", file=MODELS / "pbr_scan.obj", density=2650.0)
    for yaw in (0.0, 50.0):
        start = YawStart(yaw=yaw, position_xy=(0.3, -0.4))
        body = build_rock(rock.model_copy(update={"start": start}), pedestal, clearance=0.002)
        height = height_above(body.parts, body.start, pedestal)
        assert height is not None
        # The vertical gap is the normal gap over the cosine of a slope of at most 0.2.
        assert 0.002 * 0.985 <= height <= 0.002 * 1.02
        assert body.notes == ()
        lowest = (rock_points(body) @ matrix_from_quaternion(body.start.orientation).T)[:, 2].min()
        assert 2.38 < lowest + body.start.position[2] < pedestal.top + 0.003


def test_the_generator_reproduces_the_committed_models(tmp_path: Path) -> None:
    spec = importlib.util.spec_from_file_location("make_models", MODELS / "make.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.main(tmp_path)
    for name in ("pbr_scan.obj", "block.obj", "pedestal_topography.obj"):
        made, kept = (load_mesh(folder / name) for folder in (tmp_path, MODELS))
        # One unit of the fifth decimal, for another machine's rounding.
        np.testing.assert_allclose(made.hull_points[0], kept.hull_points[0], atol=1.1e-5)
    assert (tmp_path / "pbr_scan.urdf").stat().st_size == pytest.approx(
        (MODELS / "pbr_scan.urdf").stat().st_size, abs=8
    )
