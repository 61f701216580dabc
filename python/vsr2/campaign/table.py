"""Tables in CSV that may come from anywhere: bounded, with problems that name row and column."""

from __future__ import annotations

import csv
import datetime
import io
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from vsr2.campaign.file_problems import Problems
from vsr2.config.bounded import UnreadableError, read_bounded
from vsr2.config.problems import shown
from vsr2.one_line import counted

MAX_TABLE_BYTES = 64 * 1024**2
"""Greater files are refused unread."""
MAX_ROWS = 100_000
"""Of a table; bounds its memory."""
MAX_COLUMNS = 300
"""Of a table; bounds its memory."""
MAX_CELL = 1000
"""Longest cell [characters]."""

_NUMBER = re.compile(r"[-+]?(?:[0-9]{1,40}\.?[0-9]{0,40}|\.[0-9]{1,40})(?:[eE][-+]?[0-9]{1,4})?\Z")
_INTEGER = re.compile(r"[-+]?[0-9]{1,18}\Z")


@dataclass(frozen=True)
class Row:
    """A row of a table: its line in the file, and its cells by column (blanks stripped)."""

    line: int
    cells: dict[str, str]


@dataclass(frozen=True)
class Table:
    """A table.

    Attributes:
        columns: names from the header.
        rows: those of as many cells as the header.
        complete: no row had to be left out.
    """

    columns: tuple[str, ...]
    rows: list[Row]
    complete: bool


def read_table(path: Path, file: str, problems: Problems) -> Table | None:
    """A CSV file with a header; None where `problems` got one that leaves no table.

    Args:
        path: the file.
        file: how problems name it.
        problems: gets what is wrong.
    """
    try:
        content = read_bounded(path, MAX_TABLE_BYTES, remedy="split the campaign")
    except UnreadableError as error:
        problems.add(file, str(error))
        return None
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        row = content.count(b"\n", 0, error.start) + 1
        problems.add(
            file,
            f"byte {content[error.start]:#04x} is not UTF-8; save the table as UTF-8",
            row=row,
        )
        return None
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    lines = _lines(reader, file, problems)
    header = next(lines, None)
    if header is None:
        if not problems:
            problems.add(file, "is empty; give a header and one row a trial")
        return None
    columns = header[1]
    if not _sound_header(columns, header[0], file, problems):
        return None
    rows: list[Row] = []
    faults = len(problems.found)
    for line, cells in lines:
        if len(cells) != len(columns):
            problems.add(
                file,
                f"has {counted(len(cells), 'cell')}, the header {len(columns)}; give each column "
                "one cell",
                row=line,
            )
            continue
        if len(rows) >= MAX_ROWS:
            problems.add(file, f"has more than {MAX_ROWS} rows; split the campaign", row=line)
            return None
        for name, cell in zip(columns, cells, strict=True):
            if len(cell) > MAX_CELL:
                problems.add(
                    file,
                    f"has {counted(len(cell), 'character')}, at most {MAX_CELL}",
                    row=line,
                    column=name,
                )
        rows.append(Row(line, dict(zip(columns, cells, strict=True))))
    if not rows and len(problems.found) == faults:
        problems.add(file, "has a header and no rows; give one row a trial")
    return Table(tuple(columns), rows, complete=len(problems.found) == faults)


def _lines(
    reader: Iterator[list[str]], file: str, problems: Problems
) -> Iterator[tuple[int, list[str]]]:
    """Rows that are not blank, with their lines; a fault of the format ends them."""
    while True:
        try:
            cells = next(reader)
        except StopIteration:
            return
        except csv.Error as error:
            problems.add(
                file,
                f"not a table in CSV ({error}); write it again with commas and one row a line",
                row=getattr(reader, "line_num", None),
            )
            return
        stripped = [cell.strip() for cell in cells]
        if any(stripped):
            yield getattr(reader, "line_num", 0), stripped


def _sound_header(columns: list[str], line: int, file: str, problems: Problems) -> bool:
    if len(columns) > MAX_COLUMNS:
        problems.add(
            file,
            f"the header has {counted(len(columns), 'column')}, at most {MAX_COLUMNS}",
            row=line,
        )
        return False
    sound = True
    for i, name in enumerate(columns):
        if not name or len(name) > MAX_CELL or not name.isprintable():
            problems.add(
                file, f"column {i + 1} has the name {shown(name)}; give it a plain one", row=line
            )
            sound = False
        elif name in columns[:i]:
            problems.add(file, "is there twice; remove or rename one", row=line, column=name)
            sound = False
    return sound


class Cells:
    """Reads the cells of one row and notes what is wrong with them.

    Attributes:
        wrong: the columns that were refused.
    """

    def __init__(self, row: Row, file: str, problems: Problems) -> None:
        self._row = row
        self._file = file
        self._problems = problems
        self.wrong: set[str] = set()

    def refuse(self, column: str, what: str) -> None:
        """Note what is wrong with a cell; the first fault of a column counts."""
        if column not in self.wrong:
            self._problems.add(self._file, what, row=self._row.line, column=column)
            self.wrong.add(column)

    def number(self, column: str) -> float | None:
        """A number; None: blank, or none (`nan`, `inf` and `1_000` are none)."""
        cell = self._row.cells.get(column, "")
        if _NUMBER.match(cell):
            return float(cell)
        if cell:
            self.refuse(
                column, f"{shown(cell)} is no number; leave the cell blank where it is unknown"
            )
        return None

    def integer(self, column: str, most: int, remedy: str) -> int:
        """A whole number from 0 to `most`; 0 where it is none."""
        cell = self._row.cells[column]
        value = int(cell) if _INTEGER.match(cell) else -1
        if 0 <= value <= most:
            return value
        self.refuse(column, f"{shown(cell)} {remedy}")
        return 0

    def outcome(self, column: str) -> bool | None:
        """True for 1, False for 0, None for blank."""
        cell = self._row.cells[column]
        if cell not in ("", "0", "1"):
            self.refuse(column, f"{shown(cell)} is not 0, 1 or blank (unknown)")
        return None if not cell else cell == "1"

    def date(self, column: str, example: str) -> datetime.date | None:
        """A date, with dashes where `example` has them; None: blank, or none."""
        cell = self._row.cells.get(column, "")
        digits = re.sub("[0-9]", "0", cell)
        try:
            if digits == re.sub("[0-9]", "0", example):
                return datetime.date.fromisoformat(cell)
        except ValueError:
            pass
        if cell:
            self.refuse(column, f"{shown(cell)} is no date; write it as {example}")
        return None
