"""Meshes: what is read to the last bit, what is refused and how, what a repair does."""

from __future__ import annotations

import os
import re
import time
import warnings
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from vsr2.codes import Statement
from vsr2.errors import GeometryError, Vsr2Error
from vsr2.scene import LoadedMesh, SceneNote, load_mesh, load_urdf, mesh_files

ROOT = Path(__file__).resolve().parents[2]
LAB = Path(os.environ.get("VSR2_LAB_DATA", ROOT.parent / "shared" / "lab")) / "models"
needs_lab = pytest.mark.skipif(
    not LAB.is_dir(), reason="laboratory meshes absent (set VSR2_LAB_DATA)"
)

CUBE = """
o cube
v 0 0 0
v 0.1 0 0
v 0.1 0.1 0
v 0 0.1 0
v 0 0 0.1
v 0.1 0 0.1
v 0.1 0.1 0.1
v 0 0.1 0.1
f 1 4 3 2
f 5/1 6/2 7/3 8/4
f 1//1 2//1 6//1 5//1
f 2/1/1 3/1/1 7/1/1 6/1/1
f -6 -5 -1 -2
f 4 1 5 8
"""


def write(folder: Path, text: str, name: str = "rock.obj") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def as_obj(vertices: np.ndarray, faces: np.ndarray) -> str:
    rows = ["v " + " ".join(repr(float(value)) for value in vertex) for vertex in vertices]
    rows += ["f " + " ".join(str(index + 1) for index in face) for face in faces]
    return "\n".join(rows)


def values_of(loaded: LoadedMesh) -> dict[str, dict[str, float]]:
    """Of its notes by code, beside the file."""
    assert all(note.values["file"] == "rock.obj" for note in loaded.notes)
    return {
        note.code: {name: value for name, value in note.values.items() if name != "file"}
        for note in loaded.notes
    }


def ball() -> tuple[np.ndarray, np.ndarray]:
    sphere = trimesh.creation.icosphere(subdivisions=2, radius=0.5)
    return np.array(sphere.vertices), np.array(sphere.faces)


def test_obj_polygons_slashes_and_relative_indices(tmp_path: Path) -> None:
    loaded = load_mesh(write(tmp_path, CUBE))
    assert len(loaded.mesh.vertices) == 8
    assert len(loaded.mesh.faces) == 12
    assert loaded.mesh.volume == pytest.approx(1e-3, rel=1e-12)
    assert loaded.notes == ()


def test_hull_points_are_single_precision_in_file_order_with_duplicates(tmp_path: Path) -> None:
    (points,) = load_mesh(write(tmp_path, CUBE), scale=3.0).hull_points
    tenth = float(np.float32(0.1)) * 3.0
    assert tenth != 0.1 * 3.0  # the rounding is visible, so the comparison below is one
    # First quad 1 4 3 2 as the fan (1, 4, 3), (1, 3, 2).
    expected = [[0, 0, 0], [0, tenth, 0], [tenth, tenth, 0], [0, 0, 0], [tenth, tenth, 0]]
    np.testing.assert_array_equal(points[:5], expected)
    assert points.shape == (36, 3)


def test_objects_and_groups_give_one_hull_each_and_empty_ones_none(tmp_path: Path) -> None:
    triangles = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
    path = write(
        tmp_path, triangles + "o a\ng b\nf 1 2 3\nusemtl x\nf 1 2 4\ng c\no d e\nf 2 3 4\n"
    )
    loaded = load_mesh(path, closed=False)
    assert [len(points) for points in loaded.hull_points] == [6, 3]
    assert loaded.notes == (Statement.of(SceneNote.SEVERAL_OBJECTS, file="rock.obj", count=2),)


@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r", "  \t\n"])
def test_line_ends_and_blanks_do_not_matter(tmp_path: Path, newline: str) -> None:
    path = tmp_path / "rock.obj"
    path.write_bytes(CUBE.replace("\n", newline).encode())
    np.testing.assert_array_equal(
        load_mesh(path).hull_points[0],
        load_mesh(write(tmp_path, CUBE, "plain.obj")).hull_points[0],
    )


