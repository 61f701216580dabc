"""What the command line answers to what is done again or mistyped."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from vsr2.cli.main import main
from vsr2.ensemble import Hypotheses
from vsr2.errors import DiagnosisError
from vsr2.results import lost_logs

STUDY = """\
name: block
rock: {shape: box, size: [0.25, 0.5, 1.0], density: 2700.0}
motion: {mode: single_cosine, pga_g: 0.3, pgv_pga_s: 0.1}
output: {figures: false}
"""


@pytest.fixture
def study(tmp_path: Path) -> Path:
    path = tmp_path / "study.yaml"
    path.write_text(STUDY)
    return path


def run(*words: object) -> int:
    return main([str(word) for word in words])


def state(folder: Path) -> dict[Path, tuple[bytes, int]]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in files}


def test_resuming_a_finished_run_is_success_with_nothing_to_do(
    study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert run("run", study, "--out", out, "--quiet") == 0
    before = state(out)
    assert run("run", study, "--out", out, "--resume") == 0
    assert capsys.readouterr().out == (
        f"nothing to do: {out} holds the finished result of 1 trial\n"
    )
    assert state(out) == before
    assert run("run", study, "--out", out, "--resume", "--set", "motion.pga_g=0.2") == 2
    refused = capsys.readouterr().err
    assert "holds the finished result of another study" in refused
    for option in ("--overwrite", "--out"):
        assert f"`{option}`" in refused
    assert run("run", study, "--out", out) == 2
    assert "if it is of the same study, go on with `--resume`" in capsys.readouterr().err
    assert run("run", study, "--out", out, "--resume", "--overwrite") == 2
    assert "--overwrite and --resume exclude each other" in capsys.readouterr().err
    assert state(out) == before


def test_resuming_a_finished_campaign_leaves_its_files(
    study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "campaign"
    assert run("campaign", "simulate", study, "--out", out, "--quiet") == 0
    with (out / "campaign.yaml").open("a") as file:
        file.write("# a note of mine\n")
    before = state(out)
    assert run("campaign", "simulate", study, "--out", out, "--resume") == 0
    assert "nothing to do" in capsys.readouterr().out
    assert state(out) == before


GRID = (
    "motion.mode=grid_cosine",
    "motion.pga_g={min: 0.1, max: 0.2, step: 0.1}",
    "motion.pgv_pga_s={min: 0.1, max: 0.2, step: 0.1}",
    "output.npy=true",
)


def test_logs_that_a_finished_run_lost_are_made_again(
    study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    line = ("run", study, "--out", out, *(f"--set={one}" for one in GRID))
    assert run(*line, "--quiet") == 0
    logs = [out / "logs" / f"{trial:06d}.npz" for trial in range(4)]
    rows = [out / "npy" / f"{trial:06d}.npy" for trial in range(4)]
    files = [*logs, *rows, out / "trials.csv"]
    before = [file.read_bytes() for file in files]
    kept = logs[3].stat().st_mtime_ns
    logs[0].unlink()
    os.truncate(logs[1], 1000)
    flipped = bytearray(before[2])
    flipped[len(flipped) // 2] ^= 1
    logs[2].write_bytes(flipped)
    assert lost_logs(out, npy=True) == [0, 1, 2]
    assert run(*line, "--merge") == 2
    assert (
        f"{out}: the logs of 3 trials are gone or damaged, the first is that of trial 0; make them "
        "again by --resume in place of --merge"
    ) in capsys.readouterr().err
    assert run(*line, "--resume") == 0
    assert "nothing to do" not in capsys.readouterr().out
    assert [file.read_bytes() for file in files] == before
    assert logs[3].stat().st_mtime_ns == kept
    assert not (out / "journal.jsonl").exists()
    rows[3].unlink()
    assert lost_logs(out) == []
    assert run(*line, "--resume") == 0
    assert [file.read_bytes() for file in files] == before
    capsys.readouterr()
    assert run(*line, "--resume") == 0
    assert "nothing to do" in capsys.readouterr().out


def test_resuming_a_run_with_untrustworthy_trials_has_their_exit_code(
    study: Path, tmp_path: Path
) -> None:
    line = ("run", study, "--out", tmp_path / "out", "--quiet", "--set", "outcome.tail=0.001")
    assert [run(*line), run(*line, "--resume")] == [1, 1]


def test_merging_twice_is_success_with_nothing_to_do(
    study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert run("run", study, "--out", out, "--quiet", "--shard", "1/1") == 0
    assert run("run", study, "--out", out, "--quiet", "--merge") == 0
    before = state(out)
    assert run("run", study, "--out", out, "--merge") == 0
    assert "nothing to do" in capsys.readouterr().out
    assert state(out) == before


def test_resuming_a_finished_fragility_study(
    study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ("fragility", study, "--out", tmp_path / "out", "--no-figures", "--quiet")
    assert run(*line) == 0
    before = state(tmp_path / "out")
    assert run(*line, "--resume") == 0
    assert state(tmp_path / "out") == before
    # The same trials, another fit.
    assert run(*line, "--resume", "--set", "fragility.level=0.9") == 2
    assert "holds the finished result of another study" in capsys.readouterr().err


def test_a_result_is_distinguished_from_a_campaign(
    study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert run("run", study, "--out", out, "--quiet") == 0
    assert run("diagnose", out, "--scene", study, "--out", tmp_path / "d") == 2
    message = capsys.readouterr().err
    assert message == (
        f"vsr2: {out}: is a result of `vsr2 run` or `vsr2 fragility`, not a campaign; give a "
        "campaign's folder, or make one of the study by `vsr2 campaign simulate STUDY --out "
        "FOLDER`\n"
    )
    assert not (tmp_path / "d").exists()


@pytest.mark.parametrize(
    ("section", "verb"),
    [
        ("fragility: {replicates: 1}", "vsr2 fragility"),
        ("parameters: {}", "vsr2 calibrate"),
    ],
)
def test_a_study_of_another_verb_names_the_verb(
    section: str, verb: str, study: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study.write_text(f"{STUDY}{section}\n")
    assert run("run", study) == 2
    assert f"run the file by `{verb}`" in capsys.readouterr().err


@pytest.mark.parametrize(
    "line",
    ["run {}/studdy.yaml", "inertia {}/studdy.yaml", "motion info {}/studdy.yaml"],
)
def test_a_mistyped_file_gets_its_neighbour(
    line: str, study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(line.format(tmp_path).split()) == 2
    assert f"did you mean {study}?" in capsys.readouterr().err


def test_mistyped_folders_get_their_neighbour(
    study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "campaign").mkdir()
    for line in (("campaign", "info", tmp_path / "campagn"), ("view", tmp_path / "campagn")):
        assert run(*line) == 2
        assert f"did you mean {tmp_path / 'campaign'}?" in capsys.readouterr().err
    study.write_text(
        STUDY.replace("mode: single_cosine, pga_g: 0.3, pgv_pga_s: 0.1", "mode: single_recording, "
                      "file: study.yam")
    )  # fmt: skip
    assert run("run", study) == 2
    assert f"did you mean {study}?" in capsys.readouterr().err


def test_a_file_in_place_of_a_result_is_not_its_own_neighbour(
    study: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("view", study) == 2
    assert capsys.readouterr().err == (
        f"vsr2: {study}: is no folder; give the folder that `vsr2 run` named\n"
    )


def test_a_folder_without_a_campaign_says_which_folder_is_wanted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("campaign", "info", tmp_path) == 2
    assert capsys.readouterr().err == (
        f"vsr2: {tmp_path}: holds no campaign.yaml and no trials.csv; give a campaign's folder, "
        "as `vsr2 campaign simulate STUDY --out FOLDER` writes\n"
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("rock.density=-1", "rock.density: must be greater than 0 (is -1)"),
        ("rock.size=", "rock.size: must be a list such as [1.0, 2.0, 3.0] (is null)"),
        ("rok.density=1", "rok: is no key here; did you mean `rock`?"),
        ("engine.time_step=1", "engine.time_step: must be at most 0.02 (is 1)"),
    ],
)
def test_a_wrong_value_of_set_is_not_laid_to_the_file(
    change: str, message: str, study: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("run", study, "--set", change) == 2
    assert capsys.readouterr().err == f"vsr2: override '{change}': {message}\n"
    # What the file itself says wrongly keeps its line.
    study.write_text(STUDY.replace("2700.0", "-2700.0"))
    assert run("run", study, "--set", "seed=7") == 2
    assert "study.yaml:2: rock.density" in capsys.readouterr().err


def test_a_folder_in_place_of_a_file_is_not_said_to_be_missing(
    study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study.write_text(STUDY.replace("shape: box, size: [0.25, 0.5, 1.0]", "shape: mesh, file: ."))
    assert run("run", study) == 2
    assert f"rock.file: is no file ({tmp_path})" in capsys.readouterr().err


def test_a_tab_that_indents_is_named(study: Path, capsys: pytest.CaptureFixture[str]) -> None:
    study.write_text("name: block\n\trock: {}\n")
    assert run("run", study) == 2
    assert capsys.readouterr().err == (
        f"vsr2: {study}:2: not valid YAML: a tab stands where blanks indent; use blanks\n"
    )


def test_an_effect_that_an_engine_lacks_gets_its_neighbour(
    study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ("blind", "make", study, "--out", tmp_path / "pack", "--engine", "bullet")
    assert run(*line, "--effect", "fricton") == 2
    assert "has no effect 'fricton'; did you mean `friction`" in capsys.readouterr().err


def test_names_of_a_diagnosis_get_their_neighbour(
    study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    campaign = tmp_path / "known"
    assert run("campaign", "simulate", study, "--out", campaign, "--quiet") == 0
    line = ("diagnose", campaign, "--scene", study, "--out", tmp_path / "d")
    assert run(*line, "--nuisance", "fricton=0.1") == 2
    assert "give NAME=SD with a number of 0 or more; did you mean friction?" in (
        capsys.readouterr().err
    )
    with pytest.raises(DiagnosisError, match="no effect 'fricton'; did you mean `friction`"):
        print(Hypotheses(exclude=["fricton"]).offered)


def test_a_campaign_of_set_is_relative_to_the_working_folder(
    study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    rest = "\n".join(line for line in STUDY.splitlines() if not line.startswith("motion"))
    study.write_text(
        f"{rest}\ncampaign: known\nmethod: {{kind: joint}}\n"
        "parameters: {yaw: {keys: [rock.start.yaw], range: [0.0, 60.0]}}\n"
    )
    (tmp_path / "work" / "here").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "work")
    assert run("config", "check", study) == 2
    assert f"no such folder ({tmp_path / 'known'})" in capsys.readouterr().err
    assert run("calibrate", study, "--set", "campaign=here", "--out", "out") == 2
    assert f"{tmp_path / 'work' / 'here'}: holds no campaign.yaml" in capsys.readouterr().err


def test_files_that_are_written_get_their_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target = tmp_path / "new" / "folder" / "made.csv"
    wish = ("--pga-g", 0.3, "--pgv-pga-s", 0.1, "--duration", 5)
    line = ("motion", "generate", *wish, "--out", target)
    assert run(*line) == 0
    assert target.exists()
    (tmp_path / "file").touch()
    assert run(*line[:-1], tmp_path / "file" / "made.csv") == 2
    assert "its folder cannot be made" in capsys.readouterr().err


@pytest.mark.parametrize("empty", [["--out", ""], ["--out="], ["--out", " "], ["--set", ""]])
def test_an_empty_argument_is_refused(
    empty: list[str], study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    assert run("run", study, *empty) == 2
    assert "an argument is empty" in capsys.readouterr().err
    assert list(folder.iterdir()) == []


def test_a_working_folder_that_is_gone_stops_nothing_that_has_absolute_paths(
    study: Path, tmp_path: Path
) -> None:
    gone = tmp_path / "gone"
    code = textwrap.dedent(
        f"""
        import os, sys
        os.mkdir({str(gone)!r}); os.chdir({str(gone)!r}); os.rmdir({str(gone)!r})
        from vsr2.cli.main import main
        line = ["run", {str(study)!r}, "--out", {str(tmp_path / "out")!r}, "--quiet"]
        sys.exit(10 * main([*line, "--set", "motion.pga_g=0.2"]) + main(["run", "study.yaml"]))
        """
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 2, done.stderr
    assert done.stderr.count("\n") == 1
    assert (tmp_path / "out" / "trials.csv").exists()


def test_a_dry_run_says_what_would_run_and_writes_nothing(
    study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    line = ("run", study, "--out", out, "--threads", 2, "--dry-run")
    assert run(*line, "--set", "output.log_every=10") == 0
    first, time_line, size_line = capsys.readouterr().out.splitlines()
    assert first.startswith("block: 1 trial, box")
    assert time_line.startswith("would run 1 trial of 0.629 s of motion")
    assert " in 1 thread: about " in time_line
    assert size_line.endswith(f"of logs into {out}")
    assert not out.exists()
    assert run(*line, "--set", "output.log_every=0") == 0
    assert "at most 0 MB of logs" in capsys.readouterr().out
    assert run(*line, "--merge") == 2


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("motion", "{mode: single_recording, file: record.csv}"), "record.csv"),
        (("rock", "{shape: mesh, file: scan.obj, density: 2700.0}"), "scan.obj"),
    ],
)
def test_config_check_reads_the_files_that_a_study_names(
    change: tuple[str, str], message: str, study: Path, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    (tmp_path / "record.csv").write_text("no record\n")
    (tmp_path / "scan.obj").write_text("v 0 0 0\n")
    key, value = change
    lines = [f"{key}: {value}" if line.startswith(key) else line for line in STUDY.splitlines()]
    study.write_text("\n".join(lines))
    assert run("config", "check", study) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert message in err


def test_config_check_reads_a_calibrations_campaign(
    study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "known").mkdir()
    rest = "\n".join(line for line in STUDY.splitlines() if not line.startswith("motion"))
    study.write_text(
        f"{rest}\ncampaign: known\nmethod: {{kind: joint}}\n"
        "parameters: {yaw: {keys: [rock.start.yaw], range: [0.0, 60.0]}}\n"
    )
    assert run("config", "check", study) == 2
    assert "known: holds no campaign.yaml and no trials.csv" in capsys.readouterr().err


@pytest.mark.parametrize("missing", [True, False])
def test_config_check_names_all_files_that_are_missing_or_damaged(
    missing: bool, study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if not missing:
        (tmp_path / "records").mkdir()
        (tmp_path / "records" / "one.csv").write_text("no record\n")
    for name in ("scan.obj", "ground.obj"):
        (tmp_path / name).write_text("v 0 0 0\n")
    change = {
        "motion": "{mode: all_recordings, folder: records}",
        "rock": "{shape: mesh, file: scan.obj, density: 2700.0}",
        "pedestal": "{shape: mesh, file: ground.obj}",
    }
    lines = [line for line in STUDY.splitlines() if line.split(":")[0] not in change]
    study.write_text("\n".join([*lines, *(f"{key}: {change[key]}" for key in change)]))
    assert run("config", "check", study) == 2
    out, err = capsys.readouterr()
    assert out == ""
    words = ("no such folder" if missing else "one.csv", "scan.obj", "ground.obj")
    said = [[word for word in words if word in line] for line in err.splitlines()]
    assert sorted(said) == sorted([word] for word in words)


def test_config_check_takes_a_fragility_study(
    study: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study.write_text(f"{STUDY}fragility: {{replicates: 1}}\n")
    assert run("config", "check", study) == 0
    printed = capsys.readouterr().out
    assert "replicates: 1" in printed
    study.write_text(printed)
    assert run("config", "check", study) == 0
    assert capsys.readouterr().out == printed
