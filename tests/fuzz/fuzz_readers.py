"""Feeds mutated real files to the readers and stores, for as long as asked.

    python tests/fuzz/fuzz_readers.py --seconds 60 [--reader config] [--seed 0]

A reader may return, or raise a `Vsr2Error`. Anything else is a finding: another exception, more
than `HANG_SECONDS` of processor time for one file, or `WAIT_SECONDS` on the clock, more than
`MEMORY_BYTES`, a crash of the process. The file that did it is kept under `--findings`, and the
exit code is 1.

With atheris installed (`pip install atheris`) the files are chosen by coverage of the readers'
Python code; without it, by a seeded loop, whose every run with one seed tries the same files. Each
reader runs in a process of its own, so a crash stops only itself.
"""

from __future__ import annotations

import argparse
import faulthandler
import hashlib
import importlib.util
import io
import logging
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
import fuzz_results  # noqa: E402
from fuzz_stores import READ, read_store, store_seeds  # noqa: E402

ROOT = HERE.parents[1]
HANG_SECONDS = 5
WAIT_SECONDS = 120
MEMORY_BYTES = 6 * 2**30
MAX_INPUT_BYTES = 64_000
COUNT = "stat::number_of_executed_units:"
"""How libFuzzer, under atheris, says how many files it tried; the seeded loop says it alike."""

SUFFIXES = {
    "config": (".yaml",),
    "ros2": (".yaml",),
    "mesh": (".obj", ".stl", ".ply"),
    "urdf": (".urdf",),
    "motion": (
        *(".csv", ".npz", ".txt", ".dat", ".tab", ".AT2", ".VT2", ".DT2"),
        *(".mseed", ".sac", ".EW"),
    ),
    "campaign": (".yaml", ".csv", ".npz"),
    "store": tuple(READ),
    **{reader: tuple(by_suffix) for reader, by_suffix in fuzz_results.READ.items()},
}
FOLDERS = {"config": "configs", "mesh": "models", "urdf": "models", "motion": "configs"}
"""Of the repository, with files that are mutated."""

# What breaks readers: odd numbers, syntax of each format, keys of the format in the wrong place.
PIECES = [
    *b"0 -1 1e999 1e-320 nan inf .nan .inf 9999999999999999999999 0x10 true ~ # ' | > & *".split(),
    *b"! % [ ] { } < > / \\ : - ? , ; = <<: *a &a [*a] --- ... !!python/name:os.getcwd".split(),
    *b"<!DOCTYPE <!ENTITY &x; ]]> <![CDATA[ </link> <link> <mesh xyz='' rpy='nan'".split(),
    *b'1e400 NaN Infinity -Infinity null false -1.5 "1" {} [1]'.split(),
    *b"f 1 1 1 v nan 0 0 f -1 -2 -3 f 99999999 vertex facet endsolid element list".split(),
    *b"poe-0.1 poe-nan poe--1 1.0 1e-320 investigation_time=0 imt='PGA' lon lat all".split(),
    *b"azimuths: fragility: parameters: keys: range: values: method: kind: result_files".split(),
    *b"rock_structure_mesh engineSettings ros__parameters shape: mode: ../.. /dev/zero".split(),
    *(b"\0", b"\xff", b"\xef\xbb\xbf", b"\n", b"\r\n", b"\t", b"  ", b'"', b"\\UFFFFFFFF"),
    *b"NPTS= DT= 999999999 UNITS OF CM/S G -.1-.1 E+999 ***** 24,0.005 ground_motion_id".split(),
    *(b"9" * 400, b"[" * 200, b"\0" * 4, b"\xff" * 4, b"\x7f\xf8" + b"\0" * 6),
]


def read_config(path: Path) -> None:
    from vsr2.config import dump_study, load_study

    dump_study(load_study(path))


def read_ros2(path: Path) -> None:
    from vsr2.config import dump_study, import_ros2
    from vsr2.report.messages.ros2_import import import_text

    imported = import_ros2(path)
    import_text(imported)
    dump_study(imported.study)


def read_mesh(path: Path) -> None:
    from vsr2.scene import load_mesh

    load_mesh(path)


def read_urdf(path: Path) -> None:
    from vsr2.scene import load_urdf

    load_urdf(path)


def read_motion(path: Path) -> None:
    import contextlib

    from vsr2.errors import Vsr2Error
    from vsr2.motion import read_record

    # a format has its own units, or needs them
    for units in (None, "m/s", "g"):
        with contextlib.suppress(Vsr2Error):
            read_record(path, units=units)


