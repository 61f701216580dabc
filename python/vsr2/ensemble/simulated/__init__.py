"""The same campaign simulated: effects, simulators, which draws are run, and their cache."""
