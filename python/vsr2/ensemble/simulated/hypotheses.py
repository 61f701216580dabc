"""What may be the cause of a gap, and what is uncertain and not to be diagnosed."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from vsr2.argument_names import checked_names
from vsr2.campaign import Campaign
from vsr2.effects import Effect, effect
from vsr2.effects import library as known_effects
from vsr2.ensemble.simulated.contact_family import CONTACT_FAMILY
from vsr2.ensemble.simulated.distributions import Distribution, LogUniform, Normal, Uniform
from vsr2.ensemble.simulated.nuisance_rules import assert_together
from vsr2.ensemble.simulated.nuisances import DEFAULT_NUISANCES, Nuisance
from vsr2.errors import ConfigError, DiagnosisError
from vsr2.near_words import offer
from vsr2.one_line import OnlyGiven


@dataclass(frozen=True)
class HypothesisConstants:
    """Bounds of what is asked; chosen by hand.

    Attributes:
        most_effects: that may act together: all sets of so many are hypotheses, some 40,000 of 30
            effects.
        usual_effects: as many, where nothing else is asked for: a single cause is the usual case,
            and a pair the next.
    """

    most_effects: int = 4
    usual_effects: int = 2


HYPOTHESIS = HypothesisConstants()


@checked_names(DiagnosisError)
@dataclass(frozen=True, repr=False)
class Hypotheses(OnlyGiven):
    """What a campaign is diagnosed against.

    Attributes:
        library: effects that may be the cause; None: all that are registered.
        exclude: names of effects that are not looked for. They are simulated all the same, so that
            diagnoses of several campaigns share simulations whatever each leaves out. Campaigns in
            which they act are kept from the training, as if nobody knew of them.
        priors: other priors, by `effect.parameter`: a distribution, or the lower and upper end of
            one of the parameter's own shape, in its unit.
        nuisances: what is uncertain about the set-up.
        contact_family: by what two correct simulators of the scene differ: drawn as nuisances are.
        references: campaigns of the same trials that are known to have no effect.
        most_effects: that may act together, 1 to 4. More need more simulated campaigns.

    Raises:
        DiagnosisError: an unknown name in `exclude`, a number of effects outside its range, a
            prior that is none of a magnitude, or nuisances that cannot stand together: two of one
            effect, parameter and scope, one that would replace another or act twice where its
            effect cannot, or one that does nothing on its own.
        ConfigError: an unknown effect or parameter in `priors`, or ends that it cannot have.
    """

    library: Mapping[str, Effect] | None = None
    exclude: Collection[str] = ()
    priors: Mapping[str, Distribution | tuple[float, float]] = field(default_factory=dict)
    # By factories, so that help and signatures do not print all that they hold.
    nuisances: Sequence[Nuisance] = field(default_factory=lambda: DEFAULT_NUISANCES)
    contact_family: Sequence[Nuisance] = field(default_factory=lambda: CONTACT_FAMILY)
    references: Sequence[Campaign] = ()
    most_effects: int = HYPOTHESIS.usual_effects

    def __post_init__(self) -> None:
        if not 1 <= self.most_effects <= HYPOTHESIS.most_effects:
            raise DiagnosisError(
                f"most_effects is {self.most_effects}; give a number from 1 to "
                f"{HYPOTHESIS.most_effects}"
            )
        assert_together((*self.nuisances, *self.contact_family))

    @property
    def ends(self) -> dict[str, list[float]]:
        """Lower and upper end of each of the priors, by `effect.parameter`."""
        return {key: list(_ends(key, prior)[:2]) for key, prior in sorted(self.priors.items())}

    @property
    def offered(self) -> dict[str, Effect]:
        """The effects, with their priors, those left out among them."""
        out = dict(known_effects() if self.library is None else self.library)
        for key, prior in self.priors.items():
            name, _, parameter = key.partition(".")
            lower, upper, shape = _ends(key, prior)
            try:
                own = out[name] if name in out else effect(name)
                out[name] = own.with_prior(parameter, lower, upper, shape)
            except ConfigError as error:
                raise ConfigError(error.message, key=f"priors.{key}") from None
        unknown = sorted(set(self.exclude) - set(out))
        if unknown:
            raise DiagnosisError(
                f"exclude: there is no effect {unknown[0]!r}; {offer(unknown[0], list(out))}"
            )
        return out


def _ends(
    key: str, prior: Distribution | tuple[float, float]
) -> tuple[float, float, Literal["uniform", "loguniform", "normal"] | None]:
    """Ends of a prior and its shape; a normal one is cut at two standard deviations."""
    match prior:
        case Uniform(low, high):
            return low, high, "uniform"
        case LogUniform(low, high):
            return low, high, "loguniform"
        case Normal(sd, _, mean):
            return mean - 2 * sd, mean + 2 * sd, "normal"
        case (lower, upper):
            return lower, upper, None
    raise DiagnosisError(f"prior of {key}: {prior}; give uniform, loguniform or normal")
