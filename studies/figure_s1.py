"""Supplement Fig. S1: commanded and actual pedestal position, for a cosine and for a recording.

    python studies/figure_s1.py [--out docs/results/figure_s1.png]

Both are driven by the joint motor as the supplement's S1.3 has it: position and velocity reference
for the cosine, position only for the recording. Embedded data, a few seconds.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from vsr2.config import load_study
from vsr2.report import tracking_figure
from vsr2.simulation import run_batch

ROOT = Path(__file__).resolve().parent.parent


def main() -> None:
    """Run one trial of each kind and write the figure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "results" / "figure_s1.png")
    options = parser.parse_args()
    cosine = load_study(
        ROOT / "configs" / "block.yaml",
        overrides=["preset=original", "output.contacts_every=0", "motion.pga_g=0.3"],
    )
    recording = load_study(
        ROOT / "configs" / "demo.yaml",
        overrides=[
            "preset=original",
            "motion.drive=motor",
            "motion.pattern=synthetic_07.csv",
            "output.log_every=1",
        ],
    )
    logs = {
        "(a) cosine, position and velocity reference": run_batch(cosine).log(0),
        "(b) recording, position reference": run_batch(recording).log(0),
    }
    options.out.parent.mkdir(parents=True, exist_ok=True)
    tracking_figure(logs).savefig(options.out, dpi=100)
    print(f"wrote {options.out}")


if __name__ == "__main__":
    main()
