"""The verdict, what to measure next, and both as data."""
