"""What the custodian measures before it draws, kept in a file."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from vsr2.blind.custodian.design import Protocol, overturning_pga
from vsr2.blind.custodian.detection_limit import RULES, DetectionLimit, SignalMeter
from vsr2.blind.custodian.engine import Drawable, Engine
from vsr2.blind.custodian.plan import Effects
from vsr2.blind.form.pack_settings import PackSettings
from vsr2.blind.form.seal import read_json, write_json
from vsr2.blind.mujoco import GroundMotion

Say = Callable[[str], None]


class Measurements:
    """Measurements of a pack, each made once: a run that was killed finds in the file what it had.

    Args:
        file: that keeps them, readable by its owner alone.
        engines: by name.
        settings: of the pack.
        seed: of all measuring.
        say: gets a line for each measurement.
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
        self._meters: dict[tuple[str, int], SignalMeter] = {}

    def thresholds(self, engine: str, motions: Sequence[GroundMotion]) -> list[float]:
        """Overturning PGA of each motion on an engine [m/s^2]."""
        if "overturning_pga" not in self._known:
            self._say(f"{engine}: amplitudes of {len(motions)} motions")
            found = [overturning_pga(self._engines[engine], motion) for motion in motions]
            self._known["overturning_pga"] = found
            self._keep()
        return [float(pga) for pga in self._known["overturning_pga"]]

    def limits(
        self, effects: Effects, protocols: Sequence[Protocol]
    ) -> dict[tuple[str, str, int], DetectionLimit]:
        """Of each engine, effect and side of its null, on the first protocol."""
        stored = self._known.setdefault("detection_limits", {})
        out = {}
        for engine, name, sign in (
            (engine, name, sign)
            for engine, of in effects.items()
            for name, effect in of.items()
            for sign in effect.strength.reach()
        ):
            label = f"{engine} {name} {sign:+d}"
            if label not in stored:
                limit = self._meter(engine, 0, protocols).limit(effects[engine][name], sign)
                finite = math.isfinite(limit.magnitude)
                stored[label] = {
                    "magnitude": limit.magnitude if finite else None,
                    "signal": [list(pair) for pair in limit.signal],
                }
                self._keep()
                self._say(f"detection limit of {label}: {limit.magnitude:.3g}")
            entry = stored[label]
            magnitude = math.inf if entry["magnitude"] is None else entry["magnitude"]
            pairs = tuple((float(m), float(s)) for m, s in entry["signal"])
            out[engine, name, sign] = DetectionLimit(magnitude, pairs)
        return out

    def relative(
        self,
        protocols: Sequence[Protocol],
        engine: str,
        protocol: int,
        effect: Drawable,
        values: Mapping[str, float],
    ) -> float:
        """Signal of drawn values over that at the detection limit, on a campaign's protocol."""
        stored = self._known.setdefault("relative", {})
        label = f"{engine} {protocol} {effect.name} {json.dumps(values, sort_keys=True)}"
        if label not in stored:
            meter = self._meter(engine, protocol, protocols)
            stored[label] = meter.signal(effect.name, values) / RULES.detected
            self._keep()
            self._say(f"signals of {len(stored)} draws measured")
        return float(stored[label])

    def _meter(self, engine: str, protocol: int, protocols: Sequence[Protocol]) -> SignalMeter:
        key = (engine, protocol)
        if key not in self._meters:
            self._meters[key] = SignalMeter(
                self._engines[engine], protocols[protocol], self._settings, self._seed
            )
        return self._meters[key]

    def _keep(self) -> None:
        write_json(self._file, self._known, private=True)
