"""The effect `input_channel`: which record drives, and the gains of its instruments."""

from __future__ import annotations

import gc
import math
from dataclasses import replace

import numpy as np
import pytest

from vsr2.config.motion_source import Filter
from vsr2.effects import apply_effects, effect
from vsr2.ensemble.simulated.library import free_parameters, sides, values_at
from vsr2.errors import ConfigError, MotionError
from vsr2.motion import ChannelNoise, Motion, Noise, Record, Recorded
from vsr2.motion.processing import differentiate
from vsr2.motion.study_motions import KeptDisplacements
from vsr2.simulation.bench import EffectBench
from vsr2.trial import Trial

STEP = 0.002
OWN = effect("input_channel")


def record(gain: float = 1.2, *, acceleration: bool = True) -> Record:
    time = np.arange(4000) * STEP
    x = sum(a * np.sin(2 * np.pi * f * time) for a, f in ((0.03, 0.8), (0.01, 3.0), (0.002, 10.0)))
    found = differentiate(np.sin(np.pi * time / time[-1]) ** 4 * x, STEP)
    channels = {"acceleration": gain * found.acceleration} if acceleration else {}
    return Record("r", STEP, displacement=found.displacement, **channels)


_JOINED = record()


def trial(one: Record, **how: object) -> Trial:
    motion = Recorded(one, **{"filter": Filter(), **how}).motion(0.001)  # type: ignore[arg-type]
    return replace(EffectBench().block(), motion=motion)


def driven(of: Trial, **values: float | str) -> Motion:
    return apply_effects([of], {"input_channel": values})[0].motion


def test_records_of_one_motion_join_to_it_at_any_crossover() -> None:
    own = trial(record(1.0))
    plain = own.motion
    for crossover in (0.5, 3.0, 20.0):
        joined = driven(own, crossover=crossover)
        assert joined.size == plain.size
        # The integral of the acceleration is off by what its band-pass does at the ends.
        inside = slice(500, -500)
        off = (joined.acceleration - plain.acceleration)[inside]
        np.testing.assert_allclose(off, 0.0, atol=0.01)
        np.testing.assert_allclose(joined.displacement, plain.displacement, atol=5e-4)


def test_records_are_integrated_once_within_a_bound_and_as_long_as_they_live() -> None:
    records = [record(gain) for gain in (1.0, 1.1, 1.2)]
    own = [Recorded(one, channel="acceleration", filter=Filter()) for one in records]
    each = 8 * records[0].size
    kept = KeptDisplacements(2 * each)
    first = [kept.of(one) for one in own]
    again = [kept.of(one) for one in own]
    assert [old is new for old, new in zip(first, again, strict=True)] == [True, True, False]
    np.testing.assert_array_equal(first[2], again[2])
    assert not first[0].flags.writeable
    other = replace(own[0], filter=Filter(low=0.2))
    assert kept.size == 2 * each
    assert not np.array_equal(kept.of(other), first[0])
    del own[0], records[0], other
    gc.collect()
    assert kept.size == each


def test_a_record_joined_again_is_joined_alike() -> None:
    for crossover in (2.0, 5.0):
        fresh, kept = (
            Recorded(one, filter=Filter(), scale=0.9).crossed(crossover).motion(0.001)
            for one in (record(), _JOINED)
        )
        assert fresh == kept


def test_the_ends_of_the_crossover_are_the_records_alone() -> None:
    own = trial(record())
    slow, fast = driven(own, channel="displacement"), driven(own, channel="acceleration")
    assert fast.peak_acceleration > 1.1 * slow.peak_acceleration
    np.testing.assert_array_equal(slow.displacement, own.motion.displacement)
    near = [driven(own, crossover=crossover).peak_acceleration for crossover in (0.05, 200.0)]
    assert near == pytest.approx([fast.peak_acceleration, slow.peak_acceleration], rel=0.01)


def test_a_joined_motion_knows_its_record_and_is_joined_again() -> None:
    own = trial(record(), scale=0.5)
    joined = driven(own, crossover=3.0)
    assert joined.recorded is not None
    assert (joined.recorded.used, joined.recorded.crossover) == ("fused", 3.0)
    assert joined.recorded.scale == 0.5
    again = driven(replace(own, motion=joined), crossover=5.0)
    np.testing.assert_array_equal(again.displacement, driven(own, crossover=5.0).displacement)
    other = driven(replace(own, motion=joined), channel="displacement")
    np.testing.assert_array_equal(other.displacement, own.motion.displacement)


