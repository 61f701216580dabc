"""The sealed answer: canonical JSON, its hash with a salt, hashes of data."""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vsr2.blind.form.pack_form import Key, Pack
from vsr2.blind.form.pack_settings import Kind
from vsr2.blind.form.reader import parsed
from vsr2.blind.form.trial_weights import check_weights, trial_ids
from vsr2.campaign.trials_table import TRIALS
from vsr2.config.problems import shown
from vsr2.config.yaml_file import parse_yaml
from vsr2.errors import BlindError, ConfigError
from vsr2.results.atomic import write_atomic

PACK_SCHEMA = "vsr2.blind-pack/2"
KEY_SCHEMA = "vsr2.blind-key/2"
_READ = (PACK_SCHEMA, "vsr2.blind-pack/1"), (KEY_SCHEMA, "vsr2.blind-key/1")
"""Of packs and of keys: the first form lacked nuisances, priors, references, shared motions."""
PACK_FILE = "pack.json"
KEY_FILE = "key.json"
SALT_BYTES = 32
"""Of a key's salt: as long as the hash that it guards."""
_MADE = 946684800.0
"""When all files of a pack say that they were changed: the first second of 2000, UTC."""


def canonical(content: object) -> bytes:
    """JSON with sorted keys and no blanks: one content, one sequence of bytes.

    Raises:
        BlindError: NaN, infinity, or what JSON does not know.
    """
    try:
        text = json.dumps(
            content, sort_keys=True, separators=(",", ":"), allow_nan=False, ensure_ascii=True
        )
    except (TypeError, ValueError) as error:
        raise BlindError(f"cannot be sealed ({error}); give plain, finite data") from None
    return text.encode("ascii")


def commitment(salt: str, key: Mapping[str, Any]) -> str:
    """SHA-256 of the salt's bytes (given in hex) and the canonical key."""
    return hashlib.sha256(bytes.fromhex(salt) + canonical(key)).hexdigest()


def folder_sha256(folder: Path, pattern: str = "*") -> str:
    """Of all files below a folder: their paths in order, each with its own hash.

    Raises:
        BlindError: a folder in it is a link, whose files would be read and not hashed.
    """
    total = hashlib.sha256()
    for path in folder.rglob("*"):
        if path.is_symlink() and path.is_dir():
            raise BlindError(f"{path}: is a link to a folder; put the folder itself there")
    for path in sorted(p for p in folder.rglob(pattern) if p.is_file()):
        name = path.relative_to(folder).as_posix()
        total.update(f"{name}\0{hashlib.sha256(path.read_bytes()).hexdigest()}\n".encode())
    return total.hexdigest()


def write_json(path: Path, content: object, *, private: bool = False) -> None:
    """Write a JSON file atomically, indented and sorted; `private`: for its owner alone."""
    text = json.dumps(content, indent=1, sort_keys=True, allow_nan=False) + "\n"
    write_atomic(path, lambda file: file.write(text.encode()), private=private)