def read_campaign(path: Path) -> None:
    """Reads a sound campaign in which `path` takes the place of the file of its kind."""
    from vsr2.campaign import check_campaign, load_campaign

    folder = path.parent / "campaign"
    sound = HERE / "corpus" / "campaign"
    for name in ("motions", "series"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    shutil.copy(sound / "campaign.yaml", folder)
    shutil.copy(sound / "trials.csv", folder)
    motion, series = (content for _, content in made_seeds("campaign"))
    (folder / "motions" / "pulse.npz").write_bytes(motion)
    (folder / "series" / "A2.npz").write_bytes(series)
    match path.suffix:
        case ".yaml":
            shutil.copy(path, folder / "campaign.yaml")
        case ".csv":
            shutil.copy(path, folder / "trials.csv")
        case _:
            shutil.copy(path, folder / "motions" / "pulse.npz")
            shutil.copy(path, folder / "series" / "A2.npz")
    for problem in check_campaign(folder):
        str(problem)
    load_campaign(folder)


READERS: dict[str, Callable[[Path], None]] = {
    "config": read_config,
    "ros2": read_ros2,
    "mesh": read_mesh,
    "urdf": read_urdf,
    "motion": read_motion,
    "campaign": read_campaign,
    "store": read_store,
    **{
        reader: lambda path, by_suffix=by_suffix: by_suffix[path.suffix](path)
        for reader, by_suffix in fuzz_results.READ.items()
    },
}


class HangError(BaseException):
    """One file took too long; no reader's `except Exception` may swallow this."""


def seeds(reader: str) -> list[tuple[str, bytes]]:
    """Suffix and content of the real files that are mutated, in a fixed order."""
    folders = [HERE / "corpus" / reader]
    if reader in FOLDERS:
        folders.append(ROOT / FOLDERS[reader])
    paths = [path for folder in folders for path in sorted(folder.rglob("*"))]
    found = [
        (path.suffix, path.read_bytes())
        for path in paths
        if path.suffix in SUFFIXES[reader] and path.stat().st_size <= MAX_INPUT_BYTES
    ]
    return found + made_seeds(reader)


def made_seeds(reader: str) -> list[tuple[str, bytes]]:
    """Seeds in binary formats, made here because a repository holds text better."""
    import numpy as np

    if reader == "motion":
        displacement = 0.02 * (1 - np.cos(np.linspace(0, 2 * np.pi, 40)))
        made = []
        for keys in ({"displacement_m": displacement}, {"displacement_volt": displacement * 1e4}):
            stream = io.BytesIO()
            np.savez(stream, sample_interval_s=0.01, **keys)
            made.append((".npz", stream.getvalue()))
        return made + seismology_seeds(displacement)
    if reader == "campaign":
        time = np.arange(40) * 0.02
        pulse = 0.02 * (1 - np.cos(np.pi * time))
        contents = (
            {"sample_interval_s": 0.01, "displacement_m": pulse, "acceleration_m_s2": -pulse},
            {
                "time_s": time,
                "tilt_rad": 0.1 * time,
                "position_m": np.stack([pulse, 0 * time, 0 * time], axis=1),
                "orientation_xyzw": np.tile([0.0, 0.0, 0.0, 1.0], (40, 1)),
                "noise_tilt_rad": 0.001,
            },
        )
        made = []
        for content in contents:
            stream = io.BytesIO()
            np.savez(stream, **content)
            made.append((".npz", stream.getvalue()))
        return made
    if reader == "store":
        return store_seeds()
    if reader in fuzz_results.READ:
        return fuzz_results.result_seeds(reader)
    if reader == "mesh":
        corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype="<f4")
        faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
        stl = b"\0" * 80 + np.uint32(len(faces)).tobytes()
        for face in faces:
            stl += np.zeros(3, "<f4").tobytes() + corners[list(face)].tobytes() + b"\0\0"
        ply = (
            b"ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty float x\n"
            b"property float y\nproperty float z\nelement face 4\n"
            b"property list uchar int vertex_indices\nend_header\n"
        )
        ply += corners.tobytes()
        for face in faces:
            ply += b"\x03" + np.array(face, "<i4").tobytes()
        return [(".stl", stl), (".ply", ply)]
    return []


def seismology_seeds(signal: Any) -> list[tuple[str, bytes]]:
    """miniSEED and SAC, where obspy is installed."""
    if importlib.util.find_spec("obspy") is None:
        return []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import obspy

        made = []
        for suffix, format in ((".mseed", "MSEED"), (".sac", "SAC")):
            stream = io.BytesIO()
            trace = obspy.Trace(signal.astype("float32"), {"delta": 0.01})
            obspy.Stream([trace]).write(stream, format=format)
            made.append((suffix, stream.getvalue()))
    return made


