"""Campaigns on disk: written and read back alike; faults named by file, row and column."""

import datetime
import io
import os
import re
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from campaign_samples import assert_equal, campaign
from vsr2.campaign import SCHEMA, Specimen, check_campaign, load_campaign, save_campaign
from vsr2.errors import CampaignError, Vsr2Error

ROWS = [
    "trial,motion,motion_file,session,order,specimen,overturned,peak_tilt_rad,date,x_peer",
    "A1,pulse,pulse,1,1,block,0,0.01,2021-06-21,1",
    "A2,pulse,pulse,1,2,block,1,,,",
    "B,other,,2,7,block,,,,0",
]

YAML = f"schema: {SCHEMA}\nname: sample\nspecimens:\n  block: {{mass_kg: 100}}\n"


@pytest.fixture
def folder(tmp_path):
    """A sound campaign, written by hand."""
    path = tmp_path / "campaign"
    (path / "motions").mkdir(parents=True)
    (path / "series").mkdir()
    write_rows(path, ROWS)
    (path / "campaign.yaml").write_text(YAML)
    np.savez(
        path / "motions" / "pulse.npz",
        sample_interval_s=0.01,
        displacement_m=np.sin(np.arange(40.0)).astype("<f4"),
    )
    np.savez(path / "series" / "A1.npz", time_s=np.arange(5.0), tilt_rad=np.zeros(5))
    return path


def write_rows(folder, rows):
    (folder / "trials.csv").write_text("\n".join(rows) + "\n")


def problem(folder):
    """The only problem, as text; loading refuses with the same words."""
    found = check_campaign(folder)
    assert len(found) == 1, [str(one) for one in found]
    with pytest.raises(CampaignError) as error:
        load_campaign(folder)
    assert str(found[0]) in str(error.value)
    assert str(folder) in str(error.value)
    return str(found[0])


def test_what_is_written_by_hand_is_read(folder):
    assert check_campaign(folder) == []
    read = load_campaign(folder)
    assert [t.overturned for t in read.trials] == [False, True, None]
    assert [t.motion_file for t in read.trials] == ["pulse", "pulse", None]
    assert [t.peak_tilt for t in read.trials] == [0.01, None, None]
    assert read.trials[0].date == datetime.date(2021, 6, 21)
    assert read.extra("x_peer").tolist()[::2] == [1.0, 0.0]
    assert read.trials[0].series.tilt.tolist() == [0.0] * 5
    assert read.trials[1].series is None
    assert read.specimens["block"].mass == 100.0
    assert read.motions["pulse"].displacement[1] == np.float32(np.sin(1.0))


def test_records_may_stay_in_their_files(folder):
    read = load_campaign(folder)
    kept = read.on_file()
    assert kept.trials == read.trials
    held, record = kept.motions["pulse"], read.motions["pulse"]
    assert not [one for one in vars(held).values() if isinstance(one, np.ndarray)]
    np.testing.assert_array_equal(held.displacement, record.displacement)
    assert (held.label, held.sha256) == (record.label, record.sha256)


def test_without_the_column_motion_file_the_motion_names_it(folder):
    write_rows(folder, ["trial,motion,session,order,specimen,overturned", "A1,pulse,1,1,block,0"])
    assert load_campaign(folder).trials[0].motion_file == "pulse"
    write_rows(folder, ["trial,motion,session,order,specimen,overturned", "A1,a b,1,1,block,0"])
    found = [str(one) for one in check_campaign(folder)]
    assert any("trials.csv: row 2, column motion: 'a b' is no id" in one for one in found)
    assert "name the files in a column `motion_file`" in found[0]


