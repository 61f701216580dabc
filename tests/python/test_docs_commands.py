"""The shell commands of README and documentation do what the pages say, in their order."""

import re
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = runpy.run_path(str(ROOT / "scripts" / "docs_commands.py"))
PAGES = [page for page in SCRIPT["pages"]() if SCRIPT["script"](page, False)]


def shown(page: Path) -> list[str]:
    """Lines of which a page says that its commands print them, if these run as they stand."""
    commands = SCRIPT["script"](page, True)
    if any(re.match(start, one) for start in SCRIPT["SHORTER"] for one in commands):
        return []
    text = page.read_text()
    blocks = re.findall(r"^.*(?:print|summary).*\n\n```\n(.*?)^```$", text, re.M | re.S)
    return "".join(blocks).splitlines()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_commands_of_a_page_run_in_order_and_print_what_it_shows(page, tmp_path):
    done = SCRIPT["run"](page, tmp_path)
    assert done.returncode == 0, done.stderr
    printed = done.stdout.splitlines()
    for line in shown(page):
        assert line in printed


def test_pages_show_what_commands_print():
    assert {page.name for page in PAGES if shown(page)} == {"campaign.md", "first_rock.md"}


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
