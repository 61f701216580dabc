"""What is wrong with a value of a JSON file, in words of VSR2 by pydantic's type of error."""

from __future__ import annotations

import math
from collections.abc import Iterator
from datetime import date
from typing import Any

import pytest
from pydantic import BaseModel, ValidationError

from diagnosis_content import named_throughout
from vsr2.blind.custodian.steps import PackState
from vsr2.blind.form.diagnosis_form import _Diagnosis
from vsr2.blind.form.pack_form import Listed, Pack
from vsr2.blind.form.pack_settings import Tolerances
from vsr2.blind.form.reader import _PATTERNS, _WANTED, Part, parsed
from vsr2.diagnosis.verdict.document import finite
from vsr2.errors import BlindError

VALUES: tuple[Any, ...] = (
    True, 1, 1.5, -1, math.nan, 10**400, "x", "", "\ud800", b"x", object(), [], [1], ["x"], [2, 1],
    [1, 2, 3], {}, {"x": 1}, {"x": "y"}, {1: 2}, [["x"]], [[]], [{}], [{"x": 1}],
)  # fmt: skip
OWN = ("missing", "value_error")
"""Types of error whose words are VSR2's anyway."""


def parts(kind: type[Part] = Part) -> Iterator[type[Part]]:
    for one in kind.__subclasses__():
        yield one
        yield from parts(one)


def refused(content: Any, kind: type[Part]) -> list[dict[str, Any]]:
    try:
        kind.model_validate(content)
    except ValidationError as error:
        return [dict(fault) for fault in error.errors(include_url=False)]
    return []


def test_every_type_of_error_has_words() -> None:
    assert PackState in set(parts())
    wordless = {
        fault["type"]
        for kind in parts()
        for value in VALUES
        for one in (value, [value], {"a": value})
        for fault in refused(dict.fromkeys(kind.model_fields, one), kind)
        if fault["type"] not in {*_WANTED, *OWN}
        and fault.get("ctx", {}).get("pattern") not in _PATTERNS
    }
    assert wordless == set()


@pytest.mark.parametrize(
    ("kind", "content", "message"),
    [
        (
            Tolerances,
            {"friction": -1.0},
            "friction is -1.0; it should be greater than or equal to 0",
        ),
        (Tolerances, {"friction": "x"}, "friction is 'x'; it should be a number"),
        (Tolerances, {"friction": math.inf}, "friction is inf; it should be a finite number"),
        (Tolerances, {"input_gain": [1, 2, 3]}, "it should be a list of 2 at most"),
        (Pack, {"development": True, "scene": 3}, "scene is 3; it should be text"),
        (Listed, {"id": "c", "kind": 3}, "kind is 3; it should be 'reference'"),
        (Listed, {"id": "c", "exclude": [], "excludes": ["x"]}, "excludes is .* mean 'exclude'"),
        (PackState, {"seed": "1a", "salt": "0" * 64}, "seed is '1a'; it should be digits"),
        (PackState, {"seed": "1", "salt": "0" * 63}, "salt is .*; it should be a SHA-256 hash"),
    ],
)
def test_a_value_is_refused_in_own_words(kind: type[Part], content: Any, message: str) -> None:
    with pytest.raises(BlindError, match=f"file: .*{message}"):
        parsed(kind, content, "file")


def test_no_key_of_a_diagnosis_looks_like_another() -> None:
    found = parsed(_Diagnosis, finite(named_throughout("friction").content), "file")
    assert found.effects[0].parameters


def test_a_type_of_error_without_words_is_refused_in_own_words_too() -> None:
    class Odd(BaseModel):
        when: date

    with pytest.raises(BlindError, match=r"file: when is 'x'; it cannot be used$"):
        parsed(Odd, {"when": "x"}, "file")
