#!/usr/bin/env python3
"""Run the shell commands of README and documentation, page by page, as a reader would.

    python scripts/docs_commands.py [--long] [PAGE ...]     (default: all pages with commands)

Every page starts in a folder of its own with the embedded data and the files that the page tells to
write, and all blocks of shell of the page run there in order, with `set -e`. Left out are commands
that need what is not here (APART), those that take minutes unless --long is given (LONG), and
servers. Searches are made short by options (SHORTER).
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("README.md", "docs/tutorial", "docs/how-to", "docs/explanation", "docs/reference")
EMBEDDED = ("configs", "models", "docs/examples", "tests/fuzz/corpus")

APART = {
    r"\./scripts/": "installs system packages, or builds",
    r"(\.venv/bin/)?(python3?|PYTHON) -m (venv|build|pip)": "installs or builds",
    r"\. \.venv|pip install|podman|cmake|clean/bin": "installs or builds",
    r"(PATH=\S+ )?auditwheel": "installs or builds",
    r"srun|sbatch|dask|job=|vsr2 .*--scheduler": "needs a cluster",
    r"vsr2 --install-completion": "changes the reader's shell",
    r"vsr2 view ": "serves until Ctrl-C",
    r".*\b(SOURCE|out/my-campaign|table\.csv|study\.yaml)\b": "needs the reader's own data",
    r"python studies/lab_": "needs the laboratory's data",
}
"""Commands that are not run, by how they begin, and why."""
LONG = r"vsr2 (diagnose|blind|campaign compare)"
"""Commands that take minutes, by how they begin."""
SEARCH = (
    " --no-figures --set folds=2 --set resamples=100 --set method.refine=1"
    " --set method.profile_points=0"
)
SHORTER = {
    r"vsr2 calibrate .*--resume": f"{SEARCH} --set method.design=4",
    r"vsr2 calibrate": f"{SEARCH} --set method.design=3",
    r"vsr2 run configs/demo.yaml --out out/friction": " --no-figures",
    r"vsr2 fragility configs/block_grid.yaml": " --no-figures --set fragility.azimuths=[0,45]",
    r"vsr2 fragility configs/fragility.yaml": " --no-figures --set fragility.replicates=1",
}
"""Options that make a search short, by how the command begins; the first that fits."""


def pages() -> list[Path]:
    """Pages that a reader follows, in the order of reading."""
    found: list[Path] = []
    for name in FOLDERS:
        path = ROOT / name
        found += [path] if path.is_file() else sorted(path.rglob("*.md"))
    return [page for page in found if blocks(page)]


def blocks(page: Path) -> list[str]:
    """The blocks of shell of a page."""
    return re.findall(r"^```bash\n(.*?)^```", page.read_text(encoding="utf-8"), re.M | re.S)


def written_files(page: Path) -> dict[str, str]:
    """Files that a page tells to write: the name in backquotes before a block of YAML."""
    found = re.findall(
        r"[Ww]rite[^\n`]*`([\w.-]+\.yaml)`[^\n]*\n\n```yaml\n(.*?)^```",
        page.read_text(encoding="utf-8"),
        re.M | re.S,
    )
    return dict(found)


def why_apart(command: str) -> str:
    """Why a command is not run here; empty: it is."""
    return next((why for start, why in APART.items() if re.match(start, command)), "")


def script(page: Path, long: bool) -> list[str]:
    """The commands of a page that are run, in order, as they are run."""
    lines: list[str] = []
    for block in blocks(page):
        if block.startswith("#!"):
            continue  # a script for a cluster, not a line that is typed
        for line in block.replace("\\\n", " ").splitlines():
            command = re.sub(r"\s+#.*", "", line).strip()
            if not command or command.startswith("#") or why_apart(command):
                continue
            if not long:
                if re.match(LONG, command):
                    continue
                fits = (more for start, more in SHORTER.items() if re.match(start, command))
                command += next(fits, "")
            lines.append(command)
    return lines


def run(page: Path, folder: Path, *, long: bool = False) -> subprocess.CompletedProcess[str]:
    """Run a page's commands in an empty folder."""
    for name in EMBEDDED:
        shutil.copytree(ROOT / name, folder / name)
    for name, text in written_files(page).items():
        (folder / name).write_text(text, encoding="utf-8")
    program = folder / ".bin" / "vsr2"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m vsr2.cli.main "$@"\n')
    program.chmod(0o755)
    commands = "\n".join(("set -ex", *script(page, long)))
    return subprocess.run(
        ["bash", "-c", commands],
        cwd=folder,
        env={**os.environ, "PATH": f"{program.parent}:{os.environ['PATH']}"},
        capture_output=True,
        text=True,
    )


def main() -> int:
    """Run the pages; ends with 1 if a command of one failed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--long", action="store_true", help="leave nothing out, shorten nothing")
    parser.add_argument("pages", nargs="*", type=Path)
    options = parser.parse_args()
    failed = False
    for page in [path.resolve() for path in options.pages] or pages():
        with tempfile.TemporaryDirectory() as folder:
            done = run(page, Path(folder), long=options.long)
        failed |= done.returncode != 0
        print(f"{page.relative_to(ROOT)}: exit code {done.returncode}")
        if done.returncode:
            print(done.stderr, file=sys.stderr)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
