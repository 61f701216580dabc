"""What SIGINT and SIGTERM do to the command line: one sentence and an exit code."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest

import vsr2

GRID = """\
name: block
rock: {shape: box, size: [0.25, 0.5, 1.0], density: 2700.0}
motion:
  mode: grid_cosine
  pga_g: {min: 0.2, max: 0.8, step: 0.001}
  pgv_pga_s: {min: 0.05, max: 0.4, step: 0.01}
output: {figures: false}
"""


@pytest.mark.parametrize(
    ("name", "code", "said"),
    [
        ("SIGINT", 130, "vsr2: interrupted\n"),
        ("SIGTERM", 143, "vsr2: ended by SIGTERM\n"),
    ],
)
def test_a_signal_while_modules_are_imported_is_said_and_has_its_exit_code(
    name: str, code: int, said: str
) -> None:
    script = textwrap.dedent(
        f"""
        import signal, sys

        # A shell's job in the background has Ctrl-C ignored from the start.
        signal.signal(signal.SIGINT, signal.default_int_handler)

        class Interrupt:
            def find_spec(self, name, path=None, target=None):
                if name == "cyclopts":
                    signal.raise_signal(signal.{name})

        sys.meta_path.insert(0, Interrupt())
        from vsr2.cli.entry import program
        sys.exit(program())
        """
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (code, said)


@pytest.mark.parametrize("entry", [("-m", "vsr2"), ("-m", "vsr2.cli.entry")])
@pytest.mark.parametrize(("name", "code"), [("SIGINT", 130), ("SIGTERM", 143)])
@pytest.mark.parametrize("module", ["cyclopts", "vsr2._native"])
@pytest.mark.parametrize("then", ["raise", "raise ImportError('initialization failed')"])
def test_a_signal_amid_an_import_has_its_exit_code_whatever_becomes_of_it(
    entry: tuple[str, ...], name: str, code: int, module: str, then: str, tmp_path: Path
) -> None:
    """Native modules turn KeyboardInterrupt into ImportError; dataclasses evaluate text."""
    (tmp_path / "sitecustomize.py").write_text(
        textwrap.dedent(
            f"""
            import signal, sys

            signal.signal(signal.SIGINT, signal.default_int_handler)

            class Interrupt:
                def find_spec(self, name, path=None, target=None):
                    if name == "{module}":
                        try:
                            exec("signal.raise_signal(signal.{name})")
                        except BaseException:
                            {then}

            sys.meta_path.insert(0, Interrupt())
            """
        )
    )
    folders = os.pathsep.join((str(tmp_path), str(Path(vsr2.__file__).parents[1])))
    done = subprocess.run(
        [sys.executable, *entry, "--help"], capture_output=True, text=True,
        env={**os.environ, "PYTHONPATH": folders},
    )  # fmt: skip
    said = {"SIGINT": "vsr2: interrupted\n", "SIGTERM": "vsr2: ended by SIGTERM\n"}[name]
    assert (done.returncode, done.stderr, done.stdout) == (code, said, "")


@pytest.mark.parametrize("handler", ["SIG_IGN", "default_int_handler"])
def test_sigterm_ends_a_verb_whose_ctrl_c_is_ignored(handler: str) -> None:
    """A shell's job in the background has Ctrl-C ignored from the start."""
    script = textwrap.dedent(
        f"""
        import signal, sys
        signal.signal(signal.SIGINT, signal.{handler})
        from vsr2.cli import main
        main._main = lambda arguments: signal.raise_signal(signal.SIGTERM) or 0
        sys.exit(main.main([]))
        """
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.stderr.startswith("vsr2: ended by SIGTERM\n")
    assert "KeyboardInterrupt" in done.stderr, "which the verbs turn into their message"


def test_nothing_is_imported_before_ctrl_c_is_guarded_against() -> None:
    """The packages that the entry point is imported through import nothing by themselves."""
    code = "import sys; known = set(sys.modules); import vsr2.cli.entry; "
    code += "print(*sorted(set(sys.modules) - known))"
    # -S: else files of the environment import for themselves.
    done = subprocess.run(
        [sys.executable, "-S", "-c", code], capture_output=True, text=True, check=True,
        env={**os.environ, "PYTHONPATH": str(Path(vsr2.__file__).parents[1])},
    )  # fmt: skip
    assert done.stdout.split() == ["vsr2", "vsr2.cli", "vsr2.cli.entry"]


def test_sigterm_keeps_what_is_finished_and_says_so(tmp_path: Path) -> None:
    study = tmp_path / "study.yaml"
    study.write_text(GRID)
    out = tmp_path / "out"
    command = [sys.executable, "-m", "vsr2.cli.entry", "run", str(study), "--out", str(out)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env={**os.environ}) as batch:
        journal = out / "journal.jsonl"
        while batch.poll() is None and not (journal.exists() and journal.stat().st_size > 500):
            time.sleep(0.02)
        batch.send_signal(signal.SIGTERM)
        message = batch.communicate(timeout=120)[1]
    assert batch.returncode == 143
    assert message.startswith("vsr2: ended by SIGTERM\n")
    assert "are finished and kept in" in message
    assert "Traceback" not in message
