"""URDF rocks: frames, inertia rules, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from vsr2.codes import Statement
from vsr2.errors import GeometryError
from vsr2.scene import Box, Hull, LoadedMesh, SceneNote, load_mesh, load_urdf
from vsr2.scene.rotation import matrix_from_rpy

INERTIAL = """<inertial><origin xyz="0.1 0.2 0.3" rpy="0 0 0"/><mass value="12"/>
<inertia ixx="3" ixy="0" ixz="0" iyy="2" iyz="0" izz="2.5"/></inertial>"""
BOX = '<collision><geometry><box size="1 2 3"/></geometry></collision>'


def urdf(folder: Path, body: str, name: str = "rock.urdf") -> Path:
    path = folder / name
    path.write_text(f'<?xml version="1.0"?>\n<robot name="r"><link name="l">{body}</link></robot>')
    return path


def test_diagonal_tensor_is_taken_to_the_last_bit(tmp_path: Path) -> None:
    model = load_urdf(urdf(tmp_path, INERTIAL + BOX))
    assert model.mass.mass == 12.0
    np.testing.assert_array_equal(model.mass.mass_center, [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(model.mass.principal_inertia, [3.0, 2.0, 2.5])
    np.testing.assert_array_equal(model.mass.principal_axes, np.eye(3))
    assert isinstance(model.parts[0], Box)
    assert model.parts[0].size == (1.0, 2.0, 3.0)
    assert not model.inertia_from_aabb


def test_full_tensor_in_a_turned_frame_is_diagonalised(tmp_path: Path) -> None:
    body = """<inertial><origin xyz="0 0 0" rpy="0.3 -0.2 0.5"/><mass value="1"/>
<inertia ixx="3" ixy="0.2" ixz="-0.1" iyy="2" iyz="0.3" izz="2.5"/></inertial>"""
    mass = load_urdf(urdf(tmp_path, body + BOX)).mass
    given = np.array([[3, 0.2, -0.1], [0.2, 2, 0.3], [-0.1, 0.3, 2.5]])
    rotation = matrix_from_rpy(0.3, -0.2, 0.5)
    np.testing.assert_allclose(
        mass.principal_axes @ np.diag(mass.principal_inertia) @ mass.principal_axes.T,
        rotation @ given @ rotation.T,
        atol=1e-12,
    )
    assert np.linalg.det(mass.principal_axes) == pytest.approx(1.0)


def test_roll_pitch_yaw_turn_about_fixed_axes() -> None:
    # Roll carries z to -y; the quarter turn about fixed z then carries -y to x.
    turned = matrix_from_rpy(np.pi / 2, 0.0, np.pi / 2) @ [0.0, 0.0, 1.0]
    np.testing.assert_allclose(turned, [1.0, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(
        matrix_from_rpy(0.0, np.pi / 2, 0.0) @ [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], atol=1e-15
    )


def test_mesh_rule_is_the_homogeneous_solid_with_the_files_mass(tmp_path: Path) -> None:
    trimesh.creation.box(extents=(0.5, 1.0, 1.5)).export(tmp_path / "box.obj")
    body = """<collision><origin xyz="1 0 0" rpy="0 0 1.5707963267948966"/><geometry>
