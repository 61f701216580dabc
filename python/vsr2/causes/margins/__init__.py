"""Which causes act, by overturning margins: a likelihood of a campaign's outcomes."""
