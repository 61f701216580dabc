"""WHICH effect causes it: both routes together, calibrated, and what is unknown."""
