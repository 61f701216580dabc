"""A diagnosis for people: a few lines of text, and one self-contained page."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import Any

from vsr2.diagnosis import Diagnosis
from vsr2.diagnosis.verdict.document import PAGE_FILE, PAGE_TITLE
from vsr2.report.diagnosis_figures import (
    bars_figure,
    channels_figure,
    map_figure,
    order_figure,
    posterior_figure,
    reliability_figure,
)
from vsr2.report.messages import (
    channels_note,
    closure_note,
    instrument,
    interval,
    location,
    next_measurement,
    plain,
    sentence,
    verdict_sentence,
    with_sentences,
)
from vsr2.results.atomic import write_atomic

_LEVEL = 0.05

_FIGURES = """
:root{color-scheme:light;--ink:#1c2430;--soft:#5b6675;--line:#dde2e8;--a:#1f6f8b;--b:#c8553d}
svg text{font:12px system-ui,sans-serif;fill:var(--ink)}
svg .tick{fill:var(--soft);font-size:11px}svg .label{fill:var(--soft)}.grid{stroke:#edf0f3}
"""
_STYLE = """
*{box-sizing:border-box}body{margin:0;font:16px/1.55 system-ui,sans-serif;color:var(--ink);
background:#f6f7f9}main{max-width:1120px;margin:0 auto;padding:1.2rem}
h1{font-size:1.15rem;color:var(--soft);font-weight:600;margin:.3rem 0}
h2{font-size:1.15rem;margin:.1rem 0 .5rem}
section,.verdict{background:#fff;border:1px solid var(--line);border-radius:10px;
padding:1rem 1.2rem;margin:0 0 1rem}
.verdict p.big{font-size:1.5rem;line-height:1.3;font-weight:650;margin:.2rem 0 .6rem}
.two{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,430px),1fr));gap:0 1rem}
svg{width:100%;height:auto;display:block}
p.note{color:var(--soft);font-size:.92rem;margin:.4rem 0 0}.wide{overflow-x:auto}
table{border-collapse:collapse;width:100%;font-size:.93rem}th,td{text-align:left;padding:.3rem .6rem
.3rem 0;border-bottom:1px solid var(--line);vertical-align:top}th{color:var(--soft);font-weight:600}
td.n{font-variant-numeric:tabular-nums;white-space:nowrap}li{margin:.15rem 0}
.key span{display:inline-block;margin-right:1.1rem}.key i{display:inline-block;width:.8em;
height:.8em;border-radius:50%;margin-right:.35em}details pre{white-space:pre-wrap;font-size:.8rem;
overflow-wrap:anywhere}
"""


def format_diagnosis(found: Diagnosis) -> str:
    """The verdict, the gap and the leading effects, for a terminal."""
    content = found.content
    gap = content["gap"]
    lines = [
        f"{content['campaign']['name']}: {content['campaign']['trials']} trials, "
        f"tier {content['campaign']['tier']}",
        verdict_sentence(content),
        f"loss a trial: before {interval(gap['before'])}, after {interval(gap['after'])}, "
        f"floor {interval(gap['floor'])}",
        f"closure {interval(gap['closure'])}, of a wrong effect "
        f"{interval(content['negative_control']['closure'])}, headline "
        f"{interval(gap['headline'])}; re-simulated {interval(gap['closure_resimulated'])}",
    ]
    lines.append("probability, effect, its parameters: most probable, mean [95 %]")
    for row in content["effects"][:6]:
        values = ", ".join(_parameter(name, p) for name, p in row["parameters"].items())
        lines.append(f"  {row['probability']:5.2f}  {row['name']:<20} {values}")
    if content["next_measurement"]:
        lines.append(f"next: {next_measurement(content['next_measurement'])}")
    lines += [f"limit: {sentence(limit)}" for limit in content["limits"]]
    return "\n".join(lines)


def _parameter(name: str, found: Mapping[str, Any]) -> str:
    """Most probable value, mean, interval."""
    low, high = found["ci95"]
    unit = "" if found["unit"] == "1" else f" {found['unit']}"
    return f"{name} {found['mode']:.3g}, {found['mean']:.3g} [{low:.3g}, {high:.3g}]{unit}"


def figure_file(figure: str) -> str:
    """A figure of the page as a file of its own: an SVG image with the page's style."""
    opening = '<svg xmlns="http://www.w3.org/2000/svg" '
    whole = re.sub(r"<title>.*?</title>", "", figure).replace("<svg ", opening, 1)
    return whole.replace(">", f"><style>{_FIGURES}</style>", 1) + "\n"


