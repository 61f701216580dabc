"""Mappings out of JSON files that anybody may have written, checked by pydantic."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, ClassVar, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

from vsr2.config.problems import dotted, shown
from vsr2.errors import BlindError
from vsr2.near_words import NEAR, near_words


def _rising(ends: tuple[float, float]) -> tuple[float, float]:
    if ends[0] > ends[1]:
        raise ValueError("it should be two finite numbers, the lower one first")
    return ends


def _probable(value: float) -> float:
    if not 0 <= value <= 1 + 1e-9:
        raise ValueError("it should be a probability from 0 to 1")
    return value


Name = Annotated[str, Field(min_length=1)]
Count = Annotated[int, Field(ge=0)]
Probability = Annotated[float, AfterValidator(_probable)]
Ends = Annotated[tuple[float, float], Field(strict=False), AfterValidator(_rising)]
Names = Annotated[tuple[Name, ...], Field(strict=False)]
SHA256, DIGITS = r"^[0-9a-f]{64}\z", r"^[0-9]{1,4000}\z"
Sha256 = Annotated[str, Field(pattern=SHA256)]
Digits = Annotated[str, Field(pattern=DIGITS)]


class Part(BaseModel):
    """One mapping of a file. Numbers are finite, and a key whose value is null counts as missing.

    Keys that are not known are passed over, but for those that look like a known one.

    Attributes:
        nullable: keys whose null is a value.
    """

    model_config = ConfigDict(frozen=True, strict=True, allow_inf_nan=False, extra="ignore")
    nullable: ClassVar[frozenset[str]] = frozenset()

    @model_validator(mode="before")
    @classmethod
    def _without_null(cls, content: Any) -> Any:
        if not isinstance(content, Mapping):
            return content
        given = {k: v for k, v in content.items() if v is not None or k in cls.nullable}
        for key, value in given.items():
            if key in cls.model_fields or not isinstance(key, str):
                continue
            if meant := near_words(key, cls.model_fields, alike=NEAR.slip):
                raise misfit(key, value, f"there is no such key; do you mean {meant[0]!r}?")
        return given


_WANTED = {
    **dict.fromkeys(("dict_type", "model_type", "mapping_type"), "it should be a mapping"),
    **dict.fromkeys(("tuple_type", "list_type", "frozen_set_type"), "it should be a list"),
    "bool_type": "it should be true or false",
    "int_type": "it should be a whole number",
    "float_type": "it should be a number",
    "finite_number": "it should be a finite number",
    **dict.fromkeys(("string_type", "string_unicode"), "it should be text"),
    "invalid_key": "a key should be text",
    "string_too_short": "it should not be empty",
    "greater_than": "it should be greater than {gt:g}",
    "greater_than_equal": "it should be greater than or equal to {ge:g}",
    "too_short": "it should be a list of {min_length} or more",
    "too_long": "it should be a list of {max_length} at most",
    **dict.fromkeys(("enum", "literal_error"), "it should be {expected}"),
    "extra_forbidden": "it is no key here; remove it, or correct its name",
}
"""What a value should be, by pydantic's type of error, with the numbers and words that pydantic
gives."""
_PATTERNS = {
    SHA256: "it should be a SHA-256 hash, 64 of 0 to 9 and a to f",
    DIGITS: "it should be digits, 1 to 4000",
}
"""Patterns of text in words."""
_HINTS = {"null": "give it: the value without effect, null for infinity"}
"""What to do about missing keys."""
Model = TypeVar("Model", bound=BaseModel)


def parsed(model: type[Model], content: object, label: str, where: str = "") -> Model:
    """The content of a file as a model.

    Args:
        model: of the content.
        content: plain data.
        label: the file, in front of messages.
        where: the content's key in the file; "" for all of it.

    Raises:
        BlindError: names file, key, value and what is wanted there; of several faults the first.
    """
    try:
        return model.model_validate(content)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
    kind, key = fault["type"], dotted((*([where] if where else []), *fault["loc"]))
    if kind == "missing":
        hint = _HINTS.get(str(fault["loc"][-1]), "give it")
        raise BlindError(f"{label}: {key} is missing; {hint}")
    context: Mapping[str, Any] = fault.get("ctx", {})
    template = _PATTERNS.get(context.get("pattern", "")) or _WANTED.get(kind)
    wanted = "it cannot be used" if template is None else template.format(**context)
    if kind == "value_error":
        wanted = str(fault["ctx"]["error"])
        if isinstance(fault["input"], Mapping):
            # What is wrong within it, as `misfit` says.
            raise BlindError(f"{label}: {key}{'.' if key else ''}{wanted}")
    raise BlindError(f"{label}: {key} is {shown(fault['input'])}; {wanted}")


def check_count(names: Sequence[str], kind: str, bounds: tuple[float, float]) -> None:
    """Refuse effects that are fewer or more than a kind has."""
    least, most = bounds
    if not least <= len(names) <= most:
        number = f"{least}" if least == most else f"{least} or more"
        wanted = f"it should be a list of {number}, as the kind is {kind}"
        raise misfit("effects", names, wanted)


def misfit(key: str, value: object, wanted: str) -> ValueError:
    """That a key within a mapping does not fit another, for a model's own checks."""
    return ValueError(f"{key} is {'missing' if value is None else shown(value)}; {wanted}")