@pytest.mark.parametrize(
    ("row", "old", "new", "words"),
    [
        (1, "A1", "A/1", "row 2, column trial: 'A/1' is no id"),
        (2, "A2", "a1", "row 3, column trial: 'a1' is there twice (as 'A1' in row 2)"),
        (1, "pulse,pulse", ",pulse", "row 2, column motion: is blank"),
        (1, ",1,1,", ",,1,", "row 2, column session: is blank"),
        (3, ",7,", ",2,", "row 4, column order: 2 is there twice (first in row 3)"),
        (3, ",7,", ",7.5,", "row 4, column order: '7.5' is no whole number"),
        (3, ",7,", ",-7,", "row 4, column order: '-7' is no whole number from 0"),
        (3, ",7,", "," + "9" * 400 + ",", "row 4, column order: "),
        (1, ",block,", ",blok,", "row 2, column specimen: 'blok' is no specimen of campaign.yaml"),
        (1, "block,0", "block,yes", "row 2, column overturned: 'yes' is not 0, 1 or blank"),
        (1, "block,0", "block,1.0", "row 2, column overturned: '1.0' is not 0, 1 or blank"),
        (1, "0.01", "nan", "row 2, column peak_tilt_rad: 'nan' is no number"),
        (1, "0.01", "57.3", "row 2, column peak_tilt_rad: is 57.3, must lie from 0 to 3.14159 rad"),
        (1, "0.01", "1e999", "row 2, column peak_tilt_rad: is inf"),
        (1, "0.01", "1_0", "row 2, column peak_tilt_rad: '1_0' is no number"),
        (1, "2021-06-21", "20210621", "row 2, column date: '20210621' is no date"),
        (1, "2021-06-21", "2021-13-21", "row 2, column date: '2021-13-21' is no date"),
        (1, "21,1", "21,one", "row 2, column x_peer: 'one' is no number; leave the cell blank"),
        (1, "21,1", "21,1,5", "row 2: has 11 cells, the header 10"),
        (0, "x_peer", "peer", "row 1, column peer: is no column of the form; if it holds numbers"),
        (0, "x_peer", "x_", "row 1, column x_: 'x_' is no name of an extra column"),
        (0, "x_peer", "date", "row 1, column date: is there twice"),
        (0, "x_peer", "", "row 1: column 10 has the name ''"),
        (0, "overturned", "note", "row 1, column overturned: is missing"),
    ],
)
def test_a_slip_in_the_table_is_named(folder, row, old, new, words):
    rows = list(ROWS)
    assert rows[row].count(old) == 1 or row == 1
    rows[row] = rows[row].replace(old, new, 1)
    write_rows(folder, rows)
    found = [str(one) for one in check_campaign(folder)]
    assert len(found) == 1, found
    assert found[0].startswith("trials.csv: ")
    assert words in found[0]
    with pytest.raises(CampaignError, match="trials"):
        load_campaign(folder)


def test_several_problems_are_listed_together(folder):
    rows = list(ROWS)
    rows[1] = rows[1].replace("block,0", "block,maybe")
    rows[3] = rows[3].replace("block", "rock")
    write_rows(folder, rows)
    (folder / "motions" / "pulse.npz").unlink()
    found = check_campaign(folder)
    assert {(one.file, one.row, one.column) for one in found} == {
        ("trials.csv", 2, "overturned"),
        ("trials.csv", 4, "specimen"),
        ("motions/pulse.npz", None, ""),
    }
    with pytest.raises(CampaignError, match="3 problems"):
        load_campaign(folder)