<mesh filename="box.obj" scale="2 2 2"/></geometry></collision>"""
    path = urdf(tmp_path, INERTIAL + body)
    mass = load_urdf(path, inertia="mesh").mass
    assert mass.mass == 12.0
    np.testing.assert_allclose(mass.mass_center, [1.0, 0.0, 0.0], atol=1e-12)
    # Edges 1 x 2 x 3, turned by a quarter about z: 2 x 1 x 3 along the link's axes.
    np.testing.assert_allclose(mass.principal_inertia, [10.0, 13.0, 5.0], rtol=1e-9)
    np.testing.assert_allclose(mass.principal_axes, np.eye(3), atol=1e-9)
    part = load_urdf(path).parts[0]
    assert isinstance(part, Hull)
    np.testing.assert_allclose(part.points.min(axis=0), [0.0, -0.5, -1.5], atol=1e-6)
    np.testing.assert_allclose(part.points.max(axis=0), [2.0, 0.5, 1.5], atol=1e-6)


def test_a_mesh_that_is_named_often_is_read_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trimesh.creation.box(extents=(0.5, 1.0, 1.5)).export(tmp_path / "box.obj")
    one = '<collision><origin xyz="{} 0 0"/><geometry><mesh filename="box.obj"/></geometry>'
    body = "".join(f"{one.format(i)}</collision>" for i in range(200))
    read: list[object] = []

    def load(path: Path, **options: object) -> LoadedMesh:
        read.append(path)
        return load_mesh(path, **options)

    monkeypatch.setattr("vsr2.scene.urdf.load_mesh", load)
    model = load_urdf(urdf(tmp_path, INERTIAL + body))
    assert read == [tmp_path / "box.obj"]
    assert len(model.parts) == 200
    assert model.parts[199].points[:, 0].min() == pytest.approx(198.75)


def test_copies_of_a_mesh_at_one_pose_share_their_hulls(tmp_path: Path) -> None:
    box = trimesh.creation.box(extents=(0.5, 1.0, 1.5))
    for name in ("box.obj", "copy.obj"):
        box.export(tmp_path / name)
    named = [
        f'<collision><origin xyz="{x} 0 0"/><geometry><mesh filename="{name}" scale="{scale}"/>'
        "</geometry></collision>"
        for x, scale in ((0, "1 1 1"), (1, "1 1 1"), (0, "2 2 2"))
        for name in ("box.obj", "./box.obj", "copy.obj")
    ]
    parts = load_urdf(urdf(tmp_path, INERTIAL + "".join(named))).parts
    assert len(parts) == 9
    assert [parts.index(part) for part in parts] == [0, 0, 0, 3, 3, 3, 6, 6, 6]
    alone = load_urdf(urdf(tmp_path, INERTIAL + named[8])).parts[0]
    np.testing.assert_array_equal(parts[8].points, alone.points)


@pytest.mark.parametrize("way", ["absolute", "above", "link", "uri"])
def test_a_mesh_outside_the_urdfs_folder_is_refused(way: str, tmp_path: Path) -> None:
    folder = tmp_path / "rock"
    folder.mkdir()
    outside = tmp_path / "box.obj"
    trimesh.creation.box(extents=(0.5, 1.0, 1.5)).export(outside)
    (folder / "link.obj").symlink_to(outside)
    name = {
        "absolute": str(outside),
        "above": "../box.obj",
        "link": "link.obj",
        "uri": f"file://{outside}",
    }[way]
    body = f'<collision><geometry><mesh filename="{name}"/></geometry></collision>'
    with pytest.raises(GeometryError, match="leads out of the URDF's folder; copy the mesh"):
        load_urdf(urdf(folder, INERTIAL + body))


def test_box_rule_and_aabb_rule(tmp_path: Path) -> None:
    path = urdf(tmp_path, INERTIAL + BOX)
    mass = load_urdf(path, inertia="mesh").mass
    np.testing.assert_allclose(mass.principal_inertia, [13.0, 10.0, 5.0])
    np.testing.assert_array_equal(mass.mass_center, 0.0)
    model = load_urdf(path, inertia="aabb")
    assert model.inertia_from_aabb
    np.testing.assert_allclose(model.mass.principal_inertia, [13.0, 10.0, 5.0])
    np.testing.assert_array_equal(model.mass.mass_center, [0.1, 0.2, 0.3])


def test_scale_is_a_unit_of_length(tmp_path: Path) -> None:
    model = load_urdf(urdf(tmp_path, INERTIAL + BOX), scale=0.1)
    assert model.mass.mass == 12.0
    np.testing.assert_allclose(model.mass.mass_center, [0.01, 0.02, 0.03])
    np.testing.assert_allclose(model.mass.principal_inertia, [0.03, 0.02, 0.025])
    assert isinstance(model.parts[0], Box)
    np.testing.assert_allclose(model.parts[0].size, [0.1, 0.2, 0.3])


def test_several_parts_and_the_cylinder(tmp_path: Path) -> None:
    body = (
        BOX
        + """<collision><origin xyz="0 0 2"/><geometry>
