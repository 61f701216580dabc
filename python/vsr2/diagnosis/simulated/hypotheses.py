"""What may be the cause of a gap, and what is uncertain and not to be diagnosed."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

from vsr2.diagnosis.simulated.nuisances import DEFAULT_NUISANCES, Nuisance
from vsr2.effects import Effect, effect
from vsr2.effects import library as known_effects
from vsr2.errors import DiagnosisError


@dataclass(frozen=True)
class Hypotheses:
    """What a campaign is diagnosed against.

    Attributes:
        library: effects that may be the cause; None: all that are registered.
        exclude: names of effects left out.
        priors: lower and upper end of other priors, by `effect.parameter`, in its unit.
        nuisances: what is uncertain about the set-up.

    Raises:
        DiagnosisError: an unknown name in `exclude`.
        EffectError: an unknown effect or parameter in `priors`, or ends that it cannot have.
    """

    library: Mapping[str, Effect] | None = None
    exclude: Collection[str] = ()
    priors: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    nuisances: Sequence[Nuisance] = DEFAULT_NUISANCES

    @property
    def offered(self) -> dict[str, Effect]:
        """The effects, with their priors, but those left out."""
        out = dict(known_effects() if self.library is None else self.library)
        for key, (lower, upper) in self.priors.items():
            name, _, parameter = key.partition(".")
            own = out[name] if name in out else effect(name)
            out[name] = own.with_prior(parameter, lower, upper)
        unknown = sorted(set(self.exclude) - set(out))
        if unknown:
            raise DiagnosisError(
                f"exclude: there is no effect {unknown[0]!r}; there are {', '.join(out)}"
            )
        return {name: one for name, one in out.items() if name not in self.exclude}