def test_a_slip_in_every_row_is_counted_not_listed(folder):
    write_rows(folder, [ROWS[0], *[f"A{i},p,,1,{i},block,no,,," for i in range(1, 500)]])
    found = check_campaign(folder)
    assert len(found) == 201
    assert "299 more problems" in str(found[-1])
    with pytest.raises(CampaignError, match=r"\.\.\. and 181 more"):
        load_campaign(folder)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "trials.csv: is empty"),
        (b"\xff\xfe", "trials.csv: row 1: byte 0xff is not UTF-8"),
        (ROWS[0].encode(), "trials.csv: has a header and no rows"),
        (ROWS[0].encode() + b'\n"A', "trials.csv: row 2: not a table in CSV"),
    ],
)
def test_a_table_that_is_none_is_named(folder, content, words):
    (folder / "trials.csv").write_bytes(content)
    assert words in problem(folder)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("campaign/1", "campaign/2", "row 1, key schema: is 'vsr2.campaign/2'; this reader knows"),
        ("name: sample", "nam: sample", "nam"),
        ("name: sample", "name: ''", "row 2, key name: is blank"),
        ("name: sample", "name: 7", "row 2, key name: must be text; put it in quotes (is 7)"),
        (
            "mass_kg: 100",
            "mass_kg: 0",
            "row 4, key specimens.block.mass_kg: must be greater than 0",
        ),
        ("mass_kg: 100", "mass_kg: .nan", "row 4, key specimens.block.mass_kg: must be finite"),
        (
            "mass_kg: 100",
            "mass_kg: heavy",
            "mass_kg: must be a number, without quotes (is 'heavy')",
        ),
        (
            "mass_kg: 100",
            "mass: 100",
            "specimens.block.mass: is no key here; did you mean `mass_kg`?",
        ),
        ("mass_kg: 100", "model_file: ../a.obj", "leads out of the campaign's folder"),
        ("mass_kg: 100", "model_file: /a.obj", "leads out of the campaign's folder"),
        ("mass_kg: 100", "model_file: a.dae", "is none of .obj, .stl, .ply"),
        ("mass_kg: 100", "model_file: a.obj", "no such file ('a.obj')"),
        ("  block: {mass_kg: 100}", "  {}", "row 3, key specimens: must hold at least 1"),
        ("specimens:", "provenance: 3\nspecimens:", "key provenance: must be a mapping of names"),
        ("block:", "bl ock:", "row 4, key specimens.bl ock: 'bl ock' is no id"),
        ("{mass_kg: 100}", "12", "specimens.block: must hold the keys description, mass_kg, mo"),
        ("specimens:", "units: feet\nspecimens:", "key units: must be SI (is 'feet')"),
        (
            "specimens:",
            "noise: {tilt: 1}\nspecimens:",
            "noise.tilt: is no key here; did you mean `tilt_rad`?",
        ),
        (
            "specimens:",
            "noise: {max_tilt_rad: 0.001}\nspecimens:",
            "noise.max_tilt_rad: is no key here; did you mean `peak_tilt_rad`?",
        ),
        (
            "specimens:",
            "noise: {til_trad: 0.001}\nspecimens:",
            "noise.til_trad: is no key here; did you mean `tilt_rad`?",
        ),
        (
            "specimens:",
            "noise: {tilt_rad: -1}\nspecimens:",
            "noise.tilt_rad: must be at least 0 (is -1)",
        ),
        ("specimens:", "noise: 3\nspecimens:", "key noise: must hold the keys displacement_m"),
        (
            "specimens:",
            "sampling: {motion_interval_s: 0.005}\nspecimens:",
            "motions/pulse.npz: array sample_interval_s: is 0.01 s, campaign.yaml states 0.005 s",
        ),
        (
            "specimens:",
            "sampling: {series_interval_s: 0.5}\nspecimens:",
            "series/A1.npz: array time_s: the rows 0 and 1 are 1 s apart",
        ),
        ("name: sample", "name: [", "campaign.yaml: row 4: not valid YAML"),
        (YAML, "", "campaign.yaml: the file is empty"),
    ],
)
def test_a_slip_in_the_description_is_named(folder, old, new, words):
    assert YAML.count(old) == 1
    (folder / "campaign.yaml").write_text(YAML.replace(old, new))
    found = [str(one) for one in check_campaign(folder)]
    assert any(words in one for one in found), found
    assert "campaign.yaml" in "".join(found)
    with pytest.raises(CampaignError):
        load_campaign(folder)


