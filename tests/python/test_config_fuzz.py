"""The fuzz command finds what it must, and runs clean over the readers of this room."""

import shutil
import subprocess
import sys

import pytest

from fuzz_command import SCRIPT, assert_runs_clean
from vsr2.config import import_ros2, load_study

BROKEN = """
import sys, time
from pathlib import Path
sys.path.insert(0, {folder!r})
import fuzz_readers as fuzz
fuzz.HANG_SECONDS = 1
def broken(path):
    {body}
fuzz.READERS["config"] = broken
sys.exit(fuzz.child("config", 1.0, 0, "seeded", Path({out!r})))
"""


def run(arguments):
    return subprocess.run(
        [sys.executable, *arguments], capture_output=True, text=True, timeout=120, check=False
    )


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("1 / 0", "ZeroDivisionError"),
        ("while True: pass", "no answer within 1 s"),
        ("bytearray(2**40)", "MemoryError"),
        ("import os; os.abort()", "Aborted"),
    ],
)
def test_a_broken_reader_is_found_and_its_file_kept(tmp_path, body, words):
    code = BROKEN.format(folder=str(SCRIPT.parent), body=body, out=str(tmp_path))
    done = run(["-c", code])
    assert done.returncode != 0
    assert words in done.stderr
    assert len(list((tmp_path / "inputs").glob("input.yaml"))) == 1


def test_the_readers_of_this_room_run_clean(tmp_path):
    assert_runs_clean(["config", "ros2"], tmp_path)


def test_the_corpus_is_sound_so_that_mutations_get_past_the_first_check(tmp_path):
    corpus = SCRIPT.parent / "corpus"
    for path in corpus.rglob("*.*"):
        shutil.copy(path, tmp_path)
    studies = sorted((corpus / "config").glob("*.yaml"))
    parameters = sorted((corpus / "ros2").glob("*.yaml"))
    assert len(studies) >= 2
    assert len(parameters) >= 2
    for path in studies:
        load_study(tmp_path / path.name)
    for path in parameters:
        import_ros2(tmp_path / path.name)
