"""The planar rocking block of Housner: an own, fast model of a rock on a shaking table.

A rigid block of half width b and half height h stands on a table that accelerates with a(t). It
turns by theta about one of its base edges; with s = sgn(theta), R^2 = b^2 + h^2 and
p^2 = m g R / I_O,

    theta'' = -(p^2 / (g R)) [ s g x_s(theta) + a z_s(theta) ] - 2 zeta p theta' - p^2 (d/R) dir,

x_s and z_s being the horizontal and vertical distance of the mass centre from the contact,
x = b_s cos|theta| - h sin|theta|, z = b_s sin|theta| + h cos|theta| for a sharp edge (G. W. Housner
"The behavior of inverted pendulum structures during earthquakes", BSSA 53, 1963); an edge of radius
r rolls: b_s - r and h - r stand for b_s and h, and z gains r. When theta passes 0 the angular
velocity is multiplied by sqrt(e) (1 - 2 sin^2(alpha) m R^2 / I_O), Housner's ratio times the square
root of the energy ratio e. A block at rest lifts off where |a| h > g b_s.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from vsr2.ensemble.observed.features import tilt_features

Array = NDArray[np.float64]

GRAVITY = 9.81
"""[m/s^2]."""
STEP = 0.005
"""Time step of the integration [s]."""
OVERTURNED = 1.2
"""Tilt from which a block does not come back [rad]."""
_REST_SPEED = 0.005
"""Angular speed after an impact below which a block that has no cause to lift off rests [rad/s]."""
_CHUNK = 8192
_SERIES_EVERY = 2


@dataclass(frozen=True, eq=False)
class PlanarBlocks:
    """Independent blocks under their motions, one value a run, each of shape (n,).

    Attributes:
        motion: column of the accelerations.
        half_width, half_height: [m].
        com_offset: of the mass centre towards +x [m].
        inertia: factor on the inertia about the mass centre.
        energy_ratio: over an impact, relative to Housner's.
        damping: zeta, of the rocking.
        rolling: d, lever arm of the resisting moment [m].
        radius: of the base edges [m].
        gain: on the motion.
        offset: constant acceleration of a tilted base, g sin(slope) [m/s^2].
        pitch: of the table per acceleration [rad/g], through a mode of `pitch_frequency` [Hz].
        pitch_frequency: [Hz].
        low_pass: corner of a second-order low-pass on the motion [Hz]; infinite: none.
        resonance: frequency of a mode in series with the motion [Hz]; infinite: none.
        amplification: of that mode at its frequency.
        cap: greatest acceleration [m/s^2]; infinite: none.
        speed: how many times too fast the motion is played, its displacement kept.
        catch_slack: tilt towards +x at which a tether holds the block [rad]; infinite: none.
        outcome_tilt: tilt from which a trial is called overturned [rad].
        flipped: 1 where the outcome is noted wrongly.
    """

    motion: NDArray[np.int64]
    half_width: Array
    half_height: Array
    com_offset: Array
    inertia: Array
    energy_ratio: Array
    damping: Array
    rolling: Array
    radius: Array
    gain: Array
    offset: Array
    pitch: Array
    pitch_frequency: Array
    low_pass: Array
    resonance: Array
    amplification: Array
    cap: Array
    speed: Array
    catch_slack: Array
    outcome_tilt: Array
    flipped: Array

    def take(self, rows: NDArray[np.int64]) -> PlanarBlocks:
        """Some of the runs."""
        return PlanarBlocks(**{f.name: getattr(self, f.name)[rows] for f in fields(self)})


DEFAULTS: dict[str, float] = {
    "com_offset": 0.0,
    "inertia": 1.0,
    "energy_ratio": 1.0,
    "damping": 0.0,
    "rolling": 0.0,
    "radius": 0.0,
    "gain": 1.0,
    "offset": 0.0,
    "pitch": 0.0,
    "pitch_frequency": 10.0,
    "low_pass": np.inf,
    "resonance": np.inf,
    "amplification": 1.0,
    "cap": np.inf,
    "speed": 1.0,
    "catch_slack": np.inf,
    "outcome_tilt": OVERTURNED,
    "flipped": 0.0,
}


def simulate_planar(
    blocks: PlanarBlocks, accelerations: Array, *, series: bool = False
) -> tuple[Array, Array, Array | None]:
    """Shake the blocks.

    Args:
        blocks: n runs.
        accelerations: of the table, sampled every `STEP`, one column a motion, rest after the
            motion included, shape (steps, motions) [m/s^2].
        series: also return features of the tilt's series.

    Returns:
        Overturned (n,), largest tilt (n,) [rad] and, on request, features (n, k).
    """
    count = blocks.motion.size
    overturned, peak = np.empty(count), np.empty(count)
    found: list[Array] = []
    for start in range(0, count, _CHUNK):
        rows = np.arange(start, min(start + _CHUNK, count))
        over, top, tilt = _shake(blocks.take(rows), accelerations, series)
        overturned[rows], peak[rows] = over, top
        if tilt is not None:
            time = np.arange(float(len(tilt))) * _SERIES_EVERY * STEP
            found.append(np.stack([tilt_features(time, column) for column in tilt.T]))
    return overturned, peak, np.concatenate(found) if series and found else None


class _Table:
    """The table's acceleration as each block feels it, step by step."""

    def __init__(self, blocks: PlanarBlocks, accelerations: Array) -> None:
        self._samples = accelerations
        self._blocks = blocks
        self._uniform = bool((blocks.speed == 1.0).all())
        self._modes = [
            (index, 2 * np.pi * blocks.low_pass[index], np.full(index.size, 0.7071), "low")
            for index in [np.flatnonzero(np.isfinite(blocks.low_pass))]
            if index.size
        ]
        index = np.flatnonzero(np.isfinite(blocks.resonance) & (blocks.amplification > 1.0))
        if index.size:
            # |H| at the natural frequency is 1 / (2 zeta).
            zeta = 1.0 / (2.0 * blocks.amplification[index])
            self._modes.append((index, 2 * np.pi * blocks.resonance[index], zeta, "mode"))
        self._pitching = np.flatnonzero(blocks.pitch)
        self._states = [(np.zeros(m[0].size), np.zeros(m[0].size)) for m in self._modes]
        self._pitch_state = (np.zeros(self._pitching.size), np.zeros(self._pitching.size))

    def at(self, step: int) -> Array:
        blocks, samples = self._blocks, self._samples
        if self._uniform:
            a = samples[step][blocks.motion] * blocks.gain
        else:
            place = step * blocks.speed
            low = np.minimum(place.astype(np.int64), len(samples) - 2)
            part = np.clip(place - low, 0.0, 1.0)
            value = (
                samples[low, blocks.motion] * (1 - part) + samples[low + 1, blocks.motion] * part
            )
            value[place > len(samples) - 1] = 0.0
            a = value * blocks.gain * blocks.speed**2
        for (index, omega, zeta, _), state in zip(self._modes, self._states, strict=True):
            a[index] = _second_order(a[index], omega, zeta, state)
        np.clip(a, -blocks.cap, blocks.cap, out=a)
        if self._pitching.size:
            index = self._pitching
            omega = 2 * np.pi * blocks.pitch_frequency[index]
            angle = _second_order(
                blocks.pitch[index] * a[index] / GRAVITY, omega, 0.2, self._pitch_state
            )
            a[index] += GRAVITY * angle
        return np.asarray(a + blocks.offset, dtype=np.float64)


