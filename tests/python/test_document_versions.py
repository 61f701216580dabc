"""A document of JSON whose codes or keys change gets another version."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator, Sequence
from enum import Enum
from pathlib import Path
from typing import Any, get_args

import pytest
from pydantic import BaseModel

from vsr2._native import EngineKind, HandOver, Outcome, Status
from vsr2.blind.form.diagnosis_form import Failure
from vsr2.blind.form.pack_form import Key, Pack
from vsr2.blind.form.seal import KEY_SCHEMA, PACK_SCHEMA
from vsr2.blind.pack_diagnoses import SUBMISSION_SCHEMA
from vsr2.campaign.description import SCHEMA as CAMPAIGN_SCHEMA
from vsr2.campaign.description import campaign_schema
from vsr2.causes import causes_schema
from vsr2.causes.causes_schema import CAUSES_SCHEMA
from vsr2.coverage.coverage_scores import coverage_scores
from vsr2.coverage.judged import Judged, RankOf
from vsr2.coverage.posterior_check import SCHEMA as CHECK_SCHEMA
from vsr2.coverage.posterior_check import PosteriorCheck
from vsr2.diagnosis import schema
from vsr2.diagnosis.iteration import ITERATION_SCHEMA, Ended
from vsr2.diagnosis.verdict.document import SCHEMA
from vsr2.posterior.naming import VerdictKind
from vsr2.results.result_folder import FORMAT, FORMAT_VERSION

ROOT = Path(__file__).resolve().parents[2]


def words(form: Any) -> Iterator[str]:
    """Keys and codes of a JSON Schema, of models, of enumerations."""
    if isinstance(form, type) and issubclass(form, BaseModel):
        yield from (f"key {field.alias or name}" for name, field in form.model_fields.items())
        yield from words([field.annotation for field in form.model_fields.values()])
    elif get_args(form):
        yield from words(get_args(form))
    elif isinstance(form, dict):
        yield from (f"key {key}" for key in form.get("properties", {}))
        yield from (f"code {code}" for code in form.get("enum", ()))
        if "const" in form:
            yield f"code {form['const']}"
        for inner in form.values():
            yield from words(inner)
    elif isinstance(form, type) and issubclass(form, Enum):
        yield from (f"code {one}" for one in form)
    elif isinstance(form, Sequence) and not isinstance(form, str):
        for inner in form:
            yield from words(inner)


def keys_of(content: Any) -> Any:
    """A JSON Schema of the keys that a document has, its provenance aside."""
    if isinstance(content, dict):
        return {"properties": {k: keys_of(v) for k, v in content.items() if k != "provenance"}}
    return [keys_of(one) for one in content] if isinstance(content, list) else {}


def posterior_check() -> Any:
    """`posterior_check.json` of planted campaigns."""
    ranks = (RankOf("wear", "loss", "1", 0.1, 0.5),)
    judged = tuple(Judged(k, "wear", "wear", 0.9, True, True, 1, ranks) for k in range(30))
    return json.loads(PosteriorCheck(coverage_scores(judged), judged, 0.9, {}).to_json())


DOCUMENTS: dict[str, Any] = {
    SCHEMA: schema(),
    CAUSES_SCHEMA: causes_schema(),
    CHECK_SCHEMA: keys_of(posterior_check()),
    ITERATION_SCHEMA: [Ended, VerdictKind],
    # Its columns stand in the file and are compared by name.
    f"{FORMAT}/{FORMAT_VERSION}": [EngineKind, HandOver, Outcome, Status],
    CAMPAIGN_SCHEMA: campaign_schema(),
    PACK_SCHEMA: Pack,
    KEY_SCHEMA: Key,
    SUBMISSION_SCHEMA: Failure,
}  # fmt: skip
"""Documents by their version, with what their words follow from."""
RECORDED: dict[str, str] = {
    "vsr2.diagnosis/5": "35bdd52a5044b778",
    "vsr2.diagnosis/6": "ffe38a2bc1511061",
    "vsr2.diagnosis/7": "d524a83f79afecb7",
    "vsr2.diagnosis/8": "478caef5bfce10e9",
    "vsr2.diagnosis/9": "974d56e29123a741",
    "vsr2.diagnosis/10": "b92f848c14a54231",
    "vsr2.diagnosis/11": "531802fb3648958f",
    "vsr2.diagnosis/12": "1ad1bc209544a4bb",
    "vsr2.diagnosis/13": "5aac583d8067afeb",
    "vsr2.diagnosis/14": "85667c46ee20e6a6",
    "vsr2.diagnosis/15": "c31646b4dfb6c3f2",
    "vsr2.diagnosis/16": "f4d6ea6063ffeb0e",
    "vsr2.causes/2": "dfb9566fb1750253",
    "vsr2.causes/3": "68182ddb7d70981b",
    "vsr2.causes/4": "e58833a1e94c9c60",
    "vsr2.causes/5": "ce4b5a23b7feb165",
    "vsr2.posterior_check/1": "0e7a0c51e47b3910",
    "vsr2.iteration/1": "1e98753e9abf73ba",
    "vsr2 result/3": "bef9853494f8c9dd",
    "vsr2.campaign/1": "102e8d94b13c29ca",
    "vsr2.blind-pack/2": "6b61faf1e6d65ba5",
    "vsr2.blind-key/2": "157b8827b6742b8b",
    "vsr2.blind-submission/1": "9055a5dd9f5fb4cb",
}
"""Of each version, the hash of its words. A changed set of words has a new version, and a new row
here; the rows of old versions stay."""


def digest(form: Any) -> str:
    """Hash of the words of a document, in whatever order they are listed."""
    return hashlib.sha256(json.dumps(sorted(set(words(form)))).encode()).hexdigest()[:16]


@pytest.mark.parametrize("version", DOCUMENTS)
def test_other_words_have_another_version(version: str) -> None:
    found = digest(DOCUMENTS[version])
    assert RECORDED.get(version) == found, (
        f"keys or codes of {version} are not those that this version had: raise the version where "
        f"it is defined, and record the hash that this test then names, now {found}"
    )


def test_a_new_code_changes_the_hash() -> None:
    grown = {"properties": {"kind": {"enum": [*VerdictKind, "another"]}}}
    assert digest(grown) != digest({"properties": {"kind": {"enum": [*VerdictKind]}}})
    assert digest([Ended, VerdictKind]) != digest([Ended])


@pytest.mark.parametrize("version", DOCUMENTS)
def test_pages_name_no_other_version_of_a_document(version: str) -> None:
    name = version.rpartition("/")[0]
    for page in sorted((ROOT / "docs").rglob("*.md")):
        stated = re.findall(rf"`{re.escape(name)}/(\d+)`", page.read_text())
        assert set(stated) <= {version.rpartition("/")[2]}, page
