"""Log-log plots as SVG, in the colours of the page of `engine.validate.html`."""

from dataclasses import dataclass
from html import escape
from itertools import pairwise
from math import ceil, floor, isfinite, log10

WIDTH, HEIGHT = 560, 320
LEFT, RIGHT, TOP, BOTTOM = 74, 16, 30, 52
LINE = 18  # of the legend
SERIES_COLOURS = 4  # further series have hollow markers


@dataclass(frozen=True)
class Series:
    """Points of one kind, with a label for each; only points with two positive coordinates are drawn."""

    name: str
    x: list[float | None]
    y: list[float | None]
    labels: list[str]

    def drawable(self) -> list[tuple[float, float, str]]:
        """Return the points that have logarithms, in their order."""
        triples = zip(self.x, self.y, self.labels, strict=True)
        return [(x, y, label) for x, y, label in triples if x and y and 0 < x and 0 < y and isfinite(x * y)]


def loglog(title: str, x_name: str, y_name: str, series: list[Series], bar: float | None = None) -> str:
    """Return an SVG plot; `bar` is a dashed horizontal line. Where nothing has a logarithm, a sentence instead."""
    drawn = [(entry.name, entry.drawable()) for entry in series if entry.drawable()]
    if not drawn:
        return '<p class="soft">Nothing to plot: no point has both a positive error and a positive time.</p>'
    xs = [x for _, points in drawn for x, _, _ in points]
    ys = [y for _, points in drawn for _, y, _ in points] + ([bar] if bar and bar > 0 else [])
    across, up = _Axis(xs, LEFT, WIDTH - RIGHT), _Axis(ys, HEIGHT - BOTTOM, TOP)
    parts = [_grid(across, up, x_name, y_name)]
    if bar and bar > 0:
        y = up.place(bar)
        parts.append(f'<line class="bar" x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{y:.1f}" y2="{y:.1f}"/>')
        parts.append(f'<text class="barname" x="{WIDTH - RIGHT - 4}" y="{y - 5:.1f}" text-anchor="end">bar</text>')
    parts += [
        _curve(index, [(across.place(x), up.place(y), label) for x, y, label in points])
        for index, (_, points) in enumerate(drawn)
    ]
    legend, lines = _legend([name for name, _ in drawn] if len(drawn) > 1 else [])
    lower = LINE * max(0, lines - 1)
    return (
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT + lower}" role="img" aria-label="{escape(title)}; the table holds the numbers">'
        f'{legend}<g transform="translate(0 {lower})">' + "".join(parts) + "</g></svg>"
    )


class _Axis:
    """A logarithmic axis whose ends are pixels `first` and `last`."""

    def __init__(self, values: list[float], first: float, last: float):
        self.low, self.high = log10(min(values)) - 0.08, log10(max(values)) + 0.08
        if self.high - self.low < 0.5:  # a few nearly equal values: show their neighbourhood, not their noise
            middle = (self.low + self.high) / 2
            self.low, self.high = middle - 0.25, middle + 0.25
        self.first, self.last = first, last

    def place(self, value: float) -> float:
        return self.first + (log10(value) - self.low) / (self.high - self.low) * (self.last - self.first)

    def ticks(self) -> list[float]:
        decades = range(floor(self.low), ceil(self.high) + 1)
        every = max(1, round((self.high - self.low) / 6))
        steps = (1, 2, 5) if self.high - self.low < 1.7 else (1,)
        candidates = [(m * 10.0**k, k) for k in decades for m in steps if k % every == 0]
        return [value for value, _ in candidates if self.low <= log10(value) <= self.high]


def _grid(across: _Axis, up: _Axis, x_name: str, y_name: str) -> str:
    bottom, right = HEIGHT - BOTTOM, WIDTH - RIGHT
    parts = []
    for value in across.ticks():
        x = across.place(value)
        parts.append(f'<line class="grid" x1="{x:.1f}" x2="{x:.1f}" y1="{TOP}" y2="{bottom}"/>')
        parts.append(f'<text x="{x:.1f}" y="{bottom + 17}" text-anchor="middle">{_tick(value)}</text>')
    for value in up.ticks():
        y = up.place(value)
        parts.append(f'<line class="grid" x1="{LEFT}" x2="{right}" y1="{y:.1f}" y2="{y:.1f}"/>')
        parts.append(f'<text x="{LEFT - 8}" y="{y + 4:.1f}" text-anchor="end">{_tick(value)}</text>')
    parts.append(f'<rect class="frame" x="{LEFT}" y="{TOP}" width="{right - LEFT}" height="{bottom - TOP}"/>')
    middle = (TOP + bottom) / 2
    parts.append(f'<text x="{(LEFT + right) / 2}" y="{HEIGHT - 12}" text-anchor="middle">{escape(x_name)}</text>')
    turned = f'transform="rotate(-90 16 {middle})" x="16" y="{middle}" text-anchor="middle"'
    parts.append(f"<text {turned}>{escape(y_name)}</text>")
    return "".join(parts)


def _curve(index: int, points: list[tuple[float, float, str]]) -> str:
    lines = "".join(
        f'<line x1="{a[0]:.1f}" y1="{a[1]:.1f}" x2="{b[0]:.1f}" y2="{b[1]:.1f}"/>' for a, b in pairwise(points)
    )
    marks = "".join(f"<g>{_mark(index, x, y)}<title>{escape(label)}</title></g>" for x, y, label in points)
    return f'<g {_colours(index)} stroke-width="2" stroke-linecap="round">{lines}{marks}</g>'


def _colours(index: int) -> str:
    colour = f"var(--s{index % SERIES_COLOURS})"
    return f'stroke="{colour}" fill="{colour if index < SERIES_COLOURS else "var(--card)"}"'


def _mark(index: int, x: float, y: float) -> str:
    """A marker whose shape tells series apart without colour."""
    shape = index % SERIES_COLOURS
    if shape == 0:
        return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4"/>'
    if shape == 1:
        return f'<rect x="{x - 4:.1f}" y="{y - 4:.1f}" width="8" height="8"/>'
    if shape == 2:
        return f'<path d="M{x:.1f} {y - 5:.1f} l5 9 h-10 z"/>'
    return f'<path d="M{x:.1f} {y - 5:.1f} l5 5 l-5 5 l-5 -5 z"/>'


def _legend(names: list[str]) -> tuple[str, int]:
    """Markers and names in lines above the plot, and how many lines."""
    parts, x, lines = [], float(LEFT + 5), 1
    for index, name in enumerate(names):
        width = 34 + 6.8 * len(name)  # about the width of a letter
        if x + width > WIDTH and index > 0:
            x, lines = float(LEFT + 5), lines + 1
        y = TOP - 16 + LINE * (lines - 1)
        parts.append(f"<g {_colours(index)}>{_mark(index, x, y)}</g>")
        parts.append(f'<text x="{x + 11:.1f}" y="{y + 4}">{escape(name)}</text>')
        x += width
    return "".join(parts), lines


def _tick(value: float) -> str:
    """A tick's label; far from one, only the power of ten."""
    return f"{value:g}" if 1e-3 <= value < 1e4 else f"{value:.0e}".replace("e+0", "e").replace("e-0", "e-")
