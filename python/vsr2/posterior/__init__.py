"""WHICH: one posterior over sets of effects, learned from simulated campaigns and calibrated."""

from vsr2.posterior.training import Found, Posterior, train

__all__ = ["Found", "Posterior", "train"]
