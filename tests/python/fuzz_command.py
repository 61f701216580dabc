"""The fuzz command over some readers, in a process of its own."""

import subprocess
import sys
from pathlib import Path

SCRIPT = Path(__file__).parents[1] / "fuzz" / "fuzz_readers.py"


def assert_runs_clean(readers, tmp_path, *, seconds=2):
    """Nothing is found in some seconds of seeded mutations, and nothing is written.

    Args:
        readers: names of them.
        tmp_path: where findings would be.
        seconds: for all of them.
    """
    named = [word for reader in readers for word in ("--reader", reader)]
    options = ["--engine", "seeded", "--seconds", str(seconds)]
    done = subprocess.run(
        [sys.executable, str(SCRIPT), *named, *options, "--findings", str(tmp_path / "findings")],
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout
    assert done.stdout.count("nothing found") == len(readers)
    assert not (tmp_path / "findings").exists()
