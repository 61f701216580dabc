"""Which effects act together in the laboratory's campaign on specimen SP1, by margins.

    vsr2 campaign import-lab SOURCE --out out/lab
    python studies/lab_several_causes.py [--scenes N] [--threads N] [--seed N]

Does what
`vsr2 campaign causes studies/lab_diagnosis.yaml out/lab --exclude base_slope --one-contact-model`
does: all effects but `base_slope` (in one class with `com_offset`, and ten times as dear as the
others when the committed figures were made; it no longer is) and one contact model (correct ones
differ by less than what is drawn here, and cost twice the time). No list of causes is written by
hand. A run that was interrupted is continued. Writes to OUT what the verb writes, and to
OUT/committed what may be committed: causes.json, causes.csv and the figure.
"""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

from vsr2.causes import find_causes
from vsr2.causes.causes import CAUSES_FILE, FIGURE, TABLE_FILE
from vsr2.causes.margins.simulated_scenes import SCENES
from vsr2.ensemble import Execution, Hypotheses
from vsr2.report.causes_figure import write_causes_figure
from vsr2.report.messages.found_causes import causes_text
from vsr2.report.messages.progress_lines import ProgressLines

HERE = Path(__file__).resolve().parent


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--campaign", type=Path, default=HERE.parent / "out" / "lab")
    parser.add_argument("--scene", type=Path, default=HERE / "lab_diagnosis.yaml")
    parser.add_argument("--out", type=Path, default=HERE.parent / "out" / "lab_several_causes")
    parser.add_argument("--scenes", type=int, default=SCENES.usual)
    parser.add_argument("--threads", type=int, default=None)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    found = find_causes(
        options.campaign,
        options.scene,
        out=options.out,
        scenes=options.scenes,
        hypotheses=Hypotheses(exclude=["base_slope"], contact_family=()),
        execution=Execution(options.threads, report=ProgressLines("several causes")),
        seed=options.seed,
    )
    print(causes_text(found))
    write_causes_figure(found, options.out)
    folder = options.out / "committed"
    folder.mkdir(exist_ok=True)
    for name in (CAUSES_FILE, TABLE_FILE, FIGURE):
        shutil.copy(options.out / name, folder / name)


if __name__ == "__main__":
    main()
