"""Small drawings for pages, as SVG text that scales with the page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape


@dataclass
class Chart:
    """One pair of axes; data go from `x` to `y` limits into a fixed view box.

    Attributes:
        title: read by screen readers.
        x_label, y_label: with units.
        x, y: limits of the data.
        width, height: of the view box.
        left: margin for the labels of the y axis.
    """

    title: str
    x_label: str
    y_label: str
    x: tuple[float, float]
    y: tuple[float, float]
    width: int = 460
    height: int = 290
    left: int = 58
    parts: list[str] = field(default_factory=list)

    _TOP = 14
    _RIGHT = 14
    _BOTTOM = 46

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Place of a point in the view box."""
        across = (x - self.x[0]) / (self.x[1] - self.x[0])
        up = (y - self.y[0]) / (self.y[1] - self.y[0])
        return (
            self.left + across * (self.width - self.left - self._RIGHT),
            self.height - self._BOTTOM - up * (self.height - self._TOP - self._BOTTOM),
        )

    def circle(self, x: float, y: float, radius: float, css: str, note: str = "") -> None:
        """A filled circle."""
        px, py = self.at(x, y)
        self.parts.append(
            f'<circle cx="{px:.1f}" cy="{py:.1f}" r="{radius:.1f}" {css}>{_note(note)}</circle>'
        )

    def cross(self, x: float, y: float, radius: float, css: str, note: str = "") -> None:
        """A diagonal cross."""
        px, py = self.at(x, y)
        a, b, c, d = px - radius, px + radius, py - radius, py + radius
        path = f"M{a:.1f},{c:.1f}L{b:.1f},{d:.1f}M{a:.1f},{d:.1f}L{b:.1f},{c:.1f}"
        self.parts.append(
            f'<path d="{path}" fill="none" stroke-width="2.2" {css}>{_note(note)}</path>'
        )

    def line(self, points: Sequence[tuple[float, float]], css: str) -> None:
        """A polyline."""
        path = " ".join(f"{px:.1f},{py:.1f}" for px, py in (self.at(x, y) for x, y in points))
        self.parts.append(f'<polyline points="{path}" fill="none" {css}/>')

    def bar(self, x0: float, x1: float, y0: float, y1: float, css: str, note: str = "") -> None:
        """A filled rectangle."""
        ax, ay = self.at(x0, y0)
        bx, by = self.at(x1, y1)
        self.parts.append(
            f'<rect x="{min(ax, bx):.1f}" y="{min(ay, by):.1f}" width="{abs(bx - ax):.1f}" '
            f'height="{abs(by - ay):.1f}" {css}>{_note(note)}</rect>'
        )

    def render(
        self,
        *,
        x_ticks: Sequence[tuple[float, str]] | None = None,
        y_ticks: Sequence[tuple[float, str]] | None = None,
    ) -> str:
        """The drawing with its axes."""
        out = [
            f'<svg viewBox="0 0 {self.width} {self.height}" role="img" '
            f'aria-label="{escape(self.title)}"><title>{escape(self.title)}</title>'
        ]
        bottom, top = self.at(self.x[0], self.y[0])[1], self.at(self.x[0], self.y[1])[1]
        right = self.at(self.x[1], self.y[0])[0]
        for value, label in ticks(*self.x) if x_ticks is None else x_ticks:
            px = self.at(value, self.y[0])[0]
            out.append(
                f'<line class="grid" x1="{px:.1f}" x2="{px:.1f}" y1="{bottom:.1f}" y2="{top:.1f}"/>'
                f'<text class="tick" x="{px:.1f}" y="{bottom + 16:.1f}" text-anchor="middle">'
                f"{escape(label)}</text>"
            )
        for value, label in ticks(*self.y) if y_ticks is None else y_ticks:
            py = self.at(self.x[0], value)[1]
            out.append(
                f'<line class="grid" x1="{self.left}" x2="{right:.1f}" y1="{py:.1f}" '
                f'y2="{py:.1f}"/><text class="tick" x="{self.left - 6}" y="{py + 4:.1f}" '
                f'text-anchor="end">{escape(label)}</text>'
            )
        out.extend(self.parts)
        middle = 0.5 * (self.left + right)
        out.append(
            f'<text class="label" x="{middle:.0f}" y="{self.height - 8}" text-anchor="middle">'
            f"{escape(self.x_label)}</text>"
        )
        if self.y_label:
            centre = 0.5 * (top + bottom)
            out.append(
                f'<text class="label" x="14" y="{centre:.0f}" text-anchor="middle" '
                f'transform="rotate(-90 14 {centre:.0f})">{escape(self.y_label)}</text>'
            )
        return "".join(out) + "</svg>"


def ticks(low: float, high: float, count: int = 5) -> list[tuple[float, str]]:
    """Round values within limits, with labels."""
    span = high - low
    raw = span / count
    power = 10.0 ** math.floor(math.log10(raw))
    step = min((m * power for m in (1, 2, 5, 10)), key=lambda s: abs(s - raw))
    first = math.ceil(low / step - 1e-9)
    values = [k * step for k in range(first, math.floor(high / step + 1e-9) + 1)]
    return [(value, f"{value:.6g}") for value in values]


def _note(text: str) -> str:
    return f"<title>{escape(text)}</title>" if text else ""
