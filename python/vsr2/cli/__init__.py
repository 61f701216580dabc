"""The command line `vsr2`."""
