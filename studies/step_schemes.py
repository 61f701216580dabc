"""Compare ways to step a rocking block: what each costs in truth at a longer time step.

    python studies/step_schemes.py [--ways NAME ...] [--steps-ms MS ...]

The block of configs/block_grid.yaml stands squarely on the table and moves in one plane. It has its
two lower corners, the springs, dampers and rebounds of contacts of `fast`, and friction that never
slips. Single cosines over the grid of that study shake it. Its margin is the logarithm of the least
factor on a motion at which it overturns. In the plane a way to step is some lines, so that several
can be tried:

as_is     as `fast` does: a corner is a contact once it was found in the table, until it is REACH
          above it, and velocities are those in the middle between two places.
midpoint  places move by the mean of old and new velocity.
short     a step in which a corner comes down is taken again in SHORT short ones.
split     such a step is split where the corner touches, and so is what weight does in it.
landing   a corner that comes down is no contact until it is found in the table. Then the block's
          place becomes that of an impact at the time when it touched.

Each is compared with `as_is` at LEAST_MS. Prints a row a way and step: the change of the margin
with its standard error. Before it, blocks are let go from rest on an edge: by how much they come
upright later than a pivoted block, and the energy that their first impacts leave, over Housner's.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

LEAST_MS = 0.125
WIDTH, HEIGHT, DENSITY = 0.25, 1.0, 2700 * 0.5
GRAVITY = 9.81
STIFFNESS, DAMPING = 1.3e9, 2e7
"""Of a contact between two bodies with the default values [N/m], [N s/m]."""
REBOUND, REBOUND_FROM = 0.35**2, 0.2
"""Coefficient of restitution of the pair, and the speed from which it counts [m/s]."""
SLOP, REACH = 1e-5, 0.0115
"""Allowance before a distance counts; distance at which a contact is forgotten [m]."""
LANDS_FROM = 0.01
"""Speed from which a corner comes down, not one of a block at rest [m/s]."""
SHORT = 8
PGA = np.arange(0.2, 0.701, 0.05) * 9.80665
RATIO = np.arange(0.06, 0.201, 0.02)
"""PGV/PGA [s]."""
REACH_OF_MARGIN, SECTIONS = 1.0, 12
"""Margins are sought between minus and plus this; each of two passes divides the range so often."""
FREE = 3.0
"""Time after the motion that a block is watched for [s]."""
TILTS, UPRIGHT, WATCHED, IMPACTS = tuple(0.25 + 0.1 * i / 31 for i in range(32)), 0.002, 2.0, 3
"""Of blocks that are let go: tilts over that of the diagonal; tilt at which their time is taken
[rad]; time that they are watched for [s]; impacts."""
OVER = 1.2
"""Tilt from which it has overturned [rad]."""

MASS = DENSITY * WIDTH * HEIGHT
INERTIA = MASS / 12 * (WIDTH**2 + HEIGHT**2)
CORNERS = np.array([[-WIDTH / 2], [WIDTH / 2]])


@dataclass
class Blocks:
    """Many blocks: centre (x, z) [m], turn [rad] about y, their rates; arrays of one shape.

    Attributes:
        place: x, z, turn, shape (3, blocks).
        speed: their rates, shape (3, blocks).
        press: impulse of the latest step on each corner [N s], shape (2, blocks).
        known: whether each corner is a contact, shape (2, blocks).
        drift: length of the latest move [s], shape (blocks,).
    """

    place: Array
    speed: Array
    press: Array
    known: Bools
    drift: Array

    def some(self, which: NDArray[np.intp]) -> Blocks:
        """Those of an index."""
        return Blocks(*(np.array(value[..., which]) for value in vars(self).values()))

    def put(self, which: NDArray[np.intp], of: Blocks) -> None:
        """Replace those of an index."""
        for name, value in vars(of).items():
            getattr(self, name)[..., which] = value

    def corners(self) -> tuple[Array, Array, Array]:
        """From the centre to each corner along x and z, and its height over the table."""
        sine, cosine = np.sin(self.place[2]), np.cos(self.place[2])
        x = cosine * CORNERS - sine * HEIGHT / 2
        z = -sine * CORNERS - cosine * HEIGHT / 2
        return x, z, self.place[1] + z

    def move(self, time: Array | float) -> None:
        """At the present speed."""
        self.place += time * self.speed
        self.drift = np.broadcast_to(time, self.drift.shape).copy()


def push(b: Blocks, use: Bools, height: Array, table: Array, weight: Array, step: Array) -> None:
    """Give blocks the velocity after a step: weight, and contacts that stick.

    Args:
        b: blocks; their speed and press change.
        use: corners that are contacts.
        height: of corners, as the contacts take it [m].
        table: its velocity [m/s].
        weight: time for which weight acts [s].
        step: time until the next places [s].
    """
    x, z, _ = b.corners()
    vx, vz, w = b.speed
    vz = vz - GRAVITY * weight
    resistance = step * STIFFNESS + DAMPING
    soft = 1 / (resistance * np.maximum(weight, 1e-9))
    approach = vz - w * x
    gap = height + SLOP
    want = np.where(gap > 0, -gap / step, -gap * STIFFNESS / resistance)
    want += np.where(approach <= -REBOUND_FROM, -REBOUND * approach, 0.0)
    speed, press = np.stack([vx, vz, w]), np.zeros_like(b.press)
    undecided = use.any(axis=0)
    for bears in ((True, True), (True, False), (False, True)):
        i = 0 if bears[0] else 1
        low = z.mean(axis=0) if all(bears) else z[i]
        inertia = INERTIA + MASS * low**2
        stuck = (INERTIA * w + MASS * low * (table - vx)) / inertia
        lack = want - (vz - stuck * x)
        own = 1 / MASS + x**2 / inertia + soft
        impulse = np.zeros_like(press)
        if all(bears):
            both = 1 / MASS + x[0] * x[1] / inertia
            over = own[0] * own[1] - both**2
            impulse = (own[::-1] * lack - both * lack[::-1]) / over
        else:
            impulse[i] = lack[i] / own[i]
        turn = stuck - (impulse * x).sum(axis=0) / inertia
        rise = vz + impulse.sum(axis=0) / MASS
        good = undecided.copy()
        for k, bearing in enumerate(bears):
            if bearing:
                good &= use[k] & (impulse[k] > 0)
            else:
                good &= ~use[k] | (rise - turn * x[k] >= want[k] - 1e-12)
        speed = np.where(good, np.stack([table - turn * low, rise, turn]), speed)
        press = np.where(good, impulse, press)
        undecided &= ~good
    b.speed, b.press = speed, press


def find_contacts(b: Blocks) -> Array:
    """Keep and add contacts; returns heights of corners."""
    height = b.corners()[2]
    b.known = (b.known & (height <= REACH)) | (height <= 0)
    return height


def coming_down(b: Blocks, after: Blocks, before: Array) -> Bools:
    """Corners that were above the table and are in it after a step, shape (2, blocks)."""
    return (before > 0) & (after.corners()[2] <= 0)


def as_is(b: Blocks, table: Array, dt: float) -> None:
    """A step of `fast`."""
    full = np.full(b.drift.shape, dt)
    height = find_contacts(b)
    push(b, b.known, height, table, full, full)
    b.move(dt)


def midpoint(b: Blocks, table: Array, dt: float) -> None:
    """The same with places that move by the mean of both velocities."""
    place, speed = b.place.copy(), b.speed.copy()
    as_is(b, table, dt)
    b.place = place + 0.5 * dt * (speed + b.speed)


def short(b: Blocks, table: Array, dt: float) -> None:
    """Where a corner comes down in a step, short ones."""
    before, height = replace(b, place=b.place.copy()), b.corners()[2]
    as_is(b, table, dt)
    which = np.flatnonzero(coming_down(before, b, height).any(axis=0))
    if which.size:
        again = before.some(which)
        for _ in range(SHORT):
            as_is(again, table[which], dt / SHORT)
        b.put(which, again)


def split(b: Blocks, table: Array, dt: float, left: Array | None = None, depth: int = 4) -> None:
    """Where a corner comes down in a step, one until it touches and one after."""
    left = np.full(b.drift.shape, dt) if left is None else left
    height = b.corners()[2]
    b.known &= (b.press > 0) | (height <= 2 * SLOP)
    before = replace(b, place=b.place.copy())
    push(b, b.known, height, table, 0.5 * (b.drift + left), left)
    b.move(left)
    lower = b.corners()[2]
    hits = ~b.known & (lower < 0)
    which = np.flatnonzero(hits.any(axis=0))
    if not which.size or depth == 0:
        return
    passed = np.where(hits, height - lower, 1.0)
    part = np.where(hits, height / passed, 2.0)[:, which].clip(1e-9)
    first, corner = part.min(axis=0).clip(None, 1 - 1e-9), part.argmin(axis=0)
    again, still, moves = before.some(which), left[which], table[which]
    until = first * still
    push(again, again.known, height[:, which], moves, 0.5 * (again.drift + until), until)
    again.move(until)
    push(again, again.known, again.corners()[2], moves, 0.5 * until, until)
    again.drift[:] = 0.0
    again.known[corner, np.arange(which.size)] = True
    split(again, moves, dt, still - until, depth - 1)
    b.put(which, again)


def landing(b: Blocks, table: Array, dt: float) -> None:
    """A step that puts a block that came down where it would be after an impact in time."""
    full = np.full(b.drift.shape, dt)
    height = find_contacts(b)
    x = b.corners()[0]
    approach = b.speed[2] * x - b.speed[1]
    down = b.known & ~(b.press > 0) & (approach > LANDS_FROM)
    lands = down & (height <= 0)
    ago = np.where(lands, np.minimum(dt, -height / np.maximum(approach, LANDS_FROM)), 0.0)
    speed = b.speed.copy()
    push(b, b.known & ~(down & ~lands), np.where(lands, -SLOP, height), table, full, full)
    b.place += ago.max(axis=0) * (b.speed - speed)
    b.move(dt)


WAYS: dict[str, Callable[[Blocks, Array, float], None]] = {
    "as_is": as_is,
    "midpoint": midpoint,
    "short": short,
    "split": split,
    "landing": landing,
}


def let_go(way: str, dt: float) -> tuple[float, list[float]]:
    """Time by which blocks on an edge are late when upright [s]; energy left over Housner's.

    The mean over blocks. Energy is that of the largest tilts before and after an impact; Housner
    (1963) has (1 - 3/2 sin^2 alpha)^2 of it left.
    """
    alpha, size = math.atan2(WIDTH, HEIGHT), 0.5 * math.hypot(WIDTH, HEIGHT)
    tilt = np.array(TILTS) * alpha
    place = np.zeros((3, tilt.size))
    place[1], place[2] = size * np.cos(alpha - tilt) - SLOP, tilt
    bears = np.array([[False], [True]]) & np.ones(tilt.size, dtype=bool)
    b = Blocks(place, np.zeros_like(place), bears.astype(np.float64), bears, np.full(tilt.size, dt))
    path = [tilt]
    for _ in range(math.ceil(WATCHED / dt)):
        WAYS[way](b, np.zeros(tilt.size), dt)
        path.append(b.place[2].copy())
    # A velocity is that in the middle of a step: the rest was half a step before the first place.
    turns, late, left = np.array(path), [], []
    pull = MASS * GRAVITY * size / (INERTIA + MASS * size**2)
    for start, turn in zip(tilt, turns.T, strict=True):
        u = np.linspace(0, 1, 20001)[:-1] + 0.5 / 20000
        fallen = (start - UPRIGHT) * u**2
        rate = np.sqrt(2 * pull * (math.cos(alpha - start) - np.cos(alpha - start + fallen)))
        exact = float((2 * (start - UPRIGHT) * u / rate).mean())
        k = int(np.argmax(turn <= UPRIGHT))
        crossing = k - (turn[k] - UPRIGHT) / (turn[k] - turn[k - 1])
        late.append((crossing + 0.5) * dt - exact)
        ends = np.flatnonzero(np.diff(np.sign(turn))) + 1
        peaks = [start, *(np.abs(part).max() for part in np.split(turn, ends)[1 : IMPACTS + 1])]
        energy = np.cos(alpha - np.array(peaks)) - math.cos(alpha)
        left.append(energy[1:] / energy[:-1] / (1 - 1.5 * math.sin(alpha) ** 2) ** 2)
    return float(np.mean(late)), np.mean(left, axis=0).tolist()


def overturns(way: str, pga: Array, ratio: Array, dt: float) -> Bools:
    """Whether each block overturns under its cosine."""
    count, fell = pga.size, np.zeros(pga.size, dtype=bool)
    sunk = MASS * GRAVITY / (2 * STIFFNESS) + SLOP
    place = np.zeros((3, count))
    place[1] = HEIGHT / 2 - sunk
    b = Blocks(
        place,
        np.zeros((3, count)),
        np.ones((2, count)),
        np.ones((2, count), dtype=bool),
        np.full(count, dt),
    )
    still, begun = np.arange(count), np.zeros(count)
    steps = math.ceil((2 * math.pi * ratio.max() + FREE) / dt)
    for k in range(1, steps + 1):
        phase = np.minimum(k * dt / ratio[still], 2 * math.pi)
        ended = pga[still] * ratio[still] ** 2 * (1 - np.cos(phase))
        WAYS[way](b, (ended - begun) / dt, dt)
        begun = ended
        if k % 50 == 0:
            over = np.abs(b.place[2]) > OVER
            done = over | (k * dt > 2 * math.pi * ratio[still] + FREE)
            fell[still[over]] = True
            kept = np.flatnonzero(~done)
            b, still, begun = b.some(kept), still[kept], begun[kept]
            if not kept.size:
                break
    return fell


def margins(way: str, dt: float) -> Array:
    """Of all motions, NaN where none lies in the range."""
    pga, ratio = (part.ravel() for part in np.meshgrid(PGA, RATIO, indexing="ij"))
    low, high = np.full(pga.size, -REACH_OF_MARGIN), np.full(pga.size, REACH_OF_MARGIN)
    for _ in range(2):
        logs = low + (high - low) * np.arange(1, SECTIONS + 1)[:, None] / SECTIONS
        fell = overturns(
            way, (pga * np.exp(logs)).ravel(), np.broadcast_to(ratio, logs.shape).ravel(), dt
        ).reshape(logs.shape)
        first = np.where(fell.any(axis=0), fell.argmax(axis=0), SECTIONS - 1)
        wide = (high - low) / SECTIONS
        low, high = low + wide * first, low + wide * (first + 1)
    found = 0.5 * (low + high)
    return np.where(np.abs(found) > 0.99 * REACH_OF_MARGIN, np.nan, found)


def main() -> None:
    """Print a row a way and step."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ways", nargs="+", default=list(WAYS), choices=list(WAYS))
    parser.add_argument("--steps-ms", nargs="+", type=float, default=[1.0, 2.0, 4.0])
    options = parser.parse_args()
    for way in options.ways:
        for step in options.steps_ms:
            late, left = let_go(way, 1e-3 * step)
            shares = " ".join(f"{share:.3f}" for share in left)
            print(f"{way:9s} {step:5g} ms  late by {1e3 * late:+.3f} ms  left {shares}", flush=True)
    truth = margins("as_is", 1e-3 * LEAST_MS)
    for way in options.ways:
        for step in options.steps_ms:
            change = margins(way, 1e-3 * step) - truth
            change = change[np.isfinite(change)]
            error = change.std(ddof=1) / math.sqrt(change.size)
            print(
                f"{way:9s} {step:5g} ms  {change.size} motions  {change.mean():+.4f} ({error:.4f})",
                flush=True,
            )


if __name__ == "__main__":
    main()
