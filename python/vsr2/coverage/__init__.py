"""Whether the posterior of a finished diagnosis holds what it states, on planted campaigns."""

from vsr2.coverage.posterior_check import PosteriorCheck, check_posterior

__all__ = ["PosteriorCheck", "check_posterior"]