@pytest.mark.parametrize("name", ["rock.stl", "ascii.stl", "rock.ply", "ascii.ply"])
def test_stl_and_ply_give_the_same_body_as_obj(tmp_path: Path, name: str) -> None:
    vertices, faces = ball()
    vertices = vertices.astype(np.float32).astype(float)  # what these formats can hold
    body = trimesh.Trimesh(vertices, faces, process=False)
    path = tmp_path / name
    if name == "ascii.stl":
        corners = vertices[faces]
        facets = "".join(
            "facet normal 0 0 0\nouter loop\n"
            + "".join(f"vertex {x!r} {y!r} {z!r}\n" for x, y, z in triangle.tolist())
            + "endloop\nendfacet\n"
            for triangle in corners
        )
        path.write_text(f"solid x\n{facets}endsolid x\n")
    elif name == "ascii.ply":
        path.write_bytes(trimesh.exchange.ply.export_ply(body, encoding="ascii"))
    else:
        body.export(path)
    reference = load_mesh(write(tmp_path, as_obj(vertices, faces)))
    loaded = load_mesh(path)
    np.testing.assert_allclose(loaded.hull_points[0], reference.hull_points[0], atol=1e-8)
    assert len(loaded.mesh.vertices) == len(vertices)
    assert loaded.mesh.volume == pytest.approx(reference.mesh.volume, rel=1e-6)


def test_exact_duplicates_are_merged_without_being_a_repair(tmp_path: Path) -> None:
    vertices, faces = ball()
    soup = vertices[faces].reshape(-1, 3)
    loaded = load_mesh(write(tmp_path, as_obj(soup, np.arange(len(soup)).reshape(-1, 3))))
    assert len(loaded.mesh.vertices) == len(vertices)
    assert loaded.notes == ()


def test_scale_applies_to_all_lengths(tmp_path: Path) -> None:
    path = write(tmp_path, CUBE)
    assert load_mesh(path, scale=10.0).mesh.volume == pytest.approx(1.0, rel=1e-12)
    stretched = load_mesh(path, scale=(1.0, 2.0, 4.0))
    np.testing.assert_allclose(np.ptp(stretched.mesh.vertices, axis=0), [0.1, 0.2, 0.4])
    for bad in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(GeometryError, match="scale"):
            load_mesh(path, scale=bad)


