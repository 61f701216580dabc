"""The shell commands of README and documentation do what the pages say, in their order."""

import re
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = runpy.run_path(str(ROOT / "scripts" / "docs_commands.py"))
PAGES = [page for page in SCRIPT["pages"]() if SCRIPT["script"](page, False)]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_commands_of_a_page_run_in_order(page, tmp_path):
    done = SCRIPT["run"](page, tmp_path)
    assert done.returncode == 0, done.stderr


def test_the_tutorial_shows_what_its_commands_print(tmp_path):
    [page] = [page for page in PAGES if page.name == "first_rock.md"]
    done = SCRIPT["run"](page, tmp_path)
    blocks = re.findall(r"^```(\w*)\n(.*?)^```$", page.read_text(), re.M | re.S)
    shown = [text for language, text in blocks if not language]
    assert len(shown) == 2
    printed = done.stdout.splitlines()
    for line in "".join(shown).splitlines():
        assert line in printed


def test_most_pages_have_commands_and_few_are_left_out():
    names = {page.name for page in PAGES}
    assert {"README.md", "first_rock.md", "calibrate.md", "campaign.md", "own_rock.md"} <= names
    lines = [line for page in SCRIPT["pages"]() for line in SCRIPT["script"](page, True)]
    assert len(lines) >= 30
    assert sum(line.startswith(("vsr2 diagnose", "vsr2 blind")) for line in lines) >= 6


def test_a_command_that_fails_fails_its_page(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        "```bash\nvsr2 config check missing.yaml   # no such file\nvsr2 --version\n```\n"
    )
    folder = tmp_path / "run"
    folder.mkdir()
    done = SCRIPT["run"](page, folder)
    assert done.returncode == 2
    assert "missing.yaml" in done.stderr
    assert "build_type" not in done.stdout


def test_files_that_a_page_tells_to_write_are_written(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        "Write this into `a.yaml`, here:\n\n```yaml\nname: a\n```\n\n`b.yaml` is not.\n"
    )
    assert SCRIPT["written_files"](page) == {"a.yaml": "name: a\n"}
