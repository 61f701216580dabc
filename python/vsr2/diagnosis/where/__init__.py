"""WHERE the gap lies: locations whose residuals are too large for campaigns without effect."""
