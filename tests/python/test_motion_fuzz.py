"""Whatever the bytes, a reader gives a record or an error of ours; so does what follows."""

import contextlib
import io
import warnings
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from vsr2.config.motion_source import Filter
from vsr2.errors import Vsr2Error
from vsr2.motion import build_recorded_motion, fuse, intensity_measures, read_record

N = 24
X = np.sin(np.arange(N) * 0.3)


def npz(save, **arrays):
    buffer = io.BytesIO()
    save(buffer, **arrays)
    return buffer.getvalue()


def table(header, separator, row, end):
    lines = [header, *(separator.join(row(i)) + end for i in range(N))]
    return ("\n".join(lines) + "\n").encode()


def laboratory_row(i):
    t = f"{i * 0.00125:.6g}"
    return [t, f"{X[i]:.6g}", t, "0.1", t, f"{100 * X[i]:.6g}", t, "0.2", ""]


def peer(title, header):
    rows = ["".join(f"{x:15.7E}" for x in X[i : i + 5]) for i in range(0, N, 5)]
    return "\n".join(["PEER", "Somewhere", title, header, *rows, ""]).encode()


def values():
    return "".join(f"{x:.6f}\n" for x in X).encode()


def obspy_seeds():
    """miniSEED, SAC and K-NET, where obspy is installed."""
    if find_spec("obspy") is None:
        return {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import obspy

        found = {"ew": [KNET + " ".join(f"{1000 * x:.0f}" for x in X).encode() + b"\n"]}
        for suffix, format in (("mseed", "MSEED"), ("sac", "SAC")):
            stream = obspy.Stream([obspy.Trace(X.astype(np.float32), {"delta": 0.01})])
            buffer = io.BytesIO()
            stream.write(buffer, format=format)
            found[suffix] = [buffer.getvalue()]
    return found


KNET = (Path(__file__).parents[1] / "fuzz" / "corpus" / "motion" / "header.EW").read_bytes()
UNITS = {"tab": "m/s", "dat": "g", "mseed": "cm/s^2", "sac": "mm/s"}

SEEDS = {
    "csv": [
        table("time_s,displacement_m", ",", lambda i: [f"{i * 0.005:.3f}", f"{X[i]:.6f}"], ""),
        table(
            "# note\ntime_s,displacement_m,acceleration_m_s2",
            ",",
            lambda i: [f"{i * 0.005:.3f}", f"{X[i]:.6f}", f"{-X[i]:.6f}"],
            "\r",
        ),
    ],
    "npz": [
        npz(np.savez, sample_interval_s=0.005, displacement_m=X, acceleration_m_s2=-X),
        npz(np.savez_compressed, sample_interval_s=0.005, displacement_m=X),
        npz(
            np.savez,
            sample_interval_s=0.00125,
            displacement_volt=X.astype(np.float32),
            acceleration_g=X.astype(np.float32),
        ),
    ],
    "at2": [peer("ACCELERATION TIME SERIES IN UNITS OF G", "NPTS= 24, DT= .005 SEC")],
    "vt2": [peer("VELOCITY TIME HISTORY IN UNITS OF CM/S", "24 .005 NPTS, DT")],
    "tab": [
        b"TITLE\n24,0.005\n" + values(),
        b"# number of velocity points: 24, dt: 0.005\n" + values(),
        table(
            "ground_motion_id\ttime\tvelocity",
            "\t",
            lambda i: ["1", f"{i * 0.005:.3f}", f"{X[i]:.6f}"],
            "",
        ),
    ],
    "dat": [
        table("# t v", "  ", lambda i: [f"{i * 0.005:.3f}", f"{X[i]:.6f}"], "\r"),
        table("t;v", ";", lambda i: [f"{i * 0.005:.3f}", f"{X[i]:.6f}"], ""),
    ],
    "txt": [table("Time [s] - Plot 0\tAmplitude", "\t", laboratory_row, "\r")],
}
SEEDS |= obspy_seeds()

TOKENS = [
    *(b"nan", b"inf", b"-1e308", b"1e308", b"5e-324", b"1_0", b"0x1", b"-", b",", b"\t", b"\n"),
    *(b"\x00", b"\xff", b"'descr': '|O'", b"(1000000000000,)", b"(-1,)", b"<f8", b"<c16"),
    *(b"NPTS", b"=", b"999999999", b"UNITS OF", b"E+999", b"*****", b";", b"-.1-.1", b"0,0.01"),
]


@st.composite
def mutated(draw, seeds):
    content = bytearray(draw(st.sampled_from(seeds)))
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, len(content)))
        length = draw(st.integers(0, 12))
        new = draw(st.one_of(st.binary(max_size=8), st.sampled_from(TOKENS)))
        kind = draw(st.sampled_from(["replace", "insert", "delete", "cut", "repeat"]))
        if kind == "replace":
            content[at : at + max(len(new), 1)] = new
        elif kind == "insert":
            content[at:at] = new
        elif kind == "delete":
            del content[at : at + length]
        elif kind == "cut":
            del content[at:]
        else:
            content[at:at] = content[at : at + 8 * length]
    return bytes(content)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("fuzz")


def read_and_build(path, content):
    path.write_bytes(content)
    with contextlib.suppress(Vsr2Error):
        record = read_record(path, units=UNITS.get(path.suffix[1:]))
        for use in (intensity_measures, fuse):
            with contextlib.suppress(Vsr2Error):
                use(record)
        for chosen in (None, Filter()):
            for channel in ("auto", "acceleration"):
                with contextlib.suppress(Vsr2Error):
                    build_recorded_motion(record, 0.001, channel=channel, filter=chosen)


@pytest.mark.parametrize("suffix", SEEDS)
def test_the_seeds_themselves_are_read(folder, suffix):
    for seed in SEEDS[suffix]:
        path = folder / f"seed.{suffix}"
        path.write_bytes(seed)
        assert read_record(path, units=UNITS.get(suffix)).size == N


@pytest.mark.parametrize("suffix", SEEDS)
@settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_mutated_files_give_a_record_or_our_error(folder, suffix, data):
    read_and_build(folder / f"mutated.{suffix}", data.draw(mutated(SEEDS[suffix])))


@pytest.mark.parametrize("suffix", SEEDS)
@settings(max_examples=40, deadline=None)
@given(content=st.binary(max_size=300))
def test_arbitrary_bytes_give_a_record_or_our_error(folder, suffix, content):
    read_and_build(folder / f"any.{suffix}", content)
