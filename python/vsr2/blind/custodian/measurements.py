"""What the custodian measures before it draws."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from functools import cache

from vsr2.blind.custodian.design import Protocol
from vsr2.blind.custodian.detection_limit import RULES, SignalMeter
from vsr2.blind.custodian.engine import PackEngine
from vsr2.blind.custodian.steps import LIMIT, NUMBER, Steps
from vsr2.blind.form.events import EventCode, Say
from vsr2.blind.form.pack_settings import PackSettings
from vsr2.blind.mujoco import Drawable
from vsr2.codes import Statement


class Measurements:
    """Detection limits, and signals of what is drawn.

    Args:
        steps: that keep them.
        engines: by name.
        protocols: of the pack.
        settings: of the pack.
        seed: of all measuring.
        say: gets an event for each measurement.
    """

    def __init__(
        self,
        steps: Steps,
        engines: Mapping[str, PackEngine],
        protocols: Sequence[Protocol],
        settings: PackSettings,
        seed: int,
        say: Say,
    ) -> None:
        self._steps = steps
        self._say = say
        self._meter = cache(
            lambda engine, protocol: SignalMeter(
                engines[engine], protocols[protocol], settings, seed
            )
        )

    def limit(self, engine: str, effect: Drawable, sign: int, near: float = math.inf) -> float:
        """Of an effect on one side of its null, on the first protocol; infinity: there is none.

        `near`: magnitude to try first.
        """
        label = f"{engine} {effect.name} {sign:+d}"

        def measured() -> float | None:
            found = self._meter(engine, 0).limit(effect, sign, near)
            of = {"engine": engine, "effect": effect.name, "sign": sign}
            self._say(Statement.of(EventCode.DETECTION_LIMIT, **of, limit=found))
            return found if math.isfinite(found) else None

        found = self._steps.once(f"detection limit of {label}", measured, LIMIT)
        return math.inf if found is None else float(found)

    def relative(
        self, engine: str, protocol: int, effect: Drawable, values: Mapping[str, float]
    ) -> float:
        """Signal of drawn values over that at the detection limit, on a campaign's protocol."""

        def measured() -> float:
            self._say(Statement.of(EventCode.SIGNAL, engine=engine, effect=effect.name))
            return self._meter(engine, protocol).signal(effect.name, values) / RULES.detected

        drawn = f"{engine} {protocol} {effect.name} {json.dumps(values, sort_keys=True)}"
        return float(self._steps.once(f"signal of {drawn}", measured, NUMBER))
