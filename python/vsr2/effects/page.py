"""The page of the library, `docs/effects.md`, written from the effects themselves."""

from __future__ import annotations

import csv
import inspect
import math
import textwrap
from collections.abc import Iterator

from vsr2.effects.effect import STAGES, Effect
from vsr2.effects.parameter import Parameter
from vsr2.effects.registry import BUILT_IN, in_order

HEAD = """\
# Effects that a simulation may lack

Written by `vsr2.effects.page.page_markdown()` from the library; a test keeps both equal.

A rigid block under the recorded motion is not the experiment: edges are round, tables pitch, rocks
wear. The library holds such effects, each as mechanics, with parameters, a prior, and checks.

```yaml
rock: {shape: box, size: [0.4, 0.6, 1.2], density: 2700}
motion: {mode: single_cosine, pga: 0.5, pgv_pga: 0.1}
effects:
  edge_rounding: {radius: 0.006}
  inertia: {rule: aabb}
```

`vsr2 effects list` prints all, `vsr2 effects show NAME` one. A parameter that is not given has its
null value, without effect. A value outside the prior is warned of, one outside what can be
simulated refused. In Python:

```python
from vsr2 import apply_effects, load_study, run_batch
from vsr2.simulation import study_trials

trials = study_trials(load_study("configs/grid.yaml"))
changed = apply_effects(trials, {"wear": {"loss": 0.1}}, sessions=["1"] * len(trials))
result = run_batch(changed)
```

`simulate_campaign(study, effects=...)` simulates campaigns with effects; the motions it writes are
those that were asked for, so that the effect does not show in them. Hashes, journals and provenance
cover effects.

## Rules

- Neutral: a trial in which an effect is null is the same object as without it.
- Order: {stages}; within a stage as `vsr2 effects list` prints them. So a table's pitch follows the
  motion after gain and filters, and a rock worn and rounded is rounded first.
- Chance: what a trial draws (`placement`, `outcome_rule`) depends on the seed, the effect's name
  and the trial's place alone. With the same seed other values use the same draws.
- Scenes: trials that end up with equal bodies share one native scene. `wear` has {wear} steps.
- Motions beside x (`transverse`, `vertical`, `pitch`) and `table_pitch` need `motion.drive:
  prescribed`; a motion that pitches and `table_pitch` exclude each other.

## Three checks

`vsr2 effects check` runs them on the library, `vsr2 effects check FILE.py` on one's own effects;
`--mesh FILE` takes a rock of one's own for the scan.

- Neutral: the trajectory at the null value is that without the effect, to the last bit.
- Alive: at the end of the prior that is far from null some feature of the response (log of the
  largest tilt, yaw, slip, outcome) changes by more than three times its noise floor, on a block and
  on a rock with the irregular hull of a scan, both under three pulses that make them rock and one
  that makes them slide. The floor is measured: what moving the start by 10 micrometres and 10
  microradians does; and at least 1 % of the largest tilt, 0.5 mrad of yaw, 0.1 mm of slip.
- Right: the closed forms, conservation laws or independent computations of the effect's own
  `verify` are met. `vsr2 effects check NAME` prints them, with what was measured and expected.

In `tests/python/test_effects_library.py` they are `test_neutral`, `test_alive` (on the block and on
`models/pbr_scan.obj`) and `test_right`, each run for each effect; `pytest -k NAME` picks one.
`studies/effect_checks.py` measured this table (`docs/results/effects/checks.csv` has more digits):

{checks}

"Other end" is the end of the prior near null, where that is not null itself. An effect may be dead
there, as a contact ten times as stiff is on these rocks, or a cap that the table does not reach.
"Fast" is the greatest difference of the tilt between the engines `exact` and `fast` over the first
0.3 s of shaking [rad], "shift" the mean difference of log10(largest tilt) over 24 trials, `fast`
less `exact`, with its standard error; both on the block and on the scan. A scan on three points is
chaotic: there differences of rounding may grow within 0.3 s, and shifts come from trials that went
apart.

## What is one effect

With phi = tilt / alpha the planar equation of rocking holds the motion only as a / (g tan alpha).
So `table_gain` and `slenderness` are one effect but for the frequency parameter, which a lower mass
centre changes by a quarter as much. A stiff `table_pitch` far heavier than the rock acts like a
gain of 1 + k, k = c (1 + w^2 / p^2), under a sine: in proportion to the acceleration. The default
table is not: the block of 778 kg swings along with it (last column of the table). Measured
(`studies/effect_equivalences.py`, `docs/results/effects/equivalences.csv`; tests
`test_table_gain_and_slenderness_are_one_effect` and `test_stiff_pitch_is_a_gain`):

![equivalences](results/effects/equivalences.png)

## One's own effect

One class with a hook, `change`, which gets a `Setup` (bodies, contact, mechanisms, motion, start)
and gives a changed one; `at` where order, session or chance come in; `observe` for rules of what is
written down; `verify` for its closed forms. This is `docs/examples/soft_pad.py`:

```python
{example}```

Other packages announce theirs by the entry-point group `vsr2.effects`:

```toml
[project.entry-points."vsr2.effects"]
soft_pad = "my_package.pads:SoftPad"
```

In a program, `vsr2.effects.register(SoftPad)` adds it.

## The library

Figures show a block of 0.4 m x 0.6 m x 1.2 m with the values in their titles (the far end of the
prior, or less where then nothing rocks): its tilt under one cosine pulse, and the overturning
diagram, one trial a cell. `python studies/figure_effects.py` writes them and
`docs/results/effects/thresholds.csv`, in about 95 s on one core.
"""


