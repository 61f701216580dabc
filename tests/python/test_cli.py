"""The command line itself: usage errors, help, version, completion, logging."""

from __future__ import annotations

import logging
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from cyclopts import App, CycloptsError

import command_line
from vsr2 import Study
from vsr2.cli.main import app, main
from vsr2.diagnosis import Budget
from vsr2.diagnosis.budget import SCHEDULE
from vsr2.ensemble import Hypotheses, ProtocolCache
from vsr2.ensemble.execution import Progress, Stage, Turn
from vsr2.errors import BlindError, DiagnosisError
from vsr2.report.messages.progress_lines import STAGES, ProgressLines

STUDY = """
name: block
engine: {mode: fast}
rock: {shape: box, size: [0.25, 0.5, 1.0], density: 2700.0}
motion:
  mode: grid_cosine
  pga_g: {min: 0.2, max: 0.6, step: 0.4}
  pgv_pga_s: {min: 0.1, max: 0.1, step: 0.1}
"""


def verbs(room: App = app, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], App]]:
    """All verbs and the groups that hold them, with the words that call them."""
    for name in room:
        if not name.startswith("-"):
            verb = room[name]
            yield (*path, name), verb
            yield from verbs(verb, (*path, name))


VERBS = {" ".join(path): verb for path, verb in verbs()}


@pytest.fixture
def study(tmp_path: Path) -> Path:
    path = tmp_path / "study.yaml"
    path.write_text(STUDY)
    return path


def test_all_verbs_are_there() -> None:
    assert set(VERBS) == {
        *("new", "run", "view", "inertia", "calibrate", "fragility", "hazard", "diagnose"),
        *("motion", "motion info", "motion convert", "motion generate", "motion fuse"),
        "motion rotate",
        *("campaign", "campaign import-lab", "campaign check", "campaign info"),
        *(
            "campaign simulate",
            "campaign compare",
            "campaign causes",
            "campaign predict",
            "effects",
            "effects list",
            "effects show",
            "effects check",
        ),
        *("blind", "blind make", "blind diagnose", "blind score"),
        *("config", "config check", "config import-ros2", "config reference", "config schema"),
        "config time-step",
    }


@pytest.mark.parametrize("verb", VERBS)
def test_help_is_printed_and_explains_every_option(
    verb: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*verb.split(), "--help"]) == 0
    out = capsys.readouterr().out
    assert out.startswith(f"Usage: vsr2 {verb} ")
    if VERBS[verb].default_command is None:
        return  # a group: its verbs have the options
    with app.app_stack(verb.split()):
        for argument in VERBS[verb].assemble_argument_collection(parse_docstring=True):
            if argument.show:
                assert argument.parameter.help, f"{verb}: {argument.name} is not explained"
                assert argument.name in out
                assert not any(name.startswith("--no-") for name in argument.negatives)


