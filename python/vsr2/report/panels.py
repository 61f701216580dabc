"""Sheets of panels in one style, and their files."""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from vsr2.report.text import printable
from vsr2.results import FIGURE_FOLDER
from vsr2.results.atomic import make_folder, write_atomic, write_text

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

REPORT = "report.md"
_SVG_METADATA = ("Creator", "Date", "Format", "Type")
"""Left out of drawings: the time among them would change their bytes."""
_SVG = "http://www.w3.org/2000/svg"
_TOOLTIP = "tooltip-"
ElementTree.register_namespace("", _SVG)
ElementTree.register_namespace("xlink", "http://www.w3.org/1999/xlink")


def sheet(rows: int, columns: int, size: tuple[float, float]) -> tuple[Figure, Any]:
    """A figure with `rows` x `columns` panels, `size` in inches, made without global state."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False)
    for panel in axes.flat:
        panel.grid(True, linewidth=0.4, alpha=0.5)
        panel.set_axisbelow(True)
        panel.spines[["top", "right"]].set_visible(False)
    return figure, axes


def legend_below(
    figure: Figure, columns: int, handles: Sequence[Artist] | None = None, size: str = "small"
) -> None:
    """Below all panels, where it hides nothing: of the first panel's marks, or of `handles`."""
    if handles is None:
        handles = figure.axes[0].get_legend_handles_labels()[0]
    figure.legend(
        handles=handles, loc="outside lower center", ncols=columns, fontsize=size, frameon=False
    )


def scale_where_wide(panel: Axes, which: str, values: NDArray[np.float64]) -> None:
    """Make an axis logarithmic where its values are above 0 and span a factor of more than 8."""
    if values.size and values.min() > 0 and values.max() > 8 * values.min():
        scale_axis(panel, which)


def scale_axis(panel: Axes, which: str) -> None:
    """Make an axis, "x" or "y", logarithmic, its ticks within a decade as 0.02, 0.05, 0.1."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axis = panel.xaxis if which == "x" else panel.yaxis
    (panel.set_xscale if which == "x" else panel.set_yscale)("log")
    low, high = sorted(panel.get_xlim() if which == "x" else panel.get_ylim())
    if high < 500 * low:
        subs = (1.0, 2.0, 3.0, 4.0, 6.0, 8.0) if high < 8 * low else (1.0, 2.0, 5.0)
        axis.set_major_locator(LogLocator(subs=subs))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())


def tooltip(artist: Artist, text: str) -> None:
    """Text that a browser shows where the pointer rests on a mark of :func:`svg`."""
    artist.set_gid(f"{_TOOLTIP}{printable(text)}")


def svg(figure: Figure, meaning: str) -> str:
    """A figure as an `svg` element for a page, or a file; the same bytes for the same figure.

    Args:
        figure: what to draw; letters stay letters, in the sans-serif font of the page.
        meaning: read by screen readers in place of the figure.
    """
    import matplotlib

    file = io.StringIO()
    with matplotlib.rc_context({"svg.hashsalt": "vsr2", "svg.fonttype": "none"}):
        figure.savefig(file, format="svg", metadata=dict.fromkeys(_SVG_METADATA))
    root = ElementTree.fromstring(file.getvalue())
    # Without a size of its own it is as wide as its column.
    del root.attrib["width"], root.attrib["height"]
    root.attrib |= {"role": "img", "aria-label": meaning}
    for group in root.iter(f"{{{_SVG}}}g"):
        # Names of groups would stand twice in a page of several figures.
        name = group.attrib.pop("id", "")
        if name.startswith(_TOOLTIP):
            title = ElementTree.Element(f"{{{_SVG}}}title")
            title.text = name.removeprefix(_TOOLTIP)
            group.insert(0, title)
    return ElementTree.tostring(root, encoding="unicode")


def save_figure(
    figure: Figure, stem: Path, kinds: Sequence[str] = ("png", "pdf"), *, dpi: int = 200
) -> list[Path]:
    """Write a figure, as PNG and PDF by default.

    Args:
        figure: what to write.
        stem: the files' path without suffix.
        kinds: suffixes.
        dpi: dots per inch of a PNG.

    Returns:
        The files.

    Raises:
        ResultError: one cannot be written.
    """
    files = [stem.with_name(f"{stem.name}.{kind}") for kind in kinds]
    with warnings.catch_warnings():
        # A name in a script the font lacks shows boxes; that is no reason to alarm.
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        for path, kind in zip(files, kinds, strict=True):
            write_atomic(path, partial(figure.savefig, format=kind, dpi=dpi))
    return files


def write_page(
    folder: str | Path,
    drawn: Mapping[str, tuple[Figure, str]],
    page: Callable[[dict[str, str]], str],
) -> list[Path]:
    """Write figures into `figures/` and the page that shows them, `report.md`.

    Args:
        folder: where; it exists.
        drawn: figure and caption by name.
        page: makes the page's text of caption by path of figure.

    Returns:
        The files written, the page last.

    Raises:
        ResultError: one cannot be written.
    """
    path = Path(folder)
    figures = path / FIGURE_FOLDER
    make_folder(figures)
    written = [
        file for name, (figure, _) in drawn.items() for file in save_figure(figure, figures / name)
    ]
    text = page({f"figures/{name}.png": caption for name, (_, caption) in drawn.items()})
    write_text(path / REPORT, text)
    return [*written, path / REPORT]
