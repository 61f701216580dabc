"""What is wrong with a campaign's files: which file, where in it, and what to do."""

from __future__ import annotations

from dataclasses import dataclass, field

from vsr2.one_line import counted

MAX_PROBLEMS = 200
"""More are counted but not kept: one slip in a column repeats in every row."""

_LISTED = 20
"""Problems that an error names."""


@dataclass(frozen=True)
class CampaignProblem:
    """One thing that is wrong.

    Attributes:
        file: relative to the campaign's folder; "" for the folder itself.
        row: line of the file, counted from 1 (the header of a table is row 1); None: no line.
        column: of a table, key of a YAML file, or array of an `.npz` file; "": none.
        what: value and remedy.
    """

    file: str
    row: int | None
    column: str
    what: str

    def __str__(self) -> str:
        place = []
        if self.row is not None:
            place.append(f"row {self.row}")
        if self.column:
            kind = {"yaml": "key", ".npz": "array"}.get(self.file[-4:], "column")
            place.append(f"{kind} {self.column}")
        parts = [part for part in (self.file, ", ".join(place), self.what) if part]
        return ": ".join(parts)


@dataclass
class Problems:
    """Collects problems of a campaign's files while they are read."""

    found: list[CampaignProblem] = field(default_factory=list)
    left_out: int = 0

    def add(self, file: str, what: str, *, row: int | None = None, column: str = "") -> None:
        """Note one problem."""
        if len(self.found) < MAX_PROBLEMS:
            self.found.append(CampaignProblem(file, row, column, what))
        else:
            self.left_out += 1

    def result(self) -> list[CampaignProblem]:
        """All that were kept, and a last one that counts the others."""
        if not self.left_out:
            return list(self.found)
        more = CampaignProblem("", None, "", f"{self.left_out} more problems are not listed")
        return [*self.found, more]

    def listed(self, heading: str) -> str:
        """The first twenty under `heading`; a single one in its line."""
        found = self.result()
        lines = [str(problem) for problem in found[:_LISTED]]
        if len(lines) == 1:
            return f"{heading}: {lines[0]}"
        if len(found) > _LISTED:
            lines.append(
                f"... and {len(found) - _LISTED} more; `vsr2 campaign check` lists a folder's"
            )
        return "\n  ".join([f"{heading}: {counted(len(found), 'problem')}", *lines])

    def __bool__(self) -> bool:
        return bool(self.found)
