"""Sentences about results, each written once: runs, verdicts, and what the command line adds."""
