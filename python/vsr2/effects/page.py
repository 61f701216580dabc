"""The page of the library, `docs/reference/effects.md`, written from the effects themselves."""

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
"Channels" says where an effect acts first; a rock that rocks otherwise slides and turns otherwise,
too.

```yaml
rock: {shape: box, size: [0.4, 0.6, 1.2], density: 2700}
motion: {mode: single_cosine, pga: 0.5, pgv_pga: 0.1}
effects:
  edge_rounding: {radius: 0.006}
  inertia: {rule: aabb}
```

`vsr2 effects list` prints all, `vsr2 effects show NAME` one. A parameter that is not given has its
null value, without effect; one with only parameters that do nothing on their own (`table_pitch:
{frequency: 8}`) is refused. A value outside the prior is warned of, one outside what can be
simulated refused, and an order effect that reaches no trial is warned of. In Python:

```python
from vsr2 import apply_effects, load_study, run_batch
from vsr2.simulation import study_trials

trials = study_trials(load_study("configs/grid.yaml"))
changed = apply_effects(trials, {"wear": {"loss": 0.1}}, sessions=["1"] * len(trials))
result = run_batch(changed)
```

`simulate_campaign(study, effects=...)` simulates campaigns with effects; the motions it writes are
those that were asked for, so that the effect does not show in them. Hashes, journals and provenance
cover effects; a parameter that was not given and whose null value is no finite number is `null`
there.

## Rules

- Neutral: a trial in which an effect is null is the same object as without it.
- Order: {stages}; within a stage as `vsr2 effects list` prints them. So a table's pitch follows the
  motion after gain and filters, and a rock worn and rounded is rounded first. `input_filter` comes
  first of those on the motion: the channel is chosen, then filtered, then `time_scale` acts. A
  channel of a motion that an earlier `apply_effects` has filtered or resampled is refused. Filters
  and caps act on the motion along x alone.
- On a slope (`base_slope`) heights, base and mass centre are told in the frame of the pedestal's
  top, and the joint of `table_pitch` lies as deep below the rock as it does under a level top.
- Chance: what a trial draws (`placement`, `outcome_rule`) depends on the seed, the effect's name
  and the trial's place alone. With the same seed other values use the same draws.
- Scenes: trials that end up with equal bodies share one native scene. `wear` has {wear} steps.
- Motions beside x (`transverse`, `vertical`, `pitch`) and `table_pitch` need `motion.drive:
  prescribed`; a motion that pitches and `table_pitch` exclude each other.

## Three checks

`vsr2 effects check` runs them on the library, `vsr2 effects check FILE.py` on one's own effects;
`--mesh FILE` takes a rock of one's own for the scan.

- Neutral: the trajectory at the null value is that without the effect, to the last bit; and 1e-8
  of the prior beside null no feature of the response changes by more than twice its noise floor,
  so that the null value is the right one. Exempt are effects that declare a `jump`, with the
  reason, and those whose null value has no value beside it ("as in the study").
- Alive: at the end of the prior that is far from null the distribution of some feature of the
  response (log of the largest tilt, yaw, slip, outcome) changes by more than three times its
  noise floor under one motion at least, on a block and on a rock with the irregular hull of a
  scan. Both are shaken at 2 Hz and 3 Hz by pulses that just lift them and by pulses 5 % below and
  above the least that overturns most draws (found by halving, up to 12 times uplift, where none
  overturns before), and by one under which they slide. The distance of two distributions is the
  mean difference of their quantiles; 3 draws on the block, 32 on a scan. The floor is that of two
  samples without the effect. A draw moves the start by 10 micrometres and 10 microradians along
  and about all axes, and each point of a hull by 10 micrometres: a hull's contacts depend on the
  order of its points, which any change of shape may turn. The floor is at least 2 % of the
  largest tilt, 2 mrad of yaw, 0.3 mm of slip, a tenth of the outcomes. A test holds rocks whose
  hulls alone are perturbed anew below the bound. A draw that does not come to rest before the
  motion is left out; where half do not, the check fails. Trials go on for 30 s after the motion,
  so that the rock is at rest in the end; on the scan it counts as at rest before the motion below
  4 times the default speeds.