BROKEN = {
    "empty": ("", "empty"),
    "blank": (" \n \n", "empty"),
    "no faces": ("v 0 0 0\nv 1 0 0\n", "point cloud"),
    "not a number": (CUBE.replace("v 0 0.1 0\n", "v 0 x 0\n"), "line 6: 'v 0 x 0'"),
    "nan": (CUBE.replace("v 0 0.1 0\n", "v 0 nan 0\n"), "vertex 4 is"),
    "inf": (CUBE.replace("v 0 0.1 0\n", "v 0 1e999 0\n"), "not finite"),
    "two coordinates": ("v 0 0\nf 1 1 1\n", "three coordinates"),
    "two corners": (CUBE + "f 1 2\n", "three vertices"),
    "index zero": (CUBE + "f 0 1 2\n", "no vertex 0"),
    "index too low": (CUBE + "f -9 1 2\n", "no vertex -9"),
    "index too high": (CUBE + "f 1 2 9\n", "outside the 8 vertices"),
    "huge index": (CUBE + "f 1 2 99999999999999999999999\n", "line"),
    "binary": ("v 0 0 0\0", "not a text file"),
    "kilometres": (CUBE.replace("0.1", "1e6"), "unit"),
    "far origin": (CUBE.replace("v 0 ", "v 9e7 ").replace("v 0.1 ", "v 90000001 "), "origin"),
    "microscopic": (CUBE.replace("0.1", "1e-6"), "unit"),
    "one open face": (CUBE.replace("f 4 1 5 8\n", ""), "4 open edges in 1 hole;.*repair: true"),
    "face of three edges too many": (CUBE + "f 1 2 7\n", "edges of more than two faces"),
    "inverted face": (CUBE.replace("f 4 1 5 8", "f 8 5 1 4"), "disagree.*repair: true"),
    "no area": ("v 0 0 0\nv 1 0 0\nf 1 2 2\n", "without area"),
    "sheet": ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 3 2 1\n", "sheet"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_broken_meshes_are_refused_with_file_and_remedy(tmp_path: Path, case: str) -> None:
    text, message = BROKEN[case]
    with pytest.raises(GeometryError, match=message) as caught:
        load_mesh(write(tmp_path, text))
    assert "rock.obj" in str(caught.value)


def test_inside_out_is_refused_and_repaired(tmp_path: Path) -> None:
    vertices, faces = ball()
    path = write(tmp_path, as_obj(vertices, faces[:, ::-1]))
    with pytest.raises(GeometryError, match=r"volume is negative.*repair: true"):
        load_mesh(path)
    repaired = load_mesh(path, repair=True)
    assert repaired.mesh.volume > 0
    assert values_of(repaired)[SceneNote.FLIPPED_FACES] == {"count": 320}


def test_two_bodies_are_refused_but_crumbs_can_be_repaired(tmp_path: Path) -> None:
    vertices, faces = ball()
    big = np.vstack([vertices, vertices + np.array([2.0, 0.0, 0.0])])
    path = write(tmp_path, as_obj(big, np.vstack([faces, faces + len(vertices)])))
    for repair in (False, True):
        with pytest.raises(GeometryError, match="2 separate bodies"):
            load_mesh(path, repair=repair)
    crumb = np.vstack([vertices, 0.01 * vertices + np.array([2.0, 0.0, 0.0])])
    path = write(tmp_path, as_obj(crumb, np.vstack([faces, faces + len(vertices)])))
    with pytest.raises(GeometryError, match="separate bodies"):
        load_mesh(path)
    repaired = load_mesh(path, repair=True)
    removed = values_of(repaired)[SceneNote.REMOVED_PARTS]
    assert removed == {"count": 1, "share": pytest.approx(1e-4, rel=1e-3)}
    # The crumb must be gone from the collision hull too.
    assert max(points[:, 0].max() for points in repaired.hull_points) < 0.6


def test_repair_closes_holes_orients_faces_and_says_so(tmp_path: Path) -> None:
    vertices, faces = ball()
    complete = trimesh.Trimesh(vertices, faces, process=False).volume
    # All faces around one vertex (a hole of five or six corners), one face, one quad elsewhere.
    around = (faces == 0).any(axis=1)
    far = np.flatnonzero((vertices[faces][:, :, 2] < -0.3).all(axis=1))
    kept = np.delete(faces, np.concatenate([np.flatnonzero(around), far[:1]]), axis=0)
    kept[10:20] = kept[10:20, ::-1]
    path = write(tmp_path, as_obj(vertices, kept))
    with pytest.raises(GeometryError, match="in 2 holes"):
        load_mesh(path)
    repaired = load_mesh(path, repair=True)
    done = values_of(repaired)
    assert done[SceneNote.FILLED_HOLES]["holes"] == 2
    assert done[SceneNote.FLIPPED_FACES] == {"count": 10}
    assert done[SceneNote.REPAIRED_VOLUME]["after"] == pytest.approx(repaired.mesh.volume)
    assert repaired.mesh.is_watertight
    assert repaired.mesh.is_winding_consistent
    # A cap of the ball is cut off: less than a hundredth of it.
    assert 0.99 * complete < repaired.mesh.volume < complete


def test_repair_merges_near_vertices(tmp_path: Path) -> None:
    vertices, faces = ball()
    rng = np.random.default_rng(1)
    soup = vertices[faces].reshape(-1, 3) + rng.uniform(-1e-8, 1e-8, size=(3 * len(faces), 3))
    path = write(tmp_path, as_obj(soup, np.arange(len(soup)).reshape(-1, 3)))
    with pytest.raises(GeometryError, match="open edges"):
        load_mesh(path)
    repaired = load_mesh(path, repair=True)
    assert len(repaired.mesh.vertices) == len(vertices)
    assert values_of(repaired)[SceneNote.MERGED_VERTICES] == {"count": 798, "tolerance": 1e-6}


def test_repair_of_a_sound_mesh_changes_nothing(tmp_path: Path) -> None:
    path = write(tmp_path, as_obj(*ball()))
    plain, repaired = load_mesh(path), load_mesh(path, repair=True)
    np.testing.assert_array_equal(plain.mesh.vertices, repaired.mesh.vertices)
    np.testing.assert_array_equal(plain.mesh.faces, repaired.mesh.faces)
    assert values_of(repaired) == {SceneNote.NOTHING_TO_REPAIR: {}}


def test_open_surfaces_are_read_where_asked(tmp_path: Path) -> None:
    path = write(tmp_path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert len(load_mesh(path, closed=False).mesh.faces) == 1


def test_files_that_are_none(tmp_path: Path) -> None:
    for path, message in [
        (tmp_path / "none.obj", "no such file"),
        (tmp_path, "not a file"),
        (write(tmp_path, CUBE, "rock.dae"), "convert to"),
        (write(tmp_path, CUBE, "rock"), "convert to"),
        (write(tmp_path, CUBE, "rock.stl"), "not a valid STL"),
        (
            write(tmp_path, "solid\nvertex 0 0 0\nendloop\n", "a.stl"),
            "facet 1 has.* 1 vertices, not three",
        ),
        (
            write(tmp_path, "solid\n" + 3 * "vertex 0 0\n" + "endloop\nendsolid", "b.stl"),
            "not a valid STL",
        ),
        (write(tmp_path, "solid\nvertex 0 0 0\n", "c.stl"), "no end"),
        (
            write(tmp_path, "solid\n" + 3 * "vertex 0 x 0\n" + "endloop\nendsolid", "e.stl"),
            "not a valid STL",
        ),
        (write(tmp_path, "solid\nendsolid\n", "d.stl"), "no faces"),
        (write(tmp_path, CUBE, "rock.ply"), "no PLY header"),
        (Path("bad\0name.obj"), "cannot be read|no such file"),
    ]:
        with pytest.raises(GeometryError, match=message):
            load_mesh(path)


@pytest.mark.parametrize("suffix", ["stl", "ply"])
def test_a_number_that_is_cut_short_is_refused_and_not_read_in_part(
    tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A vertex ends in `e`, of which a reader of numbers would take what stands before."""
    box = trimesh.creation.box()
    if suffix == "stl":
        text = trimesh.exchange.stl.export_stl_ascii(box)
        cut = re.sub(r"(?m)^(.*vertex .*)$(?![\s\S]*vertex)", r"\1e", text)
    else:
        text = trimesh.exchange.ply.export_ply(box, encoding="ascii").decode()
        cut = re.sub(r"(end_header\n[^\n]*)", r"\1e", text)
    assert len(cut) == len(text) + 1
    assert len(load_mesh(write(tmp_path, text, f"whole.{suffix}")).mesh.faces) == 12
    path = write(tmp_path, cut, f"cut.{suffix}")
    with pytest.raises(GeometryError, match=f"not a valid {suffix.upper()}"):
        load_mesh(path)
    # numpy before 2.4 only warns of it, in words that are its own.
    load = trimesh.load_mesh

    def warning(*given: object, **options: object) -> object:
        warnings.warn("the rest was left out", DeprecationWarning, stacklevel=2)
        return load(*given, **options)

    monkeypatch.setattr(trimesh, "load_mesh", warning)
    with pytest.raises(GeometryError, match=f"not a valid {suffix.upper()} .the rest was left out"):
        load_mesh(write(tmp_path, text, f"warned.{suffix}"))


def test_sizes_are_bounded_before_memory_is_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "huge.obj"
    with path.open("wb") as file:
        file.truncate(mesh_files.MAX_FILE_BYTES + 1)  # sparse: takes no disk
    with pytest.raises(GeometryError, match="larger than 200000000 bytes; reduce it"):
        load_mesh(path)
    header = "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\n"
    header += "property float y\nproperty float z\nelement face 999999999999\n"
    header += "property list uchar int vertex_indices\nend_header\n"
    with pytest.raises(GeometryError, match="promises"):
        load_mesh(write(tmp_path, header, "huge.ply"))
    monkeypatch.setattr(mesh_files, "MAX_FACES", 10)
    with pytest.raises(GeometryError, match="million faces"):
        load_mesh(write(tmp_path, CUBE))


SEEDS = {
    "obj": CUBE.encode(),
    "stl": trimesh.creation.box().export(file_type="stl"),
    "ply": trimesh.creation.box().export(file_type="ply"),
    "ascii.ply": trimesh.exchange.ply.export_ply(trimesh.creation.box(), encoding="ascii"),
    "urdf": b"""<robot name="r"><link name="l"><inertial><origin xyz="0 0 0.1" rpy="0 0.1 0"/>
<mass value="10"/><inertia ixx="1" ixy="0.1" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
<collision><origin xyz="0 0 0"/><geometry><mesh filename="good.obj" scale="1 1 2"/></geometry>
</collision></link></robot>""",
}
FRAGMENTS = [b"nan", b"-", b"1e308", b"/", b"\n", b" ", b"\xff", b"0", b"9" * 25, b"f ", b"<", b'"']


@pytest.mark.parametrize("suffix", SEEDS)
@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_mutated_files_raise_nothing_but_our_errors(
    tmp_path: Path, suffix: str, data: st.DataObject
) -> None:
    content = bytearray(SEEDS[suffix])
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(content)))
        width = data.draw(st.sampled_from([0, 1, 4, 30]))
        piece = data.draw(st.sampled_from(FRAGMENTS) | st.binary(max_size=4))
        content[at : at + width] = piece
    path = tmp_path / f"mutant.{suffix}"
    path.write_bytes(bytes(content))
    (tmp_path / "good.obj").write_text(CUBE)
    repair = data.draw(st.booleans())
    message = str(tmp_path)
    try:
        if suffix == "urdf":
            load_urdf(path)
        else:
            loaded = load_mesh(path, repair=repair)
            assert np.isfinite(loaded.mesh.vertices).all()
    except Vsr2Error as error:
        message = str(error)
    assert str(tmp_path) in message


@needs_lab
def test_laboratory_meshes_are_closed_after_merging_and_read_fast() -> None:
    begin = time.process_time()
    loaded = load_mesh(LAB / "final_sp1_pca.obj")
    assert time.process_time() - begin < 1.0
    assert (len(loaded.mesh.vertices), len(loaded.mesh.faces)) == (5576, 11148)
    assert loaded.notes == ()
    (points,) = loaded.hull_points
    assert points.shape == (33444, 3)


def pybullet_hull(path: Path, scale: float) -> np.ndarray:
    pybullet = pytest.importorskip("pybullet")
    client = pybullet.connect(pybullet.DIRECT)
    try:
        shape = pybullet.createCollisionShape(
            pybullet.GEOM_MESH, fileName=str(path), meshScale=[scale] * 3, physicsClientId=client
        )
        body = pybullet.createMultiBody(1.0, shape, physicsClientId=client)
        return np.array(pybullet.getMeshData(body, physicsClientId=client)[1])
    finally:
        pybullet.disconnect(client)


def test_pybullet_reads_the_same_points(tmp_path: Path) -> None:
    """PyBullet's hull of a box has exactly our corners: single precision, then the scale."""
    path = tmp_path / "box.obj"
    path.write_text(trimesh.creation.box(extents=(0.2, 0.7, 1.1)).export(file_type="obj"))
    (points,) = load_mesh(path, scale=0.9).hull_points
    theirs = np.unique(pybullet_hull(path, 0.9), axis=0)
    # Rounding to single precision moves the corners by about 1e-9 m, so 1e-12 m tells it apart.
    np.testing.assert_allclose(theirs, np.unique(points, axis=0), rtol=0, atol=1e-12)
    assert np.abs(theirs[:, 0]).max() != 0.09


def test_pybullet_keeps_the_same_vertices_of_a_round_body(tmp_path: Path) -> None:
    vertices, faces = ball()
    path = write(tmp_path, as_obj(vertices * [0.7, 1.0, 1.3] + 0.1, faces))
    (points,) = load_mesh(path).hull_points
    hull = pybullet_hull(path, 1.0)
    nearest = np.linalg.norm(hull[:, None] - points[None], axis=2).min(axis=1)
    assert len(hull) == len(vertices)
    # Bullet computes hulls on a lattice of about 1e4 cells along the longest edge (1.3 m).
    assert nearest.max() < 2e-4