<cylinder radius="0.5" length="2"/></geometry></collision>"""
    )
    model = load_urdf(urdf(tmp_path, INERTIAL + body))
    assert len(model.parts) == 2
    prism = model.parts[1]
    assert isinstance(prism, Hull)
    assert prism.points[:, 2].min() == pytest.approx(1.0)
    np.testing.assert_allclose(np.linalg.norm(prism.points[:, :2], axis=1), 0.5, rtol=1e-12)
    (note,) = model.notes
    assert note == Statement.of(SceneNote.CYLINDER_AS_PRISM, file="rock.urdf", sides=64)
    with pytest.raises(GeometryError, match="may overlap"):
        load_urdf(urdf(tmp_path, INERTIAL + body), inertia="mesh")


def test_inertia_that_cannot_be_the_rocks_own_gets_a_note(tmp_path: Path) -> None:
    wrong = INERTIAL.replace('ixx="3"', 'ixx="1.5"').replace('iyy="2"', 'iyy="1.3"')
    wrong = wrong.replace('izz="2.5"', 'izz="0.7"')
    (note,) = load_urdf(urdf(tmp_path, wrong + BOX)).notes
    assert note.code is SceneNote.UNUSUAL_INERTIA
    # 12/12 (2^2 + 3^2) = 13, 12/12 (1^2 + 3^2) = 10, 12/12 (1^2 + 2^2) = 5, in rising order.
    assert note.values["solid"] == pytest.approx((5.0, 10.0, 13.0))
    assert note.values["ratios"] == pytest.approx((0.14, 0.13, 1.5 / 13.0))
    right = INERTIAL.replace('ixx="3"', 'ixx="13"').replace('iyy="2"', 'iyy="10"')
    right = right.replace('izz="2.5"', 'izz="5"')
    assert load_urdf(urdf(tmp_path, right + BOX)).notes == ()
    far = right.replace('xyz="0.1 0.2 0.3"', 'xyz="0 0 5"')
    (note,) = load_urdf(urdf(tmp_path, far + BOX)).notes
    assert note == Statement.of(SceneNote.DISTANT_MASS_CENTER, file="rock.urdf", distance=5.0)


BROKEN = {
    "no link": ("<robot/>", "0 links"),
    "two links": ('<robot><link name="a"/><link name="b"/></robot>', "2 links and 0 joints"),
    "a joint": ('<robot><link name="a"/><joint name="j"/></robot>', "1 link and 1 joint;"),
    "not a robot": ("<model/>", "not <robot>"),
    "not xml": ("<robot><link>", "not valid XML"),
    "doctype": ('<!DOCTYPE r [<!ENTITY a "b">]><robot/>', "DOCTYPE"),
    "entity": ("<!doctype r><robot/>", "DOCTYPE"),
    "no collision": (f"<robot><link>{INERTIAL}</link></robot>", "no <collision>"),
    "no mass": (f"<robot><link>{BOX}</link></robot>", "<inertial> with <mass>"),
    "no inertia": (
        f'<robot><link><inertial><mass value="1"/></inertial>{BOX}</link></robot>',
        "no <inertia>",
    ),
    "negative mass": (
        f"<robot><link>{INERTIAL}{BOX}</link></robot>".replace('value="12"', 'value="-12"'),
        "must be positive",
    ),
    "nan": (
        f"<robot><link>{INERTIAL}{BOX}</link></robot>".replace('ixx="3"', 'ixx="nan"'),
        "finite",
    ),
    "triangle inequality": (
        f"<robot><link>{INERTIAL}{BOX}</link></robot>".replace('ixx="3"', 'ixx="5"'),
        "inertia: mesh",
    ),
    "sphere": (
        f"<robot><link>{INERTIAL}{BOX}</link></robot>".replace(
            '<box size="1 2 3"/>', '<sphere radius="1"/>'
        ),
        "as a mesh",
    ),
    "two shapes": (
        f"<robot><link>{INERTIAL}{BOX}</link></robot>".replace(
            "<geometry>", '<geometry><box size="1 1 1"/>'
        ),
        "exactly one",
    ),
    "package": (
        f"<robot><link>{INERTIAL}{BOX}</link></robot>".replace(
            '<box size="1 2 3"/>', '<mesh filename="package://rocks/a.obj"/>'
        ),
        "relative",
    ),
    "missing mesh": (
        f"<robot><link>{INERTIAL}{BOX}</link></robot>".replace(
            '<box size="1 2 3"/>', '<mesh filename="a.obj"/>'
        ),
        "a.obj: no such file",
    ),
    "mirrored mesh": (
        f"<robot><link>{INERTIAL}{BOX}</link></robot>".replace(
            '<box size="1 2 3"/>', '<mesh filename="a.obj" scale="1 -1 1"/>'
        ),
        "positive",
    ),
}


@pytest.mark.parametrize("case", BROKEN)
def test_broken_urdfs_are_refused_with_file_and_remedy(tmp_path: Path, case: str) -> None:
    text, message = BROKEN[case]
    path = tmp_path / "rock.urdf"
    path.write_text(text)
    with pytest.raises(GeometryError, match=message) as caught:
        load_urdf(path)
    assert str(tmp_path) in str(caught.value)


def test_other_encodings_cannot_hide_entities(tmp_path: Path) -> None:
    path = tmp_path / "rock.urdf"
    path.write_bytes('<!DOCTYPE r [<!ENTITY a "b">]><robot/>'.encode("utf-16"))
    with pytest.raises(GeometryError, match="UTF-8"):
        load_urdf(path)


def test_size_is_bounded(tmp_path: Path) -> None:
    path = tmp_path / "rock.urdf"
    path.write_text("<robot>" + " " * 1_000_001 + "</robot>")
    with pytest.raises(GeometryError, match="larger than 1000000 bytes"):
        load_urdf(path)


def test_open_mesh_collides_but_has_no_inertia_of_its_own(tmp_path: Path) -> None:
    box = trimesh.creation.box()
    trimesh.Trimesh(box.vertices, box.faces[:-1], process=False).export(tmp_path / "open.obj")
    body = '<collision><geometry><mesh filename="open.obj"/></geometry></collision>'
    path = urdf(tmp_path, INERTIAL + body)
    assert len(load_urdf(path).parts) == 1
    with pytest.raises(GeometryError, match="not watertight"):
        load_urdf(path, inertia="mesh")
