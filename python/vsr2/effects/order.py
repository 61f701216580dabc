"""Effects that come in over a campaign."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from vsr2.effects import geometry
from vsr2.effects.effect import Circumstances, Effect, effects_in
from vsr2.effects.geometry import SlendernessEffect
from vsr2.effects.parameter import Parameter
from vsr2.effects.static import STATIC
from vsr2.errors import ConfigError
from vsr2.trial import Trial


@dataclass(frozen=True)
class OrderConstants:
    """What changes over a campaign; chosen by hand.

    Attributes:
        wear_steps: wear advances in this many equal steps, so that trials share scenes.
        marked_yaw: ends of the turn of a rock that is put back by its marks [degree].
    """

    wear_steps: int = 32
    marked_yaw: tuple[float, float] = (-30.0, 30.0)


ORDER = OrderConstants()


class Wear(Effect):
    """Slenderness lost with every trial.

    The loss is that of `slenderness`. Order is 0 at the first trial and 1 at the last.
    """

    name = "wear"
    meaning = (
        "Edges wear: tan(alpha) falls in proportion to the order of execution, by `loss` at the "
        f"end, in {ORDER.wear_steps} equal steps"
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
        worn = round(circumstances.order * ORDER.wear_steps) / ORDER.wear_steps
        return {"loss": values["loss"] * worn}

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        return SlendernessEffect().change(trial, {"change": -values["loss"]})


class StepEffect(Effect):
    """Base of effects that bring in others at one point of a campaign.

    The step comes between the two sessions that lie nearest to `at`, all sessions counted as
    equally long; with one session only, between two trials.
    """

    stage = "order"

    def at(self, values: Mapping[str, float], circumstances: Circumstances) -> Mapping[str, float]:
        sessions = circumstances.sessions
        if len(sessions) < 2:
            after = circumstances.order >= values["at"]
        else:
            first = min(max(1, round(values["at"] * len(sessions))), len(sessions) - 1)
            after = sessions.index(circumstances.session) >= first
        return values if after else self.null()

    def _joined(self, first: Mapping[str, float], second: Mapping[str, float]) -> dict[str, float]:
        if first["at"] != second["at"]:
            raise ConfigError(
                f"no step does what one at {first['at']:g} and one at {second['at']:g} do",
                key=f"effects.{self.name}.at",
            )
        found = self.null() | {"at": first["at"]}
        acting = [dict(self.acting_parts(values)) for values in (first, second)]
        for part in self.parts:
            own = [parts[part] for parts in acting if part in parts]
            if own:
                both = part.twice(*own) if len(own) > 1 else own[0]
                found |= {f"{part.name}_{name}": value for name, value in both.items()}
        return found


def _place_in_time(lower: float, upper: float) -> Parameter:
    return Parameter(
        "at", "1", 0.5, lower, upper, "uniform",
        "where the change lies among the sessions, counted as equally long, 0 to 1; with one "
        "session, among the trials",
        limits=(0.0, 1.0), secondary=True,
    )  # fmt: skip


def _of_parts(
    parts: Sequence[Effect], drawn: Mapping[str, tuple[float, float] | None]
) -> tuple[Parameter, ...]:
    """Parameters of all parts under names of both.

    Args:
        parts: effects.
        drawn: names of those with a prior, and its ends where they are not the part's own; the
            others are fixed.
    """
    found = []
    for effect in parts:
        for parameter in effect.parameters:
            name = f"{effect.name}_{parameter.name}"
            lower, upper = drawn.get(name) or (parameter.lower, parameter.upper)
            found.append(
                replace(
                    parameter,
                    name=name,
                    prior=parameter.prior if name in drawn else "fixed",
                    lower=lower,
                    upper=upper,
                    meaning=f"`{parameter.name}` of `{effect.name}` after the change",
                    full_range=parameter.full_range and drawn.get(name, ()) is None,
                )
            )
    return tuple(found)


def _adds_to_itself(effect: Effect) -> bool:
    """Whether a step of an effect acts on top of what it does in all trials."""
    return not effect.once and all(parameter.twice != "later" for parameter in effect.parameters)


class ChangePoint(StepEffect):
    """A step of the geometry between two sessions.

    Takes the parameters of all geometric effects but `registration` and `support`, under the names
    of both; only the change of slenderness is drawn from a prior. The change comes between the two
    sessions that lie nearest to `at`, all sessions counted as equally long; with one session only,
    between two trials.
    """

    name = "change_point"
    meaning = "From one session on the geometry is another: an edge broke, a base was repaired"
    parts = tuple(effects_in(geometry))
    parameters = (
        _place_in_time(0.1, 0.9),
        *_of_parts(parts, {"slenderness_change": (-0.15, 0.15)}),
    )
    channels = ("tilt",)
    confounded_with = ("wear",)
    source = "this library: damage between sessions"
    rank = 1


class Session(StepEffect):
    """A step of what holds for a whole session, from one of them on.

    The step comes before the session that the data choose, as a change point does, all sessions
    being counted as equally long; with one session only, between two trials. What steps is what a
    pause may change. The specimen is put back turned beside its marks, or upon another part of its
    base. A surface is cleaned or dusty. The table is tuned or calibrated again. These have a prior.
    A study may step other effects that are the same in all trials, too: takes their parameters,
    under the names of both (`rolling_resistance_arm`), each at its own place in the order of
    application. What cannot act twice does not step, nor does an effect of which the later value
    holds (`restitution`, `friction_rate`, `input_channel`).
    """

    name = "session"
    meaning = (
        "From one session on the specimen stands otherwise, or friction or the table are others"
    )
    parts = tuple(filter(_adds_to_itself, STATIC))
    parameters = (
        _place_in_time(0.0, 1.0),
        *_of_parts(
            parts,
            {
                "registration_yaw": ORDER.marked_yaw,
                "registration_lean": None,
                "registration_lean_azimuth": None,
                "friction_factor": None,
                "table_gain_change": None,
            },
        ),
    )
    channels = ("tilt", "yaw", "slip", "motion")
    confounded_with = ("change_point", "wear")
    source = "this library: what a pause in a campaign may change"
    rank = 2
