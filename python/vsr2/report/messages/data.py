"""Sentences about what campaigns and models hold."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any


def campaign_text(summary: Mapping[str, Any]) -> str:
    """Counts and ranges of :func:`vsr2.campaign.campaign_summary`, one a line."""
    tier = {"B": "outcomes", "M": "outcomes and largest tilt", "T": "outcomes and series"}
    lines = [
        f"{summary['name']}: {summary['description'] or 'no description'}",
        f"tier           {summary['tier']} ({tier[summary['tier']]})",
        f"trials         {summary['trials']}: {summary['overturned']} overturned, "
        f"{summary['standing']} not, {summary['outcome_unknown']} unknown",
        f"motions        {summary['ground_motions']} ground motions, "
        f"{summary['motion_files']} files for {summary['with_motion']} trials",
        f"largest tilt   {summary['with_peak_tilt']} trials",
        f"series         {summary['with_series']} trials",
        f"sessions       {summary['sessions']}",
    ]
    for key, specimen in summary["specimens"].items():
        mass = "mass unknown" if specimen["mass_kg"] is None else f"{specimen['mass_kg']:g} kg"
        model = "no model" if specimen["model_file"] is None else "with model"
        lines.append(f"specimen       {key}: {specimen['trials']} trials, {mass}, {model}")
    for label, key, unit in (("PGA", "pga_m_s2", "m/s^2"), ("PGV/PGA", "pgv_pga_s", "s")):
        span = summary[key]
        shown = "unknown" if span is None else f"{span[0]:.4g} to {span[1]:.4g} {unit}"
        lines.append(f"{label:<14} {shown}")
    if summary["extra_columns"]:
        lines.append(f"extra columns  {', '.join(summary['extra_columns'])}")
    for note, count in summary["notes"].items():
        lines.append(f"note           {note!r}: {count} trials")
    return "\n".join(lines)


def campaign_checked(folder: object, problems: int) -> str:
    """How much is wrong with a campaign's files."""
    return f"{folder}: {problems or 'no'} problem{'s' * (problems != 1)}"


def inertia_text(summary: Mapping[str, Any]) -> str:
    """Mass properties, stable poses and slenderness of :func:`vsr2.scene.inertia_summary`."""

    def row(values: Sequence[float], form: str = ".6g") -> str:
        return ", ".join(format(value, form) for value in values)

    lines = [
        summary["file"],
        f"  sha256          {summary['sha256']}",
        f"  mesh            {summary['vertices']} vertices, {summary['faces']} faces, "
        f"{summary['hull_vertices']} on the convex hull",
        f"  extents         {row(summary['extents_m'])} m",
    ]
    if summary["volume_m3"] is not None:
        lines += [
            f"  volume          {summary['volume_m3']:.6g} m^3 "
            f"({summary['volume_m3'] / summary['hull_volume_m3']:.1%} of its convex hull)",
            f"  density         {summary['density_kg_m3']:.6g} kg/m^3"
            + (" (assumed; give --density or --mass)" if summary["density_assumed"] else ""),
        ]
    lines += [
        f"  mass            {summary['mass_kg']:.6g} kg",
        f"  mass centre     {row(summary['mass_center_m'])} m (model frame)",
        f"  inertia         {row(summary['principal_inertia_kg_m2'])} kg m^2 (principal, about "
        "the mass centre)",
        "  principal axes  (columns, in the model frame)",
        *(f"                  {row(line, '9.6f')}" for line in summary["principal_axes"]),
        f"  bounding box    {row(summary['bounding_box_inertia_kg_m2'])} kg m^2 "
        "(the rule `inertia: aabb`, margins left out)",
        *(f"  note: {note}" for note in summary["notes"]),
        "",
        "Stable poses on a horizontal plane, most probable first",
        "  probability  height of mass centre [m]  smallest slenderness [rad] at [deg]  "
        "orientation x, y, z, w",
    ]
    lines += [
        f"  {pose['probability']:11.3f}  {pose['height']:25.4f}  "
        f"{pose['min_slenderness']:26.4f} {pose['weakest_azimuth']:8.1f}  "
        f"{row(pose['orientation'], '.6f')}"
        for pose in summary["stable_poses"]
    ]
    where = (
        "in the given orientation"
        if summary["slenderness_as_given"]
        else "in the stable pose nearest to upright"
    )
    lines += [
        "",
        f"Slenderness by azimuth (anticlockwise from x) {where}, orientation "
        f"{row(summary['slenderness_orientation'], '.6f')}",
        "  azimuth [deg]  alpha [rad]  g tan(alpha) [g]  distance [m]   R [m]  p [rad/s]",
    ]
    lines += [
        f"  {item['azimuth']:13.1f}  {item['alpha']:11.4f}  {math.tan(item['alpha']):16.4f}  "
        f"{item['distance']:12.4f}  {item['radius']:6.4f}  {item['frequency_parameter']:9.4f}"
        for item in summary["slenderness"]
    ]
    if not summary["slenderness"]:
        lines.append("  stands in none of the poses: the mass centre is outside every support")
    return "\n".join(lines)