def npz(**arrays):
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def npz_claiming(shape, descr="'<f8'"):
    """An archive whose displacement claims `shape` and holds one number."""
    header = f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        member = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + b"\0" * 8
        # Names of tests hold the content, and would else hold the time.
        for name in ("displacement_m.npy", "sample_interval_s.npy"):
            archive.writestr(zipfile.ZipInfo(name), member)
    return stream.getvalue()


WAVE = np.sin(np.arange(40.0))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "no sound .npz file"),
        (b"PK\x03\x04 nothing", "no sound .npz file"),
        (npz(displacement_m=WAVE), "array sample_interval_s: is missing"),
        (npz(sample_interval_s=0.01), "neither displacement nor acceleration"),
        (npz(sample_interval_s=0.01, displacement_volt=WAVE), "holds 'displacement_volt', which"),
        (npz(sample_interval_s=0.0, displacement_m=WAVE), "sampling interval 0 s lies outside"),
        (npz(sample_interval_s=np.nan, displacement_m=WAVE), "not one finite number"),
        (npz(sample_interval_s=[0.1, 0.1], displacement_m=WAVE), "not one finite number"),
        (npz(sample_interval_s=0.01, displacement_m=WAVE[:5]), "16 to"),
        (npz(sample_interval_s=0.01, displacement_m=WAVE * np.nan), "displacement is nan m at"),
        (npz(sample_interval_s=0.01, displacement_m=WAVE * 1e6), "check the unit"),
        (npz(sample_interval_s=0.01, displacement_m=np.array(["a"] * 40)), "not real numbers"),
        (npz(sample_interval_s=0.01, displacement_m=WAVE * 1j), "not real numbers"),
        (npz(sample_interval_s=0.01, displacement_m=WAVE > 0), "not real numbers"),
        (npz_claiming("(1000000000000,)"), "at most 2 dimension"),
        (npz_claiming("(40,)"), "has 8 bytes where its shape needs 320"),
        (npz_claiming("()", "'|O'"), "not real numbers"),
    ],
)
def test_a_motion_that_cannot_be_used_is_named(folder, content, words):
    (folder / "motions" / "pulse.npz").write_bytes(content)
    found = problem(folder)
    assert found.startswith("motions/pulse.npz: ")
    assert words in found


def test_pickled_arrays_are_refused_unopened(folder, tmp_path):
    class Bomb:
        def __reduce__(self):
            return (os.mkdir, (str(tmp_path / "exploded"),))

    stream = io.BytesIO()
    np.savez(stream, sample_interval_s=0.01, displacement_m=np.array([Bomb()] * 40, dtype=object))
    (folder / "motions" / "pulse.npz").write_bytes(stream.getvalue())
    assert "array displacement_m: holds 'object', not real numbers" in problem(folder)
    assert not (tmp_path / "exploded").exists()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (npz(tilt_rad=np.zeros(3)), "array time_s: is missing"),
        (npz(time_s=np.arange(3.0)), "neither tilt nor position, orientation, yaw or slip"),
        (npz(time_s=np.zeros(3), tilt_rad=np.zeros(3)), "must increase"),
        (npz(time_s=np.arange(3.0), position_m=np.zeros(3)), "wanted is (3, 3)"),
        (
            npz(time_s=np.arange(3.0), tilt_rad=np.zeros(3), noise_tilt_rad=[1.0, 2.0]),
            "array noise_tilt_rad: is not one finite number",
        ),
        (npz(time_s=np.arange(3.0), tilt_rad=[0, np.inf, 0]), "tilt is inf rad at row 1"),
    ],
)
def test_a_series_that_cannot_be_used_is_named(folder, content, words):
    (folder / "series" / "A1.npz").write_bytes(content)
    found = problem(folder)
    assert found.startswith("series/A1.npz: ")
    assert words in found


