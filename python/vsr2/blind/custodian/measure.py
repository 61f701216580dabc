"""What the custodian measures before it draws: amplitudes, floors and signals, kept in a file."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from vsr2.blind.custodian.design import Protocol, overturning_pga
from vsr2.blind.custodian.floor import DETECTED, Floor, FloorMeter
from vsr2.blind.custodian.plan import Effects
from vsr2.blind.custodian.shake import Drawable, Engine
from vsr2.blind.form.seal import read_json, write_json
from vsr2.blind.form.settings import PackSettings
from vsr2.blind.mujoco import GroundMotion

Say = Callable[[str], None]


class Measures:
    """Measures of a pack, each made once: a run that was killed finds in the file what it had.

    Args:
        file: that keeps them, readable by its owner alone.
        engines: by name.
        settings: of the pack.
        seed: of all measuring.
        say: gets a line for each measure.
    """

    def __init__(
        self,
        file: Path,
        engines: Mapping[str, Engine],
        settings: PackSettings,
        seed: int,
        say: Say,
    ) -> None:
        self._file = file
        self._engines = engines
        self._settings = settings
        self._seed = seed
        self._say = say
        self._known = read_json(file) if file.exists() else {}
        self._meters: dict[tuple[str, int], FloorMeter] = {}

    def thresholds(self, engine: str, motions: Sequence[GroundMotion]) -> list[float]:
        """Overturning PGA of each motion on an engine [m/s^2]."""
        if "overturning_pga" not in self._known:
            self._say(f"{engine}: amplitudes of {len(motions)} motions")
            found = [overturning_pga(self._engines[engine], motion) for motion in motions]
            self._known["overturning_pga"] = found
            self._keep()
        return [float(pga) for pga in self._known["overturning_pga"]]

    def floors(
        self, effects: Effects, protocols: Sequence[Protocol]
    ) -> dict[tuple[str, str, int], Floor]:
        """Of each engine, effect and side of its null, on the first protocol."""
        stored = self._known.setdefault("floors", {})
        out = {}
        for engine in effects:
            for effect in effects[engine].values():
                for sign in effect.strength.reach():
                    label = f"{engine} {effect.name} {sign:+d}"
                    if label not in stored:
                        floor = self._meter(engine, 0, protocols).floor(effect, sign)
                        finite = math.isfinite(floor.magnitude)
                        stored[label] = {
                            "magnitude": floor.magnitude if finite else None,
                            "signal": [list(pair) for pair in floor.signal],
                        }
                        self._keep()
                        self._say(f"floor of {label}: {floor.magnitude:.3g}")
                    entry = stored[label]
                    magnitude = math.inf if entry["magnitude"] is None else entry["magnitude"]
                    pairs = tuple((float(m), float(s)) for m, s in entry["signal"])
                    out[engine, effect.name, sign] = Floor(magnitude, pairs)
        return out

    def relative(
        self,
        protocols: Sequence[Protocol],
        engine: str,
        protocol: int,
        effect: Drawable,
        values: Mapping[str, float],
    ) -> float:
        """Signal over noise of drawn values over that at the floor, on a campaign's protocol."""
        stored = self._known.setdefault("relative", {})
        label = f"{engine} {protocol} {effect.name} {json.dumps(values, sort_keys=True)}"
        if label not in stored:
            meter = self._meter(engine, protocol, protocols)
            stored[label] = meter.signal(effect.name, values) / DETECTED
            self._keep()
            self._say(f"signals of {len(stored)} draws measured")
        return float(stored[label])

    def _meter(self, engine: str, protocol: int, protocols: Sequence[Protocol]) -> FloorMeter:
        place = (engine, protocol)
        if place not in self._meters:
            self._meters[place] = FloorMeter(
                self._engines[engine], protocols[protocol], self._settings, self._seed
            )
        return self._meters[place]

    def _keep(self) -> None:
        write_json(self._file, self._known, private=True)
