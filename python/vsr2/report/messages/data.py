"""Sentences about what campaigns, models and motions hold."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vsr2.one_line import counted
from vsr2.report.messages.templates import check_worded, filled_in, written
from vsr2.scene import SceneNote
from vsr2.scene.notes import WARNINGS

if TYPE_CHECKING:
    from vsr2.motion import Motion
    from vsr2.motion.measures import IntensityMeasures

SCENE_NOTES: Mapping[str, str] = {
    SceneNote.MERGED_VERTICES: (
        "{file}: repair: merged {count} vertices closer than {tolerance:g} of the diagonal"
    ),
    SceneNote.REMOVED_FACES: "{file}: repair: removed {count} repeated or degenerate faces",
    SceneNote.REMOVED_PARTS: (
        "{file}: repair: removed {count} loose parts, {share:.2%} of the surface"
    ),
    SceneNote.FILLED_HOLES: (
        "{file}: repair: filled {holes} holes with {faces} faces (widest hole {widest:.3g} m)"
    ),
    SceneNote.FLIPPED_FACES: "{file}: repair: flipped {count} faces",
    SceneNote.REPAIRED_VOLUME: "{file}: repair: volume {before:.6g} -> {after:.6g} m^3",
    SceneNote.NOTHING_TO_REPAIR: "{file}: repair: nothing to do",
    SceneNote.SEVERAL_OBJECTS: (
        "{file}: {count} objects; the collision shape is the union of their convex hulls"
    ),
    SceneNote.CYLINDER_AS_PRISM: "{file}: cylinder approximated by a prism of {sides} sides",
    SceneNote.UNUSUAL_INERTIA: (
        "{file}: the file's principal moments ({moments} kg m^2) are {ratios} times those of the "
        "homogeneous solid ({solid} kg m^2); check the unit, or choose `inertia: mesh`"
    ),
    SceneNote.DISTANT_MASS_CENTER: (
        "{file}: the file's mass centre lies {distance:.3g} m from the homogeneous solid's; check "
        "<inertial><origin>"
    ),
    SceneNote.BESIDE_PEDESTAL: (
        "start: the mass centre at x {x:.4g} m, y {y:.4g} m is not above the pedestal"
    ),
    SceneNote.ABOVE_PEDESTAL: (
        "start: {height:.4g} m above the pedestal; the rock drops onto it first"
    ),
    SceneNote.INSIDE_PEDESTAL: (
        "start: {depth:.4g} m inside the pedestal; raise `position`, or use `mode: yaw`"
    ),
    **WARNINGS,
}
"""Templates of the values."""
check_worded(SceneNote, SCENE_NOTES, __name__)


def scene_note(note: Mapping[str, Any]) -> str:
    """What was changed of a body, or should be known, from its code and values."""
    return filled_in(SCENE_NOTES[note["code"]], note["values"])


def campaign_text(summary: Mapping[str, Any]) -> str:
    """Counts and ranges of :func:`vsr2.campaign.campaign_summary`, one a line."""
    tier = {"B": "outcomes", "M": "outcomes and largest tilt", "T": "outcomes and series"}
    lines = [
        f"{summary['name']}: {summary['description'] or 'no description'}",
        f"tier           {summary['tier']} ({tier[summary['tier']]})",
        f"trials         {summary['trials']}: {summary['overturned']} overturned, "
        f"{summary['standing']} not, {summary['outcome_unknown']} unknown",
        f"motions        {counted(summary['ground_motions'], 'ground motion')}, "
        f"{counted(summary['motion_files'], 'file')} for "
        f"{counted(summary['with_motion'], 'trial')}",
        f"largest tilt   {counted(summary['with_peak_tilt'], 'trial')}",
        f"series         {counted(summary['with_series'], 'trial')}",
        f"sessions       {summary['sessions']}",
    ]
    for key, specimen in summary["specimens"].items():
        mass = "mass unknown" if specimen["mass_kg"] is None else f"{specimen['mass_kg']:g} kg"
        model = "no model" if specimen["model_file"] is None else "with model"
        trials = counted(specimen["trials"], "trial")
        lines.append(f"specimen       {key}: {trials}, {mass}, {model}")
    for label, key, unit in (("PGA", "pga_g", "g"), ("PGV/PGA", "pgv_pga_s", "s")):
        span = summary[key]
        shown = "unknown" if span is None else f"{span[0]:.4g} to {span[1]:.4g} {unit}"
        lines.append(f"{label:<14} {shown}")
    if summary["extra_columns"]:
        lines.append(f"extra columns  {', '.join(summary['extra_columns'])}")
    for note, count in summary["notes"].items():
        lines.append(f"note           {note!r}: {counted(count, 'trial')}")
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
        share = summary["volume_m3"] / summary["hull_volume_m3"]
        lines += [
            f"  volume          {summary['volume_m3']:.6g} m^3 "
            f"({written(share, '.1%')} of its convex hull)",
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
        *(f"  note: {scene_note(note)}" for note in summary["notes"]),
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


def motion_peaks(motion: Motion, file: Path) -> str:
    """Peaks of a motion that was written to a file."""
    return f"{file}: PGA {motion.pga_g:.4g} g, PGV {motion.pgv_m_s:.4g} m/s"


def motion_measures(measures: IntensityMeasures, file: Path) -> str:
    """Measures of a motion that was written to a file."""
    return (
        f"{file}: PGA {measures.pga_g:.4g} g, PGV/PGA {measures.pgv_pga_s:.4g} s, "
        f"significant duration {measures.duration_5_95:.4g} s"
    )


def rotation_text(half: float, full: float, count: int, folder: Path) -> str:
    """RotD50 and RotD100 of PGA [g], and how many motions were written where."""
    return (
        f"RotD50 of PGA: {half:.4g} g, RotD100: {full:.4g} g\n"
        f"wrote {counted(count, 'motion')} into {folder}"
    )
