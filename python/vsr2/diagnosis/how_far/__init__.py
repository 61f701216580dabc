"""HOW FAR the gap shrinks on motions that neither the fit nor the choice saw."""