def test_nothing_asked_for_prints_help_and_is_an_error(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 2
    assert "code 130: interrupted" in capsys.readouterr().out
    assert main(["campaign"]) == 2
    assert "simulate" in capsys.readouterr().out
    assert main(["--help"]) == 0


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("rum study.yaml", 'Did you mean "run"'),
        ("campaign simulte a --out b", 'Did you mean "simulate"'),
        ("--verson", "--verson is no option here; did you mean `--version`?"),
        ("run study.yaml --thread 2", "Did you mean --threads"),
        ("run study.yaml --overwrit", "Did you mean --overwrite"),
        ("run study.yaml --no-quiet", "Unknown option: --no-quiet"),
        ("run study.yaml --threads two", '"two" is no whole number'),
        ("run study.yaml --threads 2.6", '"2.6" is no whole number'),
        ("run study.yaml --merge --shard 1/2", "exclude each other; give one of them"),
        ("run study.yaml other.yaml", "other.yaml"),
        ("run", "STUDY is missing; give it"),
        ("inertia a.obj --mass 1 --density 2", "exclude each other; give one of them"),
        ("diagnose folder --out o", "--scene is missing; give it"),
        ("blind make a --out b --engine mujcoo", 'Did you mean "mujoco"'),
        ("blind make a --out b --single", "--single takes a value"),
        ("motion convert a --out b --filter 1 5", "--filter takes 3 values, not 2"),
        ("motion generate --out b --pga 3", "--pga-g is missing; did you mean it by --pga?"),
        (
            "motion generate --out b --pga-g 0.3 --duration 9 --pgv-pga 0.1",
            "--pgv-pga-s is missing; did you mean it by --pgv-pga?",
        ),
        ("run study.yaml --out", "--out takes a value"),
        ("run study.yaml --out b other.yaml", "other.yaml is too much"),
        ("run study.yaml --quiet=7", '"7" is no value that a switch takes'),
        ("inertia a.obj --density heavy", '"heavy" is no number'),
        ("blind make a --out b --single 1 2.5", '"1 2.5" is no whole number'),
        (
            "blind diagnose d --out o --campaigns 300 --budget-minutes 1",
            "exclude each other; give one of them",
        ),
        (
            "diagnose d --scene s --out o --budget-minutes 3 --budget-cpu-minutes 1",
            "exclude each other; give one of them",
        ),
        (
            "diagnose d --scene s --out o --budget-minutes 3 --campaigns 150",
            "exclude each other; give one of them",
        ),
        ("motion convert a --out b --units furlong", "Choose from"),
        ("motion info", "FILES is missing; give it"),
        ("config import-ros2", "FILES is missing; give it"),
    ],
)
def test_usage_errors_are_reported_in_two_lines_with_code_2(
    line: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(line.split()) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert message in err
    assert err.startswith("vsr2")
    assert err.endswith("--help` explains.\n")
    assert err.count("\n") == 2


def test_options_may_stand_anywhere_and_the_last_of_two_values_counts(
    study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    line = ["run", "--threads", "7", "--quiet", str(study), "--out", str(out), "--threads", "1"]
    changes = ["--set", "motion.pga_g.max=0.2", "--set=name=changed", "--no-figures"]
    assert main([*line, *changes]) == 0
    assert capsys.readouterr() == ("", "")
    assert '"threads": 1' in (out / "provenance.json").read_text()
    assert len((out / "trials.csv").read_text().splitlines()) == 2
    assert '"name": "changed"' in (out / "provenance.json").read_text()


def test_interruption_has_its_code(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted() -> str:
        raise KeyboardInterrupt

    monkeypatch.setattr("vsr2.config.reference_markdown", interrupted)
    assert main(["config", "reference"]) == 130
    assert capsys.readouterr().err == "vsr2: interrupted\n"


@pytest.mark.parametrize("verb", ["", "run", "campaign simulate", "motion info"])
def test_help_is_printed_where_output_is_ascii(verb: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "vsr2.cli.main", *verb.split(), "--help"],
        capture_output=True,
        env={**os.environ, "PYTHONIOENCODING": "ascii"},
    )
    assert done.returncode == 0, done.stderr
    assert "--verbose" in done.stdout.decode("ascii")


def test_a_reader_that_goes_away_is_no_error() -> None:
    command = f"{sys.executable} -m vsr2.cli.main config reference | head -1"
    shell = ["bash", "-c", f"{command}; exit ${{PIPESTATUS[0]}}"]
    done = subprocess.run(shell, capture_output=True, text=True)
    assert done.returncode == 0
    assert done.stderr == ""


def test_version_and_help_import_no_room() -> None:
    code = (
        "import sys; from vsr2.cli.main import main; main(sys.argv[1:]); "
        "print(*sorted(name for name in sys.modules if name.startswith('vsr2.')), file=sys.stderr);"
        "print(*sorted({'numpy', 'pydantic', 'yaml', 'tqdm'} & set(sys.modules)), file=sys.stderr)"
    )
    for option in ("--version", "--help"):
        done = subprocess.run(
            [sys.executable, "-c", code, option], capture_output=True, text=True, check=True
        )
        rooms, heavy = done.stderr.splitlines()
        assert heavy == ""
        imported = {name.split(".")[1] for name in rooms.split()}
        assert imported <= {"_native", "cli", "codes", "errors"}
        assert ("build_type" in done.stdout) is (option == "--version")
        if option == "--version":
            assert re.match(r"vsr2 [0-9.]+\S*\nbuild_type: ", done.stdout)


def test_the_version_needs_no_command_line() -> None:
    code = (
        "import sys; from vsr2.cli.entry import program; program(); "
        "print('cyclopts' in sys.modules, file=sys.stderr)"
    )
    for option, needed in (("--version", "False"), ("--help", "True")):
        done = subprocess.run(
            [sys.executable, "-c", code, option], capture_output=True, text=True, check=True
        )
        assert done.stderr.strip() == needed


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_knows_verbs_options_and_choices(
    shell: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--show-completion", shell]) == 0
    script = capsys.readouterr().out
    for word in ("import-ros2", "diagnose", "fuse", "scheduler", "mujoco", "verbose"):
        assert word in script
    if program := shutil.which(shell):
        file = tmp_path / "vsr2"
        file.write_text(script)
        subprocess.run([program, "-n", str(file)], check=True)


def test_completion_is_installed_in_the_home_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in [name for name in os.environ if name.startswith(("XDG_", "ZSH"))]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("HOME", str(tmp_path))
    assert main(["--install-completion", "bash"]) == 0
    (script,) = (path for path in tmp_path.rglob("vsr2*") if path.is_file())
    assert str(script) in capsys.readouterr().out
    assert str(script.parent) in (tmp_path / ".bashrc").read_text()
    assert "import-ros2" in script.read_text()


@pytest.mark.parametrize(
    ("options", "levels"),
    [
        ([], set()),
        (["-v"], {"info"}),
        (["-v", "-v"], {"info", "debug"}),
        (["-vv"], {"info", "debug"}),
    ],
)
@pytest.mark.parametrize("before", [True, False])
def test_verbosity_chooses_what_is_logged(
    options: list[str],
    levels: set[str],
    before: bool,
    study: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    line = ["run", str(study), "--out", str(tmp_path / "out"), "--quiet", "--no-figures"]
    assert main([*options, *line] if before else [*line, *options]) == 0
    out, err = capsys.readouterr()
    assert out == ""
    assert ("vsr2.simulation.batch: 2 trials, engine fast; 0 of them in the journal" in err) is (
        "info" in levels
    )
    assert (" s: 2 ok\n" in err) is ("info" in levels)
    assert ("vsr2.config.load: " in err) is ("debug" in levels)
    assert bool(err) is bool(levels)
    logger = logging.getLogger("vsr2")
    assert logger.handlers == []
    assert logger.level == logging.NOTSET


def test_no_figures_of_a_replaced_result_stay(study: Path, tmp_path: Path) -> None:
    line = ["run", str(study), "--out", str(tmp_path / "out"), "--quiet"]
    assert main(line) == 0
    figures = tmp_path / "out" / "figures"
    (figures / "mine.png").write_bytes(b"")
    assert len(list(figures.iterdir())) > 2
    assert main([*line, "--overwrite", "--no-figures"]) == 0
    assert [path.name for path in figures.iterdir()] == ["mine.png"]


def test_the_journal_taken_up_is_logged(
    study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    line = ["run", str(study), "--out", str(tmp_path / "out"), "--quiet", "--no-figures"]

    def killed(*arguments: object, **options: object) -> None:
        raise RuntimeError("killed")

    with monkeypatch.context() as patch:
        patch.setattr("vsr2.results.save_result", killed)
        with pytest.raises(RuntimeError, match="killed"):
            main(line)
    assert main(["-v", *line, "--resume"]) == 0
    assert "2 trials, engine fast; 2 of them in the journal" in caplog.text


def test_errors_of_usage_reach_callers_that_want_them() -> None:
    with pytest.raises(CycloptsError, match="no whole number"):
        command_line.run("run", "study.yaml", "--threads", "x")


def stub_campaign(folder: Path) -> SimpleNamespace:
    """What stands for a campaign that is handed on and not looked into."""
    campaign = SimpleNamespace(name=folder)
    campaign.on_file = lambda: campaign
    return campaign


def stub_scene(path: Path, settings: tuple[str, ...]) -> Study:
    """A study that states its time step."""
    motion = {"mode": "single_cosine", "pga_g": 0.4, "pgv_pga_s": 0.1}
    rock = {"shape": "box", "size": [0.2, 0.2, 0.6], "mass": 60.0}
    return Study.from_dict({"rock": rock, "motion": motion})


def test_diagnose_hands_budget_and_cache_on(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: dict[str, Any] = {}

    def stop(campaign: Path, scene: Path, **how: Any) -> None:
        asked.update(how)
        raise DiagnosisError("seen enough")

    monkeypatch.setattr("vsr2.diagnosis.diagnose", stop)
    monkeypatch.setattr("vsr2.campaign.load_campaign", stub_campaign)
    monkeypatch.setattr("vsr2.cli.options.scene", stub_scene)
    line = ["diagnose", "folder", "--scene", "s.yaml", "--out", str(tmp_path), "--campaigns", "300"]
    assert main([*line, "--cache", str(tmp_path / "shared")]) == 2
    assert "seen enough" in capsys.readouterr().err
    assert asked["budget"] == Budget(campaigns=300)
    assert asked["execution"].cache == ProtocolCache(tmp_path / "shared")
    assert main([*line[:-2], "--simulations", "9000"]) == 2
    assert asked["budget"] == Budget(simulations=9000)
    assert asked["execution"].cache is None
    assert main([*line, "--no-how-far"]) == 2
    assert asked["budget"] == Budget(campaigns=300, held_out=False)
    assert main([*line[:-2], "--budget-cpu-minutes", "3"]) == 2
    assert asked["budget"] == Budget(cpu_minutes=3.0)


DIAGNOSE = ("diagnose", "folder", "--scene", "s.yaml", "--out", "out")


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (
            ("campaign", "causes", "s.yaml", "folder", "--posterior-draws", "3"),
            "--posterior-draws: are written to a folder; add --out, or leave it out",
        ),
        (
            (*DIAGNOSE, "--most-rounds", "2"),
            "--most-rounds: only for rounds; add --iterate, or leave it out",
        ),
        (
            (*DIAGNOSE, "--most-rounds", "2", "--check", "100"),
            "--most-rounds: only for rounds; add --iterate, or leave it out",
        ),
        (
            (*DIAGNOSE, "--waterfall", "--no-how-far"),
            "--waterfall: does not go with --no-how-far; leave one of them out",
        ),
        (
            (*DIAGNOSE, "--check", "100", "--iterate"),
            "--check: does not go with --iterate; check the folder of one round, by --out",
        ),
        ((*DIAGNOSE, "--posterior-draws", "-2"), "posterior draws: -2; give 0 to 400"),
    ],
)
def test_an_option_without_use_is_refused_before_anything_is_read(
    line: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(list(line)) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("line", [("diagnose",), ("blind", "diagnose")])
def test_help_and_pages_say_how_many_campaigns_there_are_at_least(
    line: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    least = f"{SCHEDULE.fewest} at least"
    assert main([*line, "--help"]) == 0
    assert least in " ".join(capsys.readouterr().out.replace("│", " ").split())
    for page in ("how-to/diagnose.md", "reference/command_line.md"):
        text = (Path(__file__).parents[2] / "docs" / page).read_text(encoding="utf-8")
        [found] = [
            one for one in text.splitlines() if one.startswith(("- `--campaigns", "| `--campaigns"))
        ]
        assert least in found


def test_diagnose_hands_references_on(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    asked: list[Any] = []

    def stop(campaign: Path, scene: Path, *, hypotheses: Hypotheses, **how: Any) -> None:
        asked.extend(one.name for one in hypotheses.references)
        raise DiagnosisError("seen enough")

    monkeypatch.setattr("vsr2.diagnosis.diagnose", stop)
    monkeypatch.setattr("vsr2.campaign.load_campaign", stub_campaign)
    monkeypatch.setattr("vsr2.cli.options.scene", stub_scene)
    line = ["diagnose", "folder", "--scene", "s.yaml", "--out", str(tmp_path)]
    assert main([*line, "--reference", "one", "--reference", "other"]) == 2
    assert asked == [Path("one"), Path("other")]


@pytest.mark.parametrize(("given", "held_out"), [([], True), (["--no-how-far"], False)])
def test_blind_diagnose_hands_its_budget_on(
    monkeypatch: pytest.MonkeyPatch, given: list[str], held_out: bool
) -> None:
    asked: dict[str, Any] = {}

    def stop(data: Path, out: Path, **how: Any) -> None:
        asked.update(how)
        raise BlindError("seen enough")

    monkeypatch.setattr("vsr2.blind.diagnose_pack", stop)
    for minutes in ([], ["--budget-minutes", "2"], ["--budget-cpu-minutes", "2"]):
        assert main(["blind", "diagnose", "data", "--out", "out", *given, *minutes]) == 2
        assert asked["budget"].held_out is held_out


def test_progress_of_a_diagnosis_has_the_time_left(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = iter((100.0, 130.0, 131.0, 140.0, 140.1, 140.2))
    monkeypatch.setattr("time.monotonic", lambda: next(clock))
    say = ProgressLines()
    say(Progress(Stage.LOOK, 0.0))
    say(Progress(Stage.LOOK, 0.25))
    say(Progress(Stage.SIMULATION, 0.5, 300.0, {"wear": 0.6, "none": 0.1}))
    say(Progress(Stage.JUDGEMENT, 1.0))
    say = ProgressLines("blind diagnose")
    for number, name in ((2, "c1"), (3, "c2")):
        say(Progress(Stage.LOOK, 0.0, turn=Turn(number, 12, name, "M")))
    lines = [line.rstrip() for line in capsys.readouterr().err.splitlines()]
    assert lines == [
        "vsr2 diagnose: trying effects   0%",
        "vsr2 diagnose: trying effects  25%, 90 s left of this",
        "vsr2 diagnose: simulating  50%, 5 min left; leading: wear 0.60, none 0.10",
        "vsr2 diagnose: judging 100%",
        "vsr2 blind diagnose: c1 M (2 of 12): trying effects   0%",
        "vsr2 blind diagnose: c2 M (3 of 12): trying effects   0%",
    ]
    assert set(STAGES) == set(Stage)