def _second_order(
    value: Array, omega: Array, zeta: Array | float, state: tuple[Array, Array]
) -> Array:
    """Next output of x'' = omega^2 (u - x) - 2 zeta omega x', by the implicit midpoint rule."""
    x, v = state
    half = 0.5 * STEP
    # Solved for the mean velocity over the step.
    mean = (v + half * omega**2 * (value - x)) / (1 + 2 * zeta * omega * half + (omega * half) ** 2)
    x += STEP * mean
    v[:] = 2 * mean - v
    return x.copy()


def _shake(
    blocks: PlanarBlocks, accelerations: Array, series: bool
) -> tuple[Array, Array, Array | None]:
    count = blocks.motion.size
    steps = len(accelerations)
    over, peak = np.zeros(count), np.zeros(count)
    tilt = np.zeros((steps // _SERIES_EVERY + 1, count)) if series else None
    rows = np.arange(count)
    table = _Table(blocks, accelerations)
    state = _State(blocks)
    theta, rate = np.zeros(count), np.zeros(count)
    acceleration = state.angular_acceleration(theta, rate, table.at(0))
    for step in range(1, steps):
        half = rate + 0.5 * STEP * acceleration
        new = theta + STEP * half
        crossing = np.flatnonzero(new * theta < 0)
        if crossing.size:
            before, after = theta[crossing], new[crossing]
            part = before / (before - after)
            # The velocity at the impact itself, between the two halves of the step.
            arrival = rate[crossing] + part * STEP * acceleration[crossing]
            half[crossing] = state.velocity_ratio[crossing] * arrival
            new[crossing] = half[crossing] * (1 - part) * STEP
        a = table.at(step)
        if crossing.size:
            slow = crossing[(np.abs(half[crossing]) < _REST_SPEED) & ~state.lifts(a)[crossing]]
            new[slow] = 0.0
            half[slow] = 0.0
        theta = new
        acceleration = state.angular_acceleration(theta, half, a)
        rate = half + 0.5 * STEP * acceleration
        if crossing.size:
            rate[crossing] += (0.5 - part) * STEP * acceleration[crossing]
        tilts = np.abs(theta)
        peak[rows] = np.maximum(peak[rows], tilts)
        if tilt is not None and step % _SERIES_EVERY == 0:
            tilt[step // _SERIES_EVERY, rows] = tilts
        caught = theta >= blocks.catch_slack
        if caught.any():
            theta[caught] = blocks.catch_slack[caught]
            rate[caught] = 0.0
            acceleration[caught] = 0.0
            peak[rows[caught]] = np.minimum(peak[rows[caught]], theta[caught])
        gone = tilts > OVERTURNED
        if step % 50 == 0 and (gone.any() or caught.any()):
            ended = gone | caught
            over[rows[gone & ~caught]] = 1.0
            peak[rows[gone & ~caught]] = np.pi / 2
            if tilt is not None:
                tilt[step // _SERIES_EVERY :, rows[gone]] = np.pi / 2
                tilt[step // _SERIES_EVERY :, rows[caught]] = theta[caught]
            kept = np.flatnonzero(~ended)
            rows, theta, rate = rows[kept], theta[kept], rate[kept]
            acceleration = acceleration[kept]
            blocks = blocks.take(kept)
            table = _resumed(table, blocks, kept)
            state = _State(blocks)
            if not rows.size:
                break
    else:
        gone = np.abs(theta) > OVERTURNED
        over[rows[gone]] = 1.0
    return over, np.minimum(peak, np.pi / 2), tilt


def _resumed(table: _Table, blocks: PlanarBlocks, kept: NDArray[np.int64]) -> _Table:
    out = _Table(blocks, table._samples)
    states = {}
    for mode, state in zip(table._modes, table._states, strict=True):
        held = np.isin(mode[0], kept)
        states[mode[3]] = (state[0][held], state[1][held])
    out._states = [states[mode[3]] for mode in out._modes]
    held = np.isin(table._pitching, kept)
    out._pitch_state = (table._pitch_state[0][held], table._pitch_state[1][held])
    return out


class _State:
    """Constants of the blocks that the equation of motion needs."""

    def __init__(self, blocks: PlanarBlocks) -> None:
        b, h = blocks.half_width, blocks.half_height
        size2 = b**2 + h**2
        # Of a rectangular solid: I_cm = m R^2 / 3.
        moment = size2 * (1 + blocks.inertia / 3)
        self._per_moment = 1.0 / moment
        self._p2 = GRAVITY * np.sqrt(size2) / moment
        self._drag = 2 * blocks.damping * np.sqrt(self._p2)
        self._rolling = GRAVITY * blocks.rolling / moment
        self._radius = blocks.radius
        self._right = b - blocks.com_offset - blocks.radius
        self._left = b + blocks.com_offset - blocks.radius
        self._height = h - blocks.radius
        self._full_height = h
        housner = 1 - 2 * (b**2 / size2) * size2 / moment
        self.velocity_ratio = np.minimum(np.sqrt(blocks.energy_ratio) * housner, 1.0)

    def lifts(self, a: Array) -> NDArray[np.bool_]:
        """Whether a resting block would lift off."""
        arm = np.where(a < 0, self._right, self._left)
        return np.asarray(np.abs(a) * self._full_height > GRAVITY * arm, dtype=np.bool_)

    def angular_acceleration(self, theta: Array, rate: Array, a: Array) -> Array:
        """Theta'' [rad/s^2]; 0 where the block rests."""
        rests = theta == 0
        side = np.where(rests, -np.sign(a), np.sign(theta))
        tilt = np.abs(theta)
        sine, cosine = np.sin(tilt), np.cos(tilt)
        width = np.where(side > 0, self._right, self._left)
        x = width * cosine - self._height * sine
        z = width * sine + self._height * cosine + self._radius
        out = -self._per_moment * (side * GRAVITY * x + a * z)
        out -= self._drag * rate + self._rolling * np.tanh(rate / 0.02)
        if rests.any():
            out[rests & ~self.lifts(a)] = 0.0
        return np.asarray(out, dtype=np.float64)