def test_missing_and_unclaimed_files_are_named(folder):
    (folder / "series" / "A1.npz").rename(folder / "series" / "A7.npz")
    assert problem(folder) == (
        "series/A7.npz: belongs to no trial of trials.csv; rename or remove it"
    )
    (folder / "series" / "A7.npz").unlink()
    (folder / "motions" / "pulse.npz").unlink()
    assert problem(folder).startswith("motions/pulse.npz: named in trials.csv, row 2: no such file")
    os.mkfifo(folder / "motions" / "pulse.npz")
    assert "not a file" in problem(folder)
    assert "no such folder" in problem(folder / "nowhere")
    assert "no such folder" in str(check_campaign("\0")[0])


@settings(max_examples=150, deadline=None)
@given(
    name=st.sampled_from(["campaign.yaml", "trials.csv", "motions/pulse.npz", "series/A1.npz"]),
    content=st.binary(max_size=200)
    | st.text(max_size=200).map(lambda text: text.encode("utf-8", "surrogatepass"))
    | st.lists(st.sampled_from([*"\n,\"';:{}[]-", *ROWS, YAML, "A1", "1e999", "\0"])).map(
        lambda parts: "".join(parts).encode()
    ),
)
def test_any_bytes_end_in_a_campaign_or_in_problems(tmp_path_factory, name, content):
    path = tmp_path_factory.mktemp("fuzz") / "c"
    _sound(path)
    (path / name).write_bytes(content)
    problems = check_campaign(path)
    if problems:
        with pytest.raises(Vsr2Error, match=re.escape(str(path))):
            load_campaign(path)
    else:
        load_campaign(path)


def _sound(path):
    (path / "motions").mkdir(parents=True)
    (path / "series").mkdir()
    write_rows(path, ROWS)
    (path / "campaign.yaml").write_text(YAML)
    (path / "motions" / "pulse.npz").write_bytes(npz(sample_interval_s=0.01, displacement_m=WAVE))
    (path / "series" / "A1.npz").write_bytes(npz(time_s=np.arange(5.0), tilt_rad=np.zeros(5)))


def test_the_page_on_the_form_names_every_column_array_and_key():
    from vsr2.campaign import array_files, description, trials_table

    page = (Path(__file__).parents[2] / "docs" / "reference" / "campaign.md").read_text()
    for name in (
        *trials_table._COLUMNS.values(),
        *array_files._MOTION_ARRAYS,
        *array_files._SERIES_ARRAYS,
    ):
        assert f"| `{name}` |" in page
    sections = [
        description._Content,
        description._Noise,
        description._Sampling,
        description._Specimen,
    ]
    for key in ("schema", *(key for section in sections for key in section.model_fields)):
        assert f"{key}:" in page


def test_the_pages_example_is_read(tmp_path):
    page = (Path(__file__).parents[2] / "docs" / "reference" / "campaign.md").read_text()
    example = page.split("```yaml\n")[1].split("```")[0]
    path = tmp_path / "c"
    _sound(path)
    write_rows(path, [ROWS[0], "A1,pulse,,1,1,SP1,0,,,"])
    (path / "models").mkdir()
    (path / "models" / "SP1.obj").write_text("v 0 0 0\n")
    np.savez(path / "series" / "A1.npz", time_s=np.arange(5) * 0.01, tilt_rad=np.zeros(5))
    (path / "campaign.yaml").write_text(example)
    read = load_campaign(path)
    assert read.name == "quarry-2024"
    assert read.noise.position == 0.0005
    assert read.specimens["SP2"] == Specimen()


def test_a_model_that_cannot_be_read_is_named(folder, tmp_path):
    model = tmp_path / "block.obj"
    model.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    made = campaign(specimens={"block": Specimen("granite", 120.5, model), "rock": Specimen()})
    target = tmp_path / "with-model"
    save_campaign(made, target)
    assert check_campaign(target) == []
    (target / "models" / "block.obj").write_text("v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n")
    (found,) = check_campaign(target)
    assert found.file == "models/block.obj"
    assert "not finite" in str(found)
    load_campaign(target)