def mutate(content: bytes, others: list[bytes], chance: random.Random) -> bytes:
    """`content` with a few pieces replaced, removed, repeated, moved, or taken from other files."""
    if content[:2] == b"PK" and chance.random() < 0.8:
        try:
            return mutate_archive(content, chance)
        except Exception:
            # Not a sound archive any more, which zipfile tells in many ways.
            return mutate_bytes(content, chance)
    for _ in range(1 + int(chance.expovariate(0.5))):
        if chance.random() < 0.4:
            content = mutate_lines(content, others, chance)
        else:
            content = mutate_bytes(content, chance)
        content = content[:MAX_INPUT_BYTES]
    return content


def mutate_lines(content: bytes, others: list[bytes], chance: random.Random) -> bytes:
    lines = content.splitlines(keepends=True) or [b""]
    at = chance.randrange(len(lines))
    match chance.randrange(6):
        case 0:
            del lines[at]
        case 1:
            lines.insert(at, chance.choice(lines))
        case 2:
            lines[at : at + 1] = [lines[at]] * chance.choice((2, 10, 300))
        case 3:
            other = chance.randrange(len(lines))
            lines[at], lines[other] = lines[other], lines[at]
        case 4:
            lines.insert(
                at, chance.choice(chance.choice(others).splitlines(keepends=True) or [b""])
            )
        case 5:
            lines[at] = b"  " * chance.randrange(4) + lines[at].lstrip()
    return b"".join(lines)


def mutate_bytes(content: bytes, chance: random.Random) -> bytes:
    start = chance.randrange(len(content) + 1)
    end = min(len(content), start + int(chance.expovariate(0.15)))
    match chance.randrange(6):
        case 0:
            return content[:start]
        case 1:
            return content[:start] + content[end:]
        case 2:
            return content[:start] + chance.choice(PIECES) + content[start:]
        case 3:
            return content[:start] + chance.choice(PIECES) + content[end:]
        case 4:
            return content[:start] + chance.randbytes(end - start) + content[end:]
        case _:
            # A token of the file for another: keys and numbers change places.
            tokens = content.split()
            if len(tokens) < 2:
                return content
            old = chance.choice(tokens)
            return content.replace(old, chance.choice((*PIECES, *tokens)), chance.choice((1, -1)))


def mutate_archive(content: bytes, chance: random.Random) -> bytes:
    """A zip with one member mutated and a right checksum, so that the reader gets further."""
    stream = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(content)) as source, zipfile.ZipFile(stream, "w") as target:
        names = source.namelist()
        chosen = chance.choice(names)
        for name in names:
            member = source.read(name)
            if name == chosen:
                member = mutate_bytes(member, chance)
                name = chance.choice((name, name, name, "other.npy", name + "/../other.npy"))
            target.writestr(name, member)
    return stream.getvalue()


class Trial:
    """Runs one reader on one input at a time, in a folder with files it may refer to."""

    def __init__(self, reader: str, folder: Path) -> None:
        from vsr2.errors import Vsr2Error

        self.count = 0
        self._read = READERS[reader]
        self._folder = folder
        self._allowed = Vsr2Error
        for path in (HERE / "corpus").rglob("*.*"):
            shutil.copy(path, folder)

    def run(self, suffix: str, content: bytes) -> None:
        # The input lies on disk before it is read: after a crash the parent finds it there.
        path = self._folder / f"input{suffix}"
        path.write_bytes(content)
        self.count += 1
        faulthandler.dump_traceback_later(WAIT_SECONDS, exit=True)
        # Of processor time, so that a busy machine finds nothing.
        signal.setitimer(signal.ITIMER_PROF, HANG_SECONDS)
        try:
            self._read(path)
        except self._allowed:
            pass
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
            faulthandler.cancel_dump_traceback_later()
        path.unlink()


def run_seeded(trial: Trial, reader: str, seconds: float, seed: int) -> None:
    chance = random.Random(f"{reader} {seed}")
    known = seeds(reader)
    contents = [content for _, content in known]
    for suffix, content in known:
        trial.run(suffix, content)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        suffix, content = chance.choice(known)
        trial.run(suffix, mutate(content, contents, chance))


