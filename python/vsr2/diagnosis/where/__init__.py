"""WHERE the gap lies: places whose residuals are too large for campaigns without effect."""