def write_diagnosis_page(found: Diagnosis, folder: str | Path) -> Path:
    """Write the page, and beside it the tables and `diagnosis.json` with its sentences.

    Raises:
        ResultError: a file cannot be written.
    """
    replace(found, content=with_sentences(found.content)).save(folder)
    path = Path(folder) / PAGE_FILE
    data = diagnosis_page(found).encode()
    write_atomic(path, lambda file: file.write(data))
    return path


def diagnosis_page(found: Diagnosis) -> str:
    """One HTML page that needs no other file and no network."""
    content = found.content
    title = f"{PAGE_TITLE} {content['campaign']['name']}"
    campaign = content["campaign"]
    sessions = f"{campaign['sessions']} session{'' if campaign['sessions'] == 1 else 's'}"
    body = [
        f"<h1>{escape(title)}: {campaign['trials']} trials of {campaign['motions']} motions in "
        f"{sessions}, tier {campaign['tier']}</h1>",
        _verdict(content),
        '<div class="two">',
        _card(
            "Which effect",
            posterior_figure(content),
            "Probability of each hypothesis. Effects of one colour cannot be told apart by this "
            "campaign; hollow bars lie outside the 90 % set.",
        ),
        _card(
            "How far the gap shrinks",
            bars_figure(content),
            "Mean loss a trial on motions that neither fit nor choice saw, with 95 % intervals "
            "over motions. The negative control is the best effect of a wrong class; recalibration "
            "rescales the probabilities without any physics. " + closure_note(content),
        ),
        _card(
            "Where: the conditions",
            map_figure(found.trials),
            "One mark a trial. Filled: overturned, ring: stood. Red: the model without effects was "
            "surprised (loss more than 0.3 nat above the floor), grey: it was not; the larger, the "
            "more.",
        ),
        _card(
            "Where: the order of execution",
            order_figure(found.trials),
            "Observed minus predicted outcome of each uncertain trial, and the mean of each "
            "session. A trend or a step speaks for wear or a change of the set-up.",
        ),
        _card(
            "Where: channels and phases",
            channels_figure(content),
            "Mean residual over all trials of each number that the tier knows, against the model "
            "without effects. Filled: significant once all locations are accounted for. "
            + channels_note(content),
        ),
        _card(
            "Predicted against observed",
            reliability_figure(found.trials),
            "Share overturned among trials with similar predictions, before and after; on the "
            "diagonal the prediction is right.",
        ),
        _next(content),
        "</div>",
        _where_table(content["where"]),
        _effects_table(content["effects"]),
        _noise_floor(content["gap"]["layers"]),
        _limits([sentence(limit) for limit in content["limits"]]),
        _provenance(content),
    ]
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8"><meta name="viewport" '
        f'content="width=device-width,initial-scale=1"><title>{escape(title)}</title><style>'
        f"{_FIGURES}{_STYLE}</style></head><body><main>{''.join(body)}</main></body></html>\n"
    )


def _verdict(content: Mapping[str, Any]) -> str:
    reasons = "".join(
        f"<li>{escape(sentence(reason))}</li>" for reason in content["verdict"]["reasons"]
    )
    names = ", ".join(content["conformal_set_90"])
    return (
        f'<div class="verdict"><p class="big">{escape(verdict_sentence(content))}</p>'
        f'<ul>{reasons}</ul><p class="note">90 % set: {escape(names)}.</p></div>'
    )


def _card(title: str, figure: str, note: str) -> str:
    return f'<section><h2>{escape(title)}</h2>{figure}<p class="note">{escape(note)}</p></section>'


def _next(content: Mapping[str, Any]) -> str:
    measure = content["next_measurement"]
    found = [row for row in content["where"] if row["p_familywise"] <= _LEVEL]
    if not measure and found:
        text = f"<p>What stands out: {escape(plain(location(found[0])))}.</p>"
    elif not measure:
        text = "<p>Nothing: there is no gap to explain.</p>"
    else:
        what = next_measurement(measure)
        text = f"<p>{escape(what[:1].upper() + what[1:])}.</p>"
        if measure["repetition"]:
            repeats = measure["repetition"]["repeats"]
            often = (
                "no number of repeats"
                if repeats is None
                else f"about {repeats} repeat{'' if repeats == 1 else 's'}"
            )
            text += (
                '<p class="note">Without new instruments: repeat trial '
                f"{escape(measure['repetition']['trial'])}, where "
                f"{escape(' and '.join(measure['splits']))} differ most; {often} would separate "
                "them.</p>"
            )
        text += _others(measure)
    return f"<section><h2>What to measure next</h2>{text}</section>"