def run_atheris(trial: Trial, reader: str, seconds: float, seed: int, folder: Path) -> None:
    import atheris

    # The first byte of atheris' inputs chooses the suffix.
    corpus = folder / "corpus"
    corpus.mkdir()
    known = seeds(reader)
    for i, (suffix, content) in enumerate(known):
        (corpus / str(i)).write_bytes(bytes([SUFFIXES[reader].index(suffix)]) + content)
    contents = [content for _, content in known]

    def test(data: bytes) -> None:
        if data:
            suffixes = SUFFIXES[reader]
            trial.run(suffixes[data[0] % len(suffixes)], data[1:])

    def change(data: bytes, max_size: int, chosen: int) -> bytes:
        chance = random.Random(chosen)
        if not data or chance.random() < 0.3:
            return bytes(atheris.Mutate(data, max_size))
        return (data[:1] + mutate(data[1:], contents, chance))[:max_size]

    arguments = [f"-max_total_time={int(seconds)}", f"-seed={seed + 1}", "-print_final_stats=1"]
    arguments += [f"-max_len={MAX_INPUT_BYTES}", "-timeout=60", "-rss_limit_mb=0"]
    arguments += [f"-artifact_prefix={folder}/atheris-"]
    atheris.Setup([sys.argv[0], *arguments, str(corpus)], test, custom_mutator=change)
    atheris.Fuzz()


def child(reader: str, seconds: float, seed: int, engine: str, folder: Path) -> int:
    """Fuzz one reader in this process; 0 if nothing was found."""

    def hang(*_: object) -> None:
        raise HangError(f"no answer within {HANG_SECONDS} s of processor time")

    signal.signal(signal.SIGPROF, hang)
    faulthandler.enable()
    # Libraries log what they try on the way; in an hour that fills a disk.
    logging.disable()
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    if engine == "atheris":
        import atheris

        with atheris.instrument_imports(include=["vsr2", "yaml"]):
            import vsr2.campaign
            import vsr2.config
            import vsr2.motion
            import vsr2.scene  # noqa: F401
    inputs = folder / "inputs"
    inputs.mkdir()
    trial = Trial(reader, inputs)
    try:
        if engine == "atheris":
            run_atheris(trial, reader, seconds, seed, folder)
        else:
            run_seeded(trial, reader, seconds, seed)
    except BaseException:
        traceback.print_exc()
        return 1
    finally:
        print(f"{COUNT} {trial.count}")
    return 0


def parent(readers: list[str], arguments: argparse.Namespace) -> int:
    """Fuzz each reader in a process of its own; 1 if any was found wanting."""
    engine = arguments.engine
    if engine == "auto":
        engine = "atheris" if importlib.util.find_spec("atheris") else "seeded"
    share = arguments.seconds / len(readers)
    failed = False
    for reader in readers:
        with tempfile.TemporaryDirectory() as name:
            command = [sys.executable, __file__, "--child", name, "--engine", engine]
            command += ["--reader", reader, "--seconds", str(share), "--seed", str(arguments.seed)]
            log = Path(name) / "log"
            with log.open("wb") as stream:
                process = subprocess.Popen(command, stdout=stream, stderr=subprocess.STDOUT)
                try:
                    code = process.wait(share + 120)
                except subprocess.TimeoutExpired:
                    process.kill()
                    code = process.wait()
            said = log.read_text(errors="replace")
            counts = re.findall(rf"{COUNT} +(\d+)", said)
            if code == 0 and counts:
                print(f"{reader}: {counts[-1]} files in {share:.0f} s ({engine}), nothing found")
                continue
            failed = True
            inputs = sorted((Path(name) / "inputs").glob("input.*"))
            print(f"{reader}: {'FOUND' if inputs else 'FAILED'} ({engine}, exit code {code})")
            print(said[-6000:])
            for path in inputs:
                print(f"{reader}: the file is kept as {keep(path, reader, arguments.findings)}")
    return 1 if failed else 0


def keep(path: Path, reader: str, findings: Path) -> Path:
    findings.mkdir(parents=True, exist_ok=True)
    digest = hashlib.sha256(path.read_bytes()).hexdigest()[:12]
    kept = findings / f"{reader}-{digest}{path.suffix}"
    shutil.copy(path, kept)
    return kept


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--seconds", type=float, default=60.0, help="for all readers together")
    parser.add_argument("--reader", choices=list(READERS), action="append", help="default: all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--engine", choices=("auto", "atheris", "seeded"), default="auto")
    parser.add_argument("--findings", type=Path, default=ROOT / "build" / "fuzz-findings")
    parser.add_argument("--child", type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    readers = arguments.reader or list(READERS)
    if arguments.child is None:
        return parent(readers, arguments)
    return child(readers[0], arguments.seconds, arguments.seed, arguments.engine, arguments.child)


if __name__ == "__main__":
    sys.exit(main())