@pytest.mark.parametrize(
    ("name", "meant"),
    [("max_tilt_rad", "peak_tilt_rad"), ("pga_ms2", "pga_g"), ("peak_tilt_deg", "peak_tilt_rad"),
     ("pgv_pga", "pgv_pga_s"), ("slip_m", "final_slip_m"), ("sesion_", "session"),
     ("notes", "note"), ("overturn", "overturned"), ("toppled", "overturned")],
)  # fmt: skip
def test_a_column_of_another_name_is_distinguished_from_the_form_s_own(folder, name, meant):
    path = folder / "trials.csv"
    head, rest = path.read_text().split("\n", 1)
    path.write_text(f"{head},{name}\n" + rest.replace("\n", ",\n"))
    assert f"column {name}: is no column of the form; did you mean {meant}?" in problem(folder)


@pytest.mark.parametrize(
    ("name", "remedy"),
    [("pga_m_s2", "divide it by 9.80665 and call it"), ("pgv", "divide it [m/s] by PGA"),
     ("pgv_m_s", "divide it [m/s] by PGA")],
)  # fmt: skip
def test_a_column_in_another_unit_is_not_merely_renamed(folder, name, remedy):
    path = folder / "trials.csv"
    head, rest = path.read_text().split("\n", 1)
    path.write_text(f"{head},{name}\n" + rest.replace("\n", ",\n"))
    assert f"column {name}: is no column of the form; {remedy}" in problem(folder)


def test_campaigns_share_motions(tmp_path):
    one, two = campaign(name="one"), campaign(name="two")
    for each in (one, two):
        save_campaign(each, tmp_path / each.name, motions="../motions")
        assert not (tmp_path / each.name / "motions").exists()
    assert [path.name for path in (tmp_path / "motions").iterdir()] == ["pulse.npz"]
    assert_equal(load_campaign(tmp_path / "two"), two)
    (tmp_path / "motions" / "pulse.npz").unlink()
    assert problem(tmp_path / "two").startswith("../motions/pulse.npz: named in trials.csv, row 2")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("name: two", "name: 12e345678", "row 2, key name: must be text; put it in quotes"),
        ("block:", "12e345678:", "row 6: a key must be text; put it in quotes"),
        ("name: two", "name: two\nid: 12e345678", "row 3, key id: is no key here"),
        ("motions:", "motion:", "row 13, key motion: is no key here; did you mean `motions`?"),
        ("../motions", "12e345", "row 13, key motions: must be text"),
        ("campaign/1", "campaign/2", "row 1, key schema: is 'vsr2.campaign/2'"),
        ("name: two", "name: [", "row 4: not valid YAML"),
    ],
)
def test_one_wrong_key_is_one_problem(old, new, words, tmp_path):
    save_campaign(campaign(name="two"), tmp_path / "two", motions="../motions")
    file = tmp_path / "two" / "campaign.yaml"
    file.write_text(file.read_text().replace(old, new, 1))
    assert problem(tmp_path / "two").startswith(f"campaign.yaml: {words}")


def test_motion_files_are_judged_beside_a_wrong_key(tmp_path):
    for name, place in (("one", ""), ("two", "../motions")):
        save_campaign(campaign(name=name), tmp_path / name, motions=place)
        file = tmp_path / name / "campaign.yaml"
        file.write_text(file.read_text().replace(f"name: {name}", "name: 7"))
    (tmp_path / "one" / "motions" / "pulse.npz").write_bytes(b"")
    (tmp_path / "motions" / "pulse.npz").write_bytes(b"")
    for name, place in (("one", ""), ("two", "../")):
        files = [one.file for one in check_campaign(tmp_path / name)]
        assert files == ["campaign.yaml", f"{place}motions/pulse.npz"]


@pytest.mark.parametrize("path", ["/tmp", "../../motions", "..", "motions", "../a/b"])
def test_motions_of_several_campaigns_lie_beside_the_campaign(folder, path):
    file = folder / "campaign.yaml"
    file.write_text(file.read_text() + f"\nmotions: {path}\n")
    assert "is no folder beside the campaign's" in problem(folder)