- Right: the closed forms, conservation laws or independent computations of the effect's own
  `verify` are met. `vsr2 effects check NAME` prints them, with what was measured and expected.

In `tests/python/test_effects_library.py` they are `test_neutral`, `test_alive` (on the block and on
`models/pbr_scan.obj`) and `test_right`, each run for each effect; `pytest -k NAME` picks one.
`studies/effect_checks.py` measured this table (`docs/results/effects/checks.csv` has more digits):

{checks}

"Step" is the change 1e-8 of the prior beside null, over the floor, "alive" that at the end of the
prior far from null, "other end" that at the end near null, where that is not null itself; of a
prior on both sides of null (-0.15 to 0.15) it is simply the other sign. So an effect's upper end
stands in one of the two. An effect may be dead at the
other end, as a contact ten times as stiff is on these rocks, or a cap that the table does not
reach.
{dead}
"Fast" is the greatest difference of the tilt between the engines `exact` and `fast` over the first
0.3 s of shaking [rad], "shift" the mean difference of log10(largest tilt) over 42 trials, `fast`
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

![equivalences](../results/effects/equivalences.png)

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
diagram, one trial a cell. For `spin_friction`, `placement` and `off_axis_motion` the block stands
at 30 degrees; effects that show where the rock slides have a pulse of their own.
`python studies/figure_effects.py` writes them and `docs/results/effects/thresholds.csv`, in about
two minutes on one core. What each costs a step is in
`docs/results/mechanism_cost.txt`.
"""


def page_markdown(example: str, checks: str) -> str:
    """The text of `docs/reference/effects.md`.

    Args:
        example: source of the documented example.
        checks: `docs/results/effects/checks.csv`.
    """
    from vsr2.effects.order import WEAR_STEPS

    head = HEAD.replace("{stages}", ", ".join(STAGES)).replace("{wear}", str(WEAR_STEPS))
    head = head.replace("{dead}\n", textwrap.fill(_not_alive(checks), 100) + "\n")
    parts = [head.replace("{example}", example).replace("{checks}", _checks_table(checks))]
    for effect in in_order({effect.name: effect for effect in BUILT_IN}):
        parts += _section(effect)
    return "\n".join(parts)


def _rows(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))


def _not_alive(text: str) -> str:
    """What the table says of effects that fail to be alive."""
    found = [
        f"`{row['effect']}` on the {rock} ({row[f'alive_{rock}']})"
        for row in _rows(text)
        for rock in _ROCKS
        if float(row[f"alive_{rock}"]) <= 3.0
    ]
    if not found:
        return "No effect fails."
    return f"Not alive, hardly told from chance: {', '.join(found)}."


def _checks_table(text: str) -> str:
    rows = _rows(text)
    out = [
        "| effect | neutral | step | alive, block | alive, scan | other end | right | fast "
        "| shift |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for row in rows:
        ends = [row[f"other_end_{rock}"] for rock in _ROCKS]
        cells = [f"`{row['effect']}`", "yes" if row["neutral"] == "true" else "NO"]
        steps = [row[f"step_{rock}"] for rock in _ROCKS]
        cells.append(steps[0] if steps[0] in ("jump", "none") else ", ".join(steps))
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
    jump = f" Jumps beside null: {effect.jump}." if effect.jump else ""
    yield _wrapped(f"{effect.meaning}. {details}{jump}") + "\n"
    yield "| parameter | unit | prior | none given | meaning |"
    yield "| --- | --- | --- | --- | --- |"
    for parameter in effect.parameters:
        if not parameter.name.startswith(_OTHERS):
            yield _row(parameter)
    confounded = ", ".join(f"`{name}`" for name in effect.confounded_with) or "nothing listed"
    touched = ", ".join(effect.channels)
    facts = f"Stage {effect.stage}. Touches {touched}. Confounded with {confounded}."
    yield "\n" + _wrapped(f"{facts} Source: {effect.source}.") + "\n"
    yield f"![{effect.name}](../results/effects/{effect.name}.png)\n"


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
