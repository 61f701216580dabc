"""The forms of `pack.json` and of the key, as docs/reference/blind.md has them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import PurePosixPath
from typing import Any

from vsr2.blind.form.reader import Node, finite
from vsr2.blind.form.settings import KINDS, Tolerances
from vsr2.campaign import Tier
from vsr2.campaign.campaign import id_fault
from vsr2.effects import library
from vsr2.errors import BlindError

TIERS: tuple[Tier, ...] = ("B", "M", "T")
AXES = ("conditions", "order", "none")
_SHA256 = re.compile(r"[0-9a-f]{64}\Z")
_EFFECTS = {"none": (0, 0), "single": (1, 1), "pair": (2, 2), "unknown": (1, None)}
"""Least and greatest number of effects by kind; None: any."""
_NO_EFFECTS = ("none", "unknown")
"""Answers that no effect may be called."""


def check_pack(content: Mapping[str, Any], label: str) -> None:
    """Check the content of a `pack.json`.

    Args:
        content: of it.
        label: the file, in front of messages.

    Raises:
        BlindError: a value is missing or of a wrong kind.
    """
    pack = Node(content, label)
    pack.flag("development")
    scene = PurePosixPath(pack.text("scene", "the name of the scene's file in the data folder"))
    if scene.is_absolute() or ".." in scene.parts:
        raise pack.error("scene", "the name of a file in the data folder")
    _check_tiers(pack)
    _check_classes(pack)
    if pack.has("tolerances"):
        _check_tolerances(pack.node("tolerances"))
    campaigns = pack.nodes("campaigns")
    if not campaigns:
        raise pack.error("campaigns", "a list with a mapping for each campaign")
    found: set[str] = set()
    for campaign in campaigns:
        name = _campaign_id(campaign, campaign.content.get("id"))
        if name in found:
            raise campaign.error("id", "each id once")
        found.add(name)
        campaign.whole("protocol")
        campaign.names("exclude", "names of effects")
    _check_hash(pack.node("commitment"), "sha256")


def check_key(content: Mapping[str, Any], label: str) -> None:
    """Check the `key` of a `key.json`.

    Args:
        content: of it.
        label: the file, in front of messages.

    Raises:
        BlindError: a value is missing or of a wrong kind.
    """
    key = Node(content, label, "key")
    for name in ("scene_sha256", "model_sha256"):
        if key.has(name):
            _check_hash(key, name)
    settings = key.node("settings")
    settings.flag("development")
    if not settings.has("classes"):
        raise settings.error("classes", "the list of equivalence classes, [] for none")
    _check_classes(settings)
    if settings.has("tiers"):
        _check_tiers(settings)
    if settings.has("tolerances"):
        _check_tolerances(settings.node("tolerances"))
    classes = [frozenset(members) for members in settings.content["classes"]]
    campaigns = key.node("campaigns")
    for name in campaigns.content:
        _check_entry(campaigns.node(name), classes)
        _check_exclude(campaigns.node(name), classes)


def _check_entry(entry: Node, classes: Sequence[frozenset[str]]) -> None:
    kind = entry.choice("kind", KINDS)
    entry.text("engine", "the name of what simulated or measured it")
    entry.whole("protocol")
    entry.names("exclude", "names of effects")
    _check_hash(entry, "data_sha256")
    effects = entry.nodes("effects")
    entry.check_count("effects", _EFFECTS[kind], f"as the kind is {kind}")
    for effect in effects:
        _check_effect(effect)
    if kind == "pair":
        first, second = (effect.content["name"] for effect in effects)
        if first == second or any({first, second} <= members for members in classes):
            raise entry.error("effects", "a list of two effects of different classes")
    where = entry.node("where")
    axis = where.choice("axis", AXES)
    if (axis == "none") != (kind == "none"):
        raise where.error("axis", "none where the kind is none, and another where it is not")
    weights = [finite(weight) for weight in where.items("weights")]
    if not where.has("weights") or any(weight is None or weight < 0 for weight in weights):
        raise where.error("weights", "a list of numbers from 0, one a trial, or []")


def _check_exclude(entry: Node, classes: Sequence[frozenset[str]]) -> None:
    """That no class is withheld in part, an unknown effect of the library is, and no other is."""
    exclude = frozenset(entry.content.get("exclude") or ())
    for members in classes:
        if exclude & members and not members <= exclude:
            missing = ", ".join(sorted(members - exclude))
            raise entry.error("exclude", f"whole equivalence classes: {missing} too")
    unknown = entry.content["kind"] == "unknown"
    for name in (effect["name"] for effect in entry.content.get("effects") or ()):
        if name in exclude and not unknown:
            raise entry.error("exclude", f"names without {name}, the effect of this campaign")
        if unknown and name not in exclude and name in library():
            raise entry.error("exclude", f"{name} among the names, as the kind is unknown")


def _check_effect(effect: Node) -> None:
    if effect.text("name") in _NO_EFFECTS:
        raise effect.error("name", "that of an effect; these are verdicts")
    strength = effect.text("strength", "the name of the parameter that is judged")
    values = effect.node("values")
    for name in values.content:
        values.number(name)
    truth = values.number(strength)
    if "null" not in effect.content:
        raise effect.error("null", "the value without effect, null for infinity")
    null = effect.number("null") if effect.has("null") else None
    if truth == (null or 0.0):
        raise values.error(strength, "a magnitude other than that without effect (null)")
    if effect.has("relative") and effect.number("relative") <= 0:
        raise effect.error("relative", "the magnitude over the floor, above 0; null: not measured")


def _check_tiers(node: Node) -> None:
    tiers = node.names("tiers")
    if not tiers or len(set(tiers)) < len(tiers) or not set(tiers) <= set(TIERS):
        raise node.error("tiers", f"a list of some of {', '.join(TIERS)}, each once")


def _check_classes(node: Node) -> None:
    wanted = "a list of lists of names of effects, each name once, none and unknown in none"
    seen: set[str] = set()
    for members in node.items("classes"):
        if not isinstance(members, list) or not members:
            raise node.error("classes", wanted)
        for name in members:
            if not isinstance(name, str) or not name or name in {*seen, *_NO_EFFECTS}:
                raise node.error("classes", wanted)
            seen.add(name)


def _check_tolerances(tolerances: Node) -> None:
    pairs = {f.name: isinstance(f.default, tuple) for f in fields(Tolerances)}
    for name in tolerances.content:
        if name not in pairs:
            raise tolerances.error(name, f"nothing: known are {', '.join(pairs)}")
        least = tolerances.interval(name)[0] if pairs[name] else tolerances.number(name)
        if least < 0:
            raise tolerances.error(name, "0 or more")
    for one, other in (("width", "height"), ("height", "width")):
        if tolerances.has(one) and not tolerances.has(other):
            raise tolerances.error(other, f"a number beside {one}: give both, or neither")


def _campaign_id(campaign: Node, name: object) -> str:
    fault = id_fault(name)
    if fault is not None:
        raise BlindError(f"{campaign.label}: {campaign.key('id')}: {fault}")
    return str(name)


def _check_hash(node: Node, name: str) -> None:
    value = node.content.get(name)
    if not isinstance(value, str) or not _SHA256.match(value):
        raise node.error(name, "a SHA-256 in hexadecimal, 64 characters from 0-9a-f")