def page_markdown(example: str, checks: str) -> str:
    """The text of `docs/effects.md`.

    Args:
        example: source of the documented example.
        checks: `docs/results/effects/checks.csv`.
    """
    from vsr2.effects.order import WEAR_STEPS

    head = HEAD.replace("{stages}", ", ".join(STAGES)).replace("{wear}", str(WEAR_STEPS))
    parts = [head.replace("{example}", example).replace("{checks}", _checks_table(checks))]
    for effect in in_order({effect.name: effect for effect in BUILT_IN}):
        parts += _section(effect)
    return "\n".join(parts)


def _checks_table(text: str) -> str:
    rows = csv.DictReader(line for line in text.splitlines() if not line.startswith("#"))
    out = [
        "| effect | neutral | alive, block | alive, scan | other end | right | fast | shift |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for row in rows:
        ends = [row[f"other_end_{rock}"] for rock in _ROCKS]
        cells = [f"`{row['effect']}`", "yes" if row["neutral"] == "true" else "NO"]
        cells += [f"{row[f'alive_{rock}']} ({row[f'feature_{rock}']})" for rock in _ROCKS]
        cells += [", ".join(ends) if all(ends) else "", row["right"]]
        if row["fast"] == "yes":
            cells.append(", ".join(row[f"early_{rock}_rad"] for rock in _ROCKS))
            shifts = (f"{row[f'shift_{r}']} +- {row[f'shift_error_{r}']}" for r in _ROCKS)
            cells.append(", ".join(shifts))
        else:
            cells += ["not taken", ""]
        out.append("| " + " | ".join(cells) + " |")
    return "\n".join(out)


_ROCKS = ("block", "scan")


def _section(effect: Effect) -> Iterator[str]:
    yield f"### `{effect.name}`\n"
    details = (inspect.getdoc(type(effect)) or "").partition("\n\n")[2]
    yield _wrapped(f"{effect.meaning}. {details}") + "\n"
    yield "| parameter | unit | prior | none given | meaning |"
    yield "| --- | --- | --- | --- | --- |"
    for parameter in effect.parameters:
        if not parameter.name.startswith(_OTHERS):
            yield _row(parameter)
    confounded = ", ".join(f"`{name}`" for name in effect.confounded_with) or "nothing listed"
    touched = ", ".join(effect.channels)
    facts = f"Stage {effect.stage}. Touches {touched}. Confounded with {confounded}."
    yield "\n" + _wrapped(f"{facts} Source: {effect.source}.") + "\n"
    yield f"![{effect.name}](results/effects/{effect.name}.png)\n"


def _wrapped(text: str) -> str:
    return textwrap.fill(" ".join(text.split()), 99, break_long_words=False)


# Of `change_point`, which repeats the parameters of all geometric effects.
_OTHERS = ("com_offset_", "edge_rounding_", "base_asperity_", "base_slope_")


def _row(parameter: Parameter) -> str:
    null = "as in the study" if math.isnan(parameter.null) else f"{parameter.null:g}"
    if parameter.choices:
        null = parameter.choices[int(parameter.null)]
    unit = "" if parameter.unit == "1" else parameter.unit
    prior = parameter.range_text
    if parameter.prior == "fixed" and not parameter.choices:
        prior = "fixed"
    cells = (f"`{parameter.name}`", unit, prior, null, parameter.meaning)
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
