"""`vsr2 --version`, which needs no command line: importing that takes most of a verb's start."""

import sys


def version() -> int:
    """Version, then build facts."""
    from vsr2._native import build_facts

    facts = build_facts()
    try:
        print(f"vsr2 {facts.pop('version')}")
        print("\n".join(f"{name}: {value}" for name, value in facts.items()))
        sys.stdout.flush()
    except BrokenPipeError:
        # The reader of our output went away, as in `vsr2 --version | true`.
        sys.stderr.close()
    return 0