def _others(measure: Mapping[str, Any]) -> str:
    """What separates the leader from the further members of a class."""
    rows = "".join(
        f"<tr><td>{escape(plain(row['name']))}</td><td>{escape(instrument(row['instrument']))}</td>"
        f"<td>{escape(row['repetition']['trial'])}</td>"
        f"<td>{row['repetition']['repeats'] or 'no number'}</td></tr>"
        for row in measure["others"]
    )
    if not rows:
        return ""
    leader = escape(plain(measure["splits"][0]))
    return (
        f"<div class='wide'><table><thead><tr><th>{leader} or</th><th>measure</th>"
        f"<th>or repeat trial</th><th>times</th></tr></thead><tbody>{rows}</tbody></table></div>"
    )


def _where_table(rows: Sequence[Mapping[str, Any]]) -> str:
    shown = [row for row in rows if row["p_familywise"] <= _LEVEL] or list(rows[:5])
    found = any(row["p_familywise"] <= _LEVEL for row in rows)
    lead = (
        "Locations whose residuals are larger than chance, noise and nuisances allow, corrected "
        "for all locations that were looked at."
        if found
        else "No location stands out once all that were looked at are accounted for; the five "
        "largest are:"
    )
    body = "".join(
        f"<tr><td>{escape(location(row))}</td><td>{escape(row['axis'])}</td>"
        f"<td>{escape(row['channel'])}, {escape(row['phase'])}</td>"
        f'<td class="n">{row["effect_size"]:+.2f}</td><td class="n">{row["p_familywise"]:.3f}</td>'
        "</tr>"
        for row in shown
    )
    return (
        f"<section><h2>Where: locations, phases and channels</h2><p>{lead}</p>"
        "<div class='wide'><table><tr><th>location</th><th>axis</th>"
        "<th>channel, phase</th>"
        "<th>effect size (above 0: more than predicted)</th>"
        f"<th>family-wise p</th></tr>{body}</table></div></section>"
    )


def _effects_table(rows: Sequence[Mapping[str, Any]]) -> str:
    body = ""
    for row in rows:
        values = "<br>".join(escape(_parameter(name, p)) for name, p in row["parameters"].items())
        body += (
            f"<tr><td>{escape(row['name'])}</td><td class='n'>{row['probability']:.3f}</td>"
            f"<td>{escape(row['class'])}</td><td class='n'>{values}</td>"
            f"<td class='n'>{interval(row['closure'])}</td></tr>"
        )
    return (
        "<section><h2>All effects</h2><div class='wide'><table><tr><th>effect</th>"
        "<th>probability</th><th>class of</th>"
        "<th>parameters if it is the cause: most probable, mean [95 %]</th>"
        f"<th>closure</th></tr>{body}</table></div></section>"
    )


def _limits(texts: Sequence[str]) -> str:
    items = "".join(f"<li>{escape(text)}</li>" for text in texts)
    return f"<section><h2>What these data cannot support</h2><ul>{items}</ul></section>"


_LAYERS = {
    "numerical": "starts moved by 1e-6 to 1e-4 m and rad",
    "time_step": "half the time step",
    "solver": "twice the solver's iterations",
    "input": "fresh placement and motion noise",
    "nuisance": "fresh geometry, contact and the like",
    "physical": "repeats in the campaign",
}


def _noise_floor(layers: Mapping[str, Any]) -> str:
    known = [
        f"<li>{escape(words)}: {layers[name]:.1%}</li>"
        for name, words in _LAYERS.items()
        if layers.get(name) is not None
    ]
    return (
        "<section><h2>Noise floor</h2><p>Share of uncertain trials' outcomes that change although "
        f"nothing of substance does, with:</p><ul>{''.join(known)}</ul></section>"
    )


def _provenance(content: Mapping[str, Any]) -> str:
    import json

    from vsr2.diagnosis.verdict.document import finite

    text = json.dumps(finite(dict(content["provenance"])), indent=1)
    return (
        "<section><details><summary>Provenance</summary>"
        f"<pre>{escape(text)}</pre></details></section>"
    )
