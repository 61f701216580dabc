"""Scores: a key opened once, verdicts against it, baselines and leaks beside them."""