def make_folder(path: Path) -> None:
    """Make a folder that files are to be written to, and those that it lies in.

    Raises:
        BlindError: it cannot be made, or not written to.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BlindError(
            f"{path}: no folder can be made there ({error.strerror}); choose another"
        ) from None
    if not os.access(path, os.W_OK):
        raise BlindError(f"{path}: cannot be written to; choose another folder")


def read_json(path: Path) -> dict[str, Any]:
    """A JSON file that holds a mapping.

    Raises:
        BlindError: it is missing, cannot be read, holds something else, or a key twice.
    """

    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        content = dict(pairs)
        if len(content) < len(pairs):
            keys = [key for key, _ in pairs]
            twice = next(key for key in content if keys.count(key) > 1)
            raise BlindError(f"{path}: {twice} stands twice in one mapping; leave one of them out")
        return content

    try:
        content = json.loads(path.read_bytes(), parse_float=_finite, object_pairs_hook=once)
    except OSError as error:
        raise BlindError(f"{path}: cannot be read ({error.strerror}); check the path") from None
    except (ValueError, RecursionError) as error:
        raise BlindError(f"{path}: is no JSON ({error}); make it again") from None
    if not isinstance(content, dict):
        raise BlindError(f"{path}: holds no mapping; make it again")
    return content


def _finite(text: str) -> float:
    """A number; what Python would read as infinity was meant as text, most often as an id."""
    value = float(text)
    if math.isinf(value):
        raise ValueError(f"{text} is a number too great to be one; a name needs quotes")
    return value


def folder_around(folder: Path, file: str) -> Path | None:
    """The folder that holds a file of that name and that another one is or lies in."""
    inner = folder.resolve()
    return next((one for one in (inner, *inner.parents) if (one / file).exists()), None)


def read_pack(data: Path) -> Pack:
    """`pack.json` of a finished pack, whoever wrote it.

    Raises:
        BlindError: it is missing or of another schema, or a value is missing or of a wrong kind.
    """
    path = data / PACK_FILE
    if not path.exists():
        raise BlindError(
            f"{path}: no such file; name a finished pack's data folder (`vsr2 blind make` writes "
            "it last, so an interrupted pack has none: make it again to continue)"
        )
    pack = read_json(path)
    if pack.get("schema") not in _READ[0]:
        raise BlindError(f"{path}: schema is {pack.get('schema')!r}, wanted is {PACK_SCHEMA!r}")
    return parsed(Pack, pack, str(path))


def open_key(data: Path, key_folder: Path) -> dict[str, Any]:
    """The key of a pack, after its hash and all that it seals were found right.

    Compared are the campaigns' files, what they exclude, their protocols, shared motions, the
    scene, and of `pack.json` whether the pack is open, references, tiers, classes, tolerances,
    nuisances and priors. Of these a key may seal less: files, motions, references and `exclude`
    always, the others where it has them. A pack whose key does not say that it is open is not.

    Raises:
        BlindError: the key is not that of the pack, was changed or is of a wrong form, or what it
            seals was changed.
    """
    pack = read_pack(data)
    path = key_folder / KEY_FILE
    sealed = read_json(path)
    if sealed.get("schema") not in _READ[1] or not isinstance(sealed.get("key"), dict):
        raise BlindError(f"{path}: schema is {sealed.get('schema')!r}, wanted is {KEY_SCHEMA!r}")
    try:
        found = commitment(str(sealed["salt"]), sealed["key"])
    except (KeyError, ValueError):
        raise BlindError(f"{path}: salt is missing or no hexadecimal; get the key again") from None
    if not sealed["salt"]:
        raise BlindError(
            f"{path}: salt is empty, so that a key can be guessed from its hash; seal with random "
            f"bytes ({SALT_BYTES}, say)"
        )
    if found != pack.commitment.sha256:
        raise BlindError(
            f"{path}: its hash is {found}, published was {pack.commitment.sha256}: the key "
            "is of another pack, or was changed; nothing is scored"
        )
    key: dict[str, Any] = sealed["key"]
    read = parsed(Key, key, str(path), "key")
    if {one.id for one in pack.campaigns} != set(read.campaigns):
        raise BlindError(f"{path}: its campaigns are not those of {data / PACK_FILE}")
    _check_published(data / PACK_FILE, pack, read)
    _check_scene(data, pack.scene, read)
    folders = {name: entry.data_sha256 for name, entry in read.campaigns.items()}
    folders |= read.motions_sha256
    for one in sorted(data.iterdir()):
        if one.is_dir() and one.name not in folders and any(one.glob("*.npz")):
            raise BlindError(
                f"{one}: holds motions, and motions_sha256 of {path} does not seal them; seal "
                "motions that campaigns share, or remove them"
            )
    for name, sha256 in folders.items():
        if folder_sha256(data / name) != sha256:
            raise BlindError(
                f"{data / name}: its files differ from the sealed ones (changed, missing or "
                "added); get the published folder again; nothing is scored"
            )
    for name, entry in read.campaigns.items():
        if weights := entry.where.weights:
            check_weights(weights, trial_ids(data / name / TRIALS), data / name, name)
    return key


def is_open(key: Mapping[str, Any]) -> bool:
    """Whether a pack is open: scored at will, campaign by campaign."""
    return bool(key["settings"].get("development"))


def sealed_classes(key: Mapping[str, Any]) -> tuple[tuple[str, ...], ...]:
    """The equivalence classes that verdicts are judged by."""
    return tuple(tuple(members) for members in key["settings"]["classes"])


def _check_published(path: Path, pack: Pack, key: Key) -> None:
    """Compare what diagnosing and scoring take from `pack.json` with the sealed."""
    settings = key.settings
    compared: list[tuple[str, object, object]] = [
        ("development", pack.development, settings.development)
    ]
    sealed: dict[str, object] = {"tiers": settings.sealed_tiers, "classes": settings.classes}
    sealed |= {"nuisances": settings.nuisances, "priors": settings.priors}
    for name, there in sealed.items():
        here = getattr(pack, name)
        if there is not None and here != there:
            compared.append((name, here if name in pack.model_fields_set else None, there))
    if settings.tolerances is not None:
        kept, own = (
            {} if of is None else of.model_dump(mode="json", exclude_unset=True)
            for of in (pack.tolerances, settings.tolerances)
        )
        compared += [(f"tolerances.{n}", kept.get(n), own.get(n)) for n in sorted({*kept, *own})]
    for listed in pack.campaigns:
        name, entry = listed.id, key.campaigns[listed.id]
        is_reference = entry.kind is Kind.REFERENCE
        compared.append((f"reference {name}", listed.kind is not None, is_reference))
        if is_reference:
            acting = [
                [(effect.name, effect.values) for effect in of.effects] for of in (listed, entry)
            ]
            compared.append((f"effects of {name}", acting[0], acting[1]))
        compared.append((f"exclude of {name}", list(listed.exclude), list(entry.exclude)))
        if "protocol" in entry.model_fields_set:
            compared.append((f"protocol of {name}", listed.protocol, entry.protocol))
    for name, one, other in compared:
        if one is None and other is not None:
            raise BlindError(
                f"{path}: {name} is missing, sealed is {shown(other)}; publish it, or get the "
                "published file again; nothing is scored"
            )
        if one != other:
            raise BlindError(
                f"{path}: {name} is {shown(one)} and differs from the sealed, {shown(other)}: it "
                "was changed; get the published file again; nothing is scored"
            )


def _check_scene(data: Path, scene: str, key: Key) -> None:
    """Compare the scene, and the model that it names, with the hashes in the key."""
    sealed, model = key.scene_sha256, key.model_sha256
    if sealed is None and model is None:
        return
    path = data / scene
    try:
        content: Any = parse_yaml(path.read_bytes(), os.fspath(path)).data
        file = path.parent / content["rock"]["file"] if model is not None else path
        found = hashlib.sha256(file.read_bytes()).hexdigest()
    except OSError as error:
        raise BlindError(
            f"{error.filename}: cannot be read ({error.strerror}); get the published file again"
        ) from None
    except (ConfigError, KeyError, TypeError):
        raise BlindError(
            f"{path}: is no scene, or lacks the sealed rock.file; get the published file again"
        ) from None
    if sealed is not None and hashlib.sha256(canonical(content)).hexdigest() != sealed:
        raise BlindError(f"{path}: differs from the sealed scene; nothing is scored")
    if model is not None and found != model:
        raise BlindError(f"{file}: differs from the sealed model; nothing is scored")


def set_time_stamps(folder: Path) -> None:
    """Give all below a folder, and it, one time of change, so that none says when it was made."""
    for path in [*sorted(folder.rglob("*"), reverse=True), folder]:
        os.utime(path, (_MADE, _MADE))