def test_nominal_is_the_record_that_drives() -> None:
    def nominal(of: Trial) -> float:
        return OWN.nominal(of)["crossover"]

    both = record()
    assert nominal(trial(both)) == math.inf
    assert nominal(trial(both, channel="acceleration")) == 0.0
    assert nominal(trial(both, channel="fused", crossover=3.0)) == 3.0
    assert nominal(EffectBench().block()) == math.inf
    for given in ({}, {"channel": "acceleration"}, {"channel": "fused", "crossover": 3.0}):
        of = trial(both, **given)
        assert OWN.with_null(OWN.nominal(of)).is_null(OWN.nominal(of))


def test_the_crossover_is_open_where_all_trials_have_both_records() -> None:
    both, one = trial(record()), trial(record(acceleration=False))
    opened = OWN.opened([both, both])
    assert {p.name for p in free_parameters(opened)} == {"low_gain", "high_gain", "crossover"}
    for trials in ([both, one], [one], [EffectBench().block()]):
        assert OWN.opened(trials) is OWN
    own = OWN.with_prior("crossover", 1.0, 5.0, "uniform")
    assert own.opened([both]) is own


@pytest.mark.parametrize(
    ("channel", "small", "large"), [("displacement", 20.0, 0.5), ("acceleration", 0.5, 20.0)]
)
def test_a_diagnosis_begins_at_the_record_that_drives(
    channel: str, small: float, large: float
) -> None:
    # A channel is no magnitude: from either record the crossover leads to the other one.
    of = trial(record(), channel=channel)
    found = OWN.opened([of]).with_null(OWN.nominal(of))
    names = [p.name for p in found.parameters]
    at = names.index("crossover")
    for side in sides(found):
        for share, expected in ((1e-9, small), (1.0, large)):
            values = values_at(found, side, [0.0, 0.0, share], ())
            assert values[at] == pytest.approx(expected, rel=1e-5)
            assert values[names.index("channel")] == 0.0
        assert values_at(found, side, [0.5, 0.5, 0.0], ())[at] == OWN.nominal(of)["crossover"]


def test_gains_act_on_any_motion_and_a_channel_that_is_not_there_is_refused() -> None:
    one = trial(record(acceleration=False))
    assert driven(one, high_gain=0.4).peak_acceleration > 1.1 * one.motion.peak_acceleration
    assert (
        driven(EffectBench().block(), low_gain=-0.4).pgv_m_s < EffectBench().block().motion.pgv_m_s
    )
    for key, given in (("crossover", 3.0), ("channel", "fused")):
        # The message begins with what the user wrote.
        said = "crossover" if key == "crossover" else given
        with pytest.raises(MotionError, match=rf"channel\.{key}: {said} cannot .* accelerat"):
            driven(one, **{key: given})
        with pytest.raises(MotionError, match=rf"channel\.{key}: {said} needs a recorded"):
            driven(EffectBench().block(), **{key: given})
    with pytest.raises(ConfigError, match=r"input_channel\.channel: fused is one way to drive"):
        driven(trial(record()), channel="fused", crossover=3.0)


def test_a_gain_changes_what_is_slow_or_fast_and_ends_at_rest() -> None:
    own = trial(record())
    slow, fast = driven(own, low_gain=0.3), driven(own, high_gain=0.3)
    # Most of the displacement is slow, and much of the acceleration fast.
    reach = float(np.ptp(own.motion.displacement))
    assert 1.2 < np.ptp(slow.displacement) / reach < 1.3
    assert np.ptp(fast.displacement) == pytest.approx(reach, rel=0.03)
    assert fast.peak_acceleration > 1.05 * own.motion.peak_acceleration
    for motion in (slow, fast):
        assert motion.velocity[-1] == 0
        assert motion.recorded is None
        # The samples of speed and acceleration are those of the displacement's derivatives.
        found = differentiate(motion.displacement, motion.time_step)
        inside = slice(10, -10)
        np.testing.assert_allclose(motion.velocity[inside], found.velocity[inside], atol=1e-4)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"channel": "displacement", "crossover": 3.0}, "go with the displacement channel"),
        (
            {
                "channel": "fused", "crossover": 3.0,
                "noise": ChannelNoise(Noise(1e-5), Noise(0.01)),
            },
            "go with noise",
        ),
        ({"channel": "fused", "crossover": math.inf}, "not positive and finite"),
        ({"channel": "fused", "crossover": 0.0}, "not positive and finite"),
    ],
)  # fmt: skip
def test_a_crossover_that_means_nothing_is_refused(given: dict[str, object], message: str) -> None:
    with pytest.raises(MotionError, match=message):
        Recorded(record(), **given)  # type: ignore[arg-type]


def test_a_crossover_beyond_the_record_s_sampling_is_refused() -> None:
    with pytest.raises(MotionError, match=r"300 Hz is not below the record's Nyquist .* 250 Hz"):
        Recorded(record()).crossed(300.0).motion(0.001)
