"""The sealed answer: canonical JSON, its hash with a salt, hashes of data."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vsr2.errors import BlindError
from vsr2.results.atomic import write_atomic

PACK_SCHEMA = "vsr2.blind-pack/1"
KEY_SCHEMA = "vsr2.blind-key/1"
PACK_FILE = "pack.json"
KEY_FILE = "key.json"
SALT_BYTES = 32


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
    """Of all files below a folder: their paths in order, each with its own hash."""
    whole = hashlib.sha256()
    for path in sorted(p for p in folder.rglob(pattern) if p.is_file()):
        name = path.relative_to(folder).as_posix()
        whole.update(f"{name}\0{hashlib.sha256(path.read_bytes()).hexdigest()}\n".encode())
    return whole.hexdigest()


def write_json(path: Path, content: object, *, private: bool = False) -> None:
    """Write a JSON file, whole or not at all; `private`: readable by its owner alone."""
    text = json.dumps(content, indent=1, sort_keys=True, allow_nan=False) + "\n"
    write_atomic(path, lambda file: file.write(text.encode()))
    if private:
        path.chmod(0o600)


def read_json(path: Path) -> dict[str, Any]:
    """A JSON file that holds a mapping.

    Raises:
        BlindError: it is missing, cannot be read, or holds something else.
    """
    try:
        content = json.loads(path.read_bytes())
    except OSError as error:
        raise BlindError(f"{path}: cannot be read ({error.strerror}); check the path") from None
    except ValueError as error:
        raise BlindError(f"{path}: is no JSON ({error}); make it again") from None
    if not isinstance(content, dict):
        raise BlindError(f"{path}: holds no mapping; make it again")
    return content


def read_pack(data: Path) -> dict[str, Any]:
    """`pack.json` of a finished pack.

    Raises:
        BlindError: it is missing or of another schema.
    """
    path = data / PACK_FILE
    if not path.exists():
        raise BlindError(
            f"{path}: no such file; name a finished pack's data folder (`vsr2 blind make` writes "
            "it last, so an interrupted pack has none: make it again to continue)"
        )
    pack = read_json(path)
    if pack.get("schema") != PACK_SCHEMA:
        raise BlindError(f"{path}: schema is {pack.get('schema')!r}, wanted is {PACK_SCHEMA!r}")
    for name in ("campaigns", "commitment"):
        if name not in pack:
            raise BlindError(f"{path}: {name} is missing; get the whole pack")
    return pack


def open_key(data: Path, key_folder: Path) -> dict[str, Any]:
    """The key of a pack, after its hash and those of the data were found right.

    Raises:
        BlindError: the key is not that of the pack, was changed, or data were changed.
    """
    pack = read_pack(data)
    path = key_folder / KEY_FILE
    sealed = read_json(path)
    if sealed.get("schema") != KEY_SCHEMA or not isinstance(sealed.get("key"), dict):
        raise BlindError(f"{path}: schema is {sealed.get('schema')!r}, wanted is {KEY_SCHEMA!r}")
    try:
        found = commitment(str(sealed["salt"]), sealed["key"])
    except (KeyError, ValueError):
        raise BlindError(f"{path}: salt is missing or no hexadecimal; get the key again") from None
    if found != pack["commitment"]["sha256"]:
        raise BlindError(
            f"{path}: its hash is {found}, published was {pack['commitment']['sha256']}: the key "
            "is of another pack, or was changed; nothing is scored"
        )
    key: dict[str, Any] = sealed["key"]
    listed = {entry["id"]: entry for entry in pack["campaigns"]}
    if set(listed) != set(key["campaigns"]):
        raise BlindError(f"{path}: its campaigns are not those of {data / PACK_FILE}")
    for name, entry in key["campaigns"].items():
        if folder_sha256(data / name) != entry["data_sha256"]:
            raise BlindError(f"{data / name}: differs from the sealed data; nothing is scored")
        if listed[name].get("exclude", []) != entry["exclude"]:
            raise BlindError(f"{data / PACK_FILE}: exclude of {name} differs from the key's")
    return key


def set_time_stamps(folder: Path, when: float = 946684800.0) -> None:
    """Give all below a folder, and it, one time of change: when it was made tells nothing."""
    for path in [*sorted(folder.rglob("*"), reverse=True), folder]:
        os.utime(path, (when, when))
