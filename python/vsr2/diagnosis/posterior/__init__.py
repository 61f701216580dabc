"""WHICH: one learned posterior over sets of effects."""
