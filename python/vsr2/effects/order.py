"""Effects that come in over a campaign."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from vsr2.effects import geometry
from vsr2.effects.effect import Circumstances, Effect, effects_in
from vsr2.effects.geometry import Slenderness
from vsr2.effects.parameter import Parameter
from vsr2.trial import Trial

WEAR_STEPS = 32
"""Wear advances in this many equal steps, so that trials share scenes."""


class Wear(Effect):
    """Slenderness lost with every trial.

    The loss is that of `slenderness`. Order is 0 at the first trial and 1 at the last.
    """

    name = "wear"
    meaning = (
        "Edges wear: tan(alpha) falls in proportion to the order of execution, by `loss` at the "
        f"end, in {WEAR_STEPS} equal steps"
    )
    parameters = (
        Parameter(
            "loss", "1", 0.0, 0.0, 0.15, "uniform", "of slenderness at the campaign's end",
            limits=(-0.5, 0.9), twice="loss",
        ),
    )  # fmt: skip
    channels = ("tilt",)
    confounded_with = ("change_point",)
    source = "this library: edges that chip in repeated tests, taken as linear in their order"
    stage = "order"

    def at(self, values: Mapping[str, float], circumstances: Circumstances) -> Mapping[str, float]:
        worn = round(circumstances.order * WEAR_STEPS) / WEAR_STEPS
        return {"loss": values["loss"] * worn}

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        return Slenderness().change(trial, {"change": -values["loss"]})


def _renamed() -> tuple[Parameter, ...]:
    """Parameters of all geometric effects under names of both."""
    found = []
    for effect in effects_in(geometry):
        for parameter in effect.parameters:
            drawn = (effect.name, parameter.name) == ("slenderness", "change")
            found.append(
                replace(
                    parameter,
                    name=f"{effect.name}_{parameter.name}",
                    prior=parameter.prior if drawn else "fixed",
                    lower=-0.15 if drawn else parameter.lower,
                    upper=0.15 if drawn else parameter.upper,
                    meaning=f"`{parameter.name}` of `{effect.name}` after the change",
                )
            )
    return tuple(found)


class ChangePoint(Effect):
    """A step of the geometry between two sessions.

    Takes the parameters of all geometric effects, under the names of both; only the change of
    slenderness is drawn from a prior. The change comes between the two sessions that lie nearest to
    `at`, all sessions counted as equally long; with one session only, between two trials.
    """

    name = "change_point"
    meaning = "From one session on the geometry is another: an edge broke, a base was repaired"
    parameters = (
        Parameter(
            "at", "1", 0.5, 0.1, 0.9, "uniform",
            "where the change lies among the sessions, counted as equally long, 0 to 1; with one "
            "session, among the trials",
            limits=(0.0, 1.0), secondary=True,
        ),
        *_renamed(),
    )  # fmt: skip
    channels = ("tilt",)
    confounded_with = ("wear",)
    source = "this library: damage between sessions"
    stage = "order"
    rank = 1

    def at(self, values: Mapping[str, float], circumstances: Circumstances) -> Mapping[str, float]:
        sessions = circumstances.sessions
        if len(sessions) < 2:
            after = circumstances.order >= values["at"]
        else:
            first = min(max(1, round(values["at"] * len(sessions))), len(sessions) - 1)
            after = sessions.index(circumstances.session) >= first
        return values if after else self.null()

    def _joined(self, first: Mapping[str, float], second: Mapping[str, float]) -> dict[str, float]:
        at = self.parameter("at")
        found = {"at": at.joined(first["at"], second["at"], f"effects.{self.name}.at")}
        for effect in effects_in(geometry):
            names = {p.name: f"{effect.name}_{p.name}" for p in effect.parameters}
            both = effect.twice(
                *({name: one[long] for name, long in names.items()} for one in (first, second))
            )
            found |= {names[name]: value for name, value in both.items()}
        return found

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        for effect in sorted(effects_in(geometry), key=lambda effect: effect.rank):
            own = {
                parameter.name: values[f"{effect.name}_{parameter.name}"]
                for parameter in effect.parameters
            }
            if not effect.is_null(own):
                trial = effect.change(trial, own)
        return trial
