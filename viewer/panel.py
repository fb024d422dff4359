"""The controls beside the 3D picture: which job, which moment, what to show, and how the solver did."""

from dataclasses import dataclass
from html import escape
from typing import get_args

import numpy as np
import viser
from numpy.typing import NDArray
from viser import uplot

from engine.run.frames import Frame
from viewer import layers
from viewer.detail import Level
from viewer.layers import Paint
from viewer.scales import SCALES, WITHIN, Scale, colours_of, written_ends
from viewer.stage import Shown
from viewer.timeline import Timeline

SPEEDS = {"1/8": 0.125, "1/4": 0.25, "1/2": 0.5, "1": 1.0, "2": 2.0, "4": 4.0}
PAINTS: dict[str, Paint] = {
    "fabric": "fabric", "group": "group", "stretch strain": "strain", "curvature": "curvature", "contact force": "force",
    "liquid": "liquid", "speed": "speed", "pressure": "pressure", "shear stress": "shear", "yielding": "yielded",
}
YARN_PAINTS = ("fabric", "stretch strain")  # offered before there is a frame
LEVELS: dict[str, Level] = {level: level for level in get_args(Level)}
YARNS_HINT = "at their real radius, over and under each other"
STRANDS_HINT = "where they are; at their real radius where that can be seen, or a region or everything is shown"
LIQUID_HINT = "particles as balls of their volume, or the surface"
SURFACE_HINT = "in place of the particles, where colours say nothing of these"
NO_JOB = "none"
BRAND = (64, 92, 122)

@dataclass(frozen=True)
class Curve:
    """One line of a plot."""

    key: str  # in the frames' series
    label: str
    colour: str
    logarithmic: bool = False  # plot the decimal logarithm


PLOTS = {
    "Newton residual, log10": (Curve("residual", "of the force scale", "#007656", logarithmic=True),),
    "Newton iterations": (Curve("newton_iterations", "last step", "#2662d9"),),
    "Contacts": (
        Curve("eol_intra", "EoL in fabrics", "#8a8f98"),
        Curve("eol_inter", "EoL between", "#cc79a7"),
        Curve("eil", "EIL", "#de1920"),
    ),
    "Widest gap, log10": (Curve("contact_gap", "of EIL contacts, in radii", "#cc79a7", logarithmic=True),),
    "Contacts of strands": (Curve("contacts", "at the end of a step", "#d7302a"),),
    "Deepest overlap, log10": (Curve("contact_gap", "in radii", "#cc79a7", logarithmic=True),),
    "Iterations for pressure": (Curve("linear_iterations", "last step", "#2662d9"),),
    "Particles": (Curve("particles", "at the end of a step", "#4089c4"),),
}
OF_NEWTON = {"Newton residual, log10", "Newton iterations"}
OF_YARNS = OF_NEWTON | {"Contacts", "Widest gap, log10"}  # plots that make sense for one of them only
OF_STRANDS = OF_NEWTON | {"Contacts of strands", "Deepest overlap, log10"}
OF_LIQUIDS = {"Iterations for pressure", "Particles"}


class Panel:
    """The widgets of one page. They hold what the visitor chose; the session reads them on its own thread."""

    def __init__(self, gui: viser.GuiApi):
        gui.set_panel_label("Strandline")
        gui.configure_theme(control_width="medium", brand_color=BRAND, show_logo=False, show_share_button=False)
        self.job = gui.add_dropdown("Job", (NO_JOB,), initial_value=NO_JOB)
        self.status = gui.add_html("")
        self.frame = gui.add_slider("Frame", min=0, max=1, step=1, initial_value=0)
        self.step = gui.add_button_group("Step", ("first", "back", "next", "last"))
        self.play = gui.add_button("Play", icon=viser.Icon.PLAYER_PLAY)
        self.speed = gui.add_dropdown("Speed ×", tuple(SPEEDS), initial_value="1", hint="against the simulated time")
        self.follow = gui.add_checkbox("Follow", False, hint="show each new frame as it is written")
        tabs = gui.add_tab_group()
        with tabs.add_tab("Show"):
            self.lines = gui.add_checkbox("Yarns", True, hint=YARNS_HINT)
            self.nodes = gui.add_checkbox("Nodes", False, hint="on thin yarns, both where they are computed")
            self.surface = gui.add_checkbox("Surface", True, hint=SURFACE_HINT, visible=False)
            self.obstacles = gui.add_checkbox("Obstacles", True)
            self.paint = gui.add_dropdown("Colour by", YARN_PAINTS, initial_value="fabric")
            self.level = gui.add_dropdown("Detail", tuple(LEVELS), initial_value="auto", hint=(
                "auto: large cloth as a coarser one of the same weave, of many strands or particles some; fine: less so, for a "
                "graphics card; region: what is near the middle of the picture as it is, to zoom in on; full: everything, slow"
            ))
            self.drawn = gui.add_html("")
            self.legend = gui.add_html(yarn_legend("fabric"))
            self.refit = gui.add_button("Fit view", icon=viser.Icon.FOCUS_2, color="gray")
        with tabs.add_tab("Solver"):
            self.solver = gui.add_html("")
            self._plots = {title: _plot(gui, title, curves) for title, curves in PLOTS.items()}
        self._show_plots(OF_YARNS)

    def shown(self, focus: tuple[float, float, float]) -> Shown:
        """Return what the visitor wants to see; `focus` is the middle of a region [m]."""
        paint, level = PAINTS[self.paint.value], LEVELS[self.level.value]
        nodes = self.nodes.value and self.nodes.visible
        return Shown(self.lines.value, nodes, self.obstacles.value, paint, level, focus, self.surface.value)

    def offer(self, frame: Frame) -> None:
        """Offer what there is to see of such frames; the colours chosen stay chosen where they say something of them."""
        self.lines.label, self.lines.hint, plots = (
            ("Liquid", LIQUID_HINT, OF_LIQUIDS) if frame.liquid is not None
            else ("Strands", STRANDS_HINT, OF_STRANDS) if frame.strands is not None
            else ("Yarns", YARNS_HINT, OF_YARNS)
        )
        self.nodes.visible = frame.strands is None and frame.liquid is None
        self.surface.visible = frame.liquid is not None and len(frame.liquid.surface_faces) > 0
        options = tuple(label for label, paint in PAINTS.items() if paint in layers.paints_of(frame))
        if self.paint.options != options:
            self.paint.options = options
        self._show_plots(plots)

    def set_jobs(self, ids: list[str]) -> None:
        """Offer these jobs, in this order; the chosen one stays chosen."""
        options = tuple(ids) or (NO_JOB,)
        if self.job.options != options:
            self.job.options = options

    def show_timeline(self, timeline: Timeline) -> None:
        """Let slider, play button and follow box say what the timeline does."""
        self.frame.value = timeline.index  # type: ignore[misc]  # settable: mypy loses the setter in viser's inheritance
        self.follow.value = timeline.follow  # type: ignore[misc]  # settable: mypy loses the setter in viser's inheritance
        self.play.label = "Pause" if timeline.playing else "Play"
        self.play.icon = viser.Icon.PLAYER_PAUSE if timeline.playing else viser.Icon.PLAYER_PLAY

    def set_frame_count(self, count: int) -> None:
        """Let the timeline reach over `count` frames."""
        self.frame.disabled = count < 2
        self.frame.max = max(count - 1, 1)

    def set_plots(self, times: list[float], series: list[dict[str, float]]) -> None:
        """Plot the series of all frames over their times [s]."""
        x = np.array(times, np.float64)
        for title, plot in self._plots.items():
            values = [_values(curve, series) for curve in PLOTS[title]]
            there = np.isfinite(values).any(axis=0)  # a plot of something that is not a number would be empty
            plot.data = (x[there], *(of_curve[there] for of_curve in values))

    def _show_plots(self, titles: set[str]) -> None:
        for title, plot in self._plots.items():
            plot.visible = title in titles


def drawn_html(statement: str) -> str:
    """Return what is drawn, as quiet text."""
    return f'<div style="font-size:.78em;color:#5f6670;padding:.1em .8em">{escape(statement)}</div>'


def solver_html(frame: Frame) -> str:
    """Return how the step went that ended with a frame, as rows of names and numbers; of the first frame, nothing."""
    series = frame.series
    said = {
        "step": (f"{1e3 * series.get('dt', 0.0):.3g} ms", "dt"),
        "Newton iterations": (f"{series.get('newton_iterations', 0.0):.0f}", "newton_iterations"),
        "of conjugate gradients" if frame.liquid is None else "iterations for pressure":
            (f"{series.get('linear_iterations', 0.0):.0f}", "linear_iterations"),
        "residual, of the force scale": (f"{series.get('residual', 0.0):.2g}", "residual"),
        "particles": (f"{series.get('particles', 0.0):,.0f}", "particles"),
        "contacts": (f"{series.get('contacts', 0.0):,.0f}", "contacts"),
        "widest gap" if frame.strands is None else "deepest overlap":
            (f"{series.get('contact_gap', 0.0):.2g} radii", "contact_gap"),
    }  # fmt: skip
    rows = (f'<div style="display:flex;justify-content:space-between"><span>{name}</span><b>{value}</b></div>'
            for name, (value, key) in said.items() if key in series and frame.step)
    return f'<div style="font-size:.8em;padding:.2em .8em;font-variant-numeric:tabular-nums">{"".join(rows)}</div>'


def legend_html(frame: Frame, paint: Paint) -> str:
    """Return the key to the colours of a frame."""
    if frame.liquid is not None:
        paint = layers.paint_among(layers.LIQUID_PAINTS, paint)
        return liquid_legend(paint, layers.paint_limit(frame.liquid, paint))
    if frame.strands is None:
        return yarn_legend(paint)
    if paint == "force" and not frame.strands.contact_force.any():
        return _key(["<div>nothing touches</div>"])
    return strand_legend(paint, layers.paint_limit(frame.strands, paint))


def yarn_legend(paint: Paint) -> str:
    """Return the key to the colours of nodes, and of strain where yarns are painted by it."""
    rows = [_dot(layers.NODE_COLOURS[state], label) for state, label in layers.NODE_LABELS.items()]
    if paint == "strain":
        rows.append(_bar(SCALES["strain"], layers.STRAIN_LIMIT))
    return _key(rows)


def strand_legend(paint: Paint, limit: float) -> str:
    """Return the key to the colours of strands, whose scale ends at `limit`."""
    if paint == "group":
        return _key(["<div>a colour for each group, each strand in a shade of its own</div>"])
    return _numbers(SCALES[paint], limit)


def liquid_legend(paint: Paint, limit: float) -> str:
    """Return the key to the colours of liquid, whose scale ends at `limit`."""
    if paint == "liquid":
        return ""
    if paint == "yielded":
        return _key([_dot(tuple(colour), label) for colour, label in
                     zip(layers.YIELD_COLOURS.tolist(), layers.YIELD_LABELS, strict=True)])
    return _numbers(SCALES[paint], limit)


def _key(rows: list[str]) -> str:
    return f'<div style="font-size:.8em;line-height:1.6;padding:.2em .4em">{"".join(rows)}</div>'


def _numbers(scale: Scale, limit: float) -> str:
    return _key([_bar(scale, limit), f"<div>{escape(scale.label)}, with {WITHIN}% of the frame in this range</div>"])


def _dot(colour: tuple[int, ...], label: str) -> str:
    """Return a row that says what a colour means."""
    return (
        f'<div><span style="display:inline-block;width:.8em;height:.8em;border-radius:50%;margin:0 .5em;'
        f'border:1px solid #9aa0a6;background:{_css(colour)}"></span>{escape(label)}</div>'
    )


def _bar(scale: Scale, limit: float) -> str:
    """Return a strip of the scale's colours with the numbers at its ends."""
    low = -limit if scale.signed else 0.0
    stops = ",".join(_css(tuple(c)) for c in colours_of(np.linspace(low, limit, 9), scale, limit).tolist())
    first, last = written_ends(scale, limit)
    ends = (first, "0", last) if scale.signed else (first, last)
    return (
        f'<div style="margin:.5em .5em 0"><div style="height:.7em;background:linear-gradient(90deg,{stops})"></div>'
        f'<div style="display:flex;justify-content:space-between">{"".join(f"<span>{end}</span>" for end in ends)}</div></div>'
    )


def status_html(title: str, detail: str) -> str:
    """Return one strong and one quiet line of text."""
    return (
        f'<div style="padding:.2em .8em;font-variant-numeric:tabular-nums"><b>{escape(title)}</b>'
        f'<div style="font-size:.78em;color:#5f6670">{escape(detail)}</div></div>'
    )


def _values(curve: Curve, series: list[dict[str, float]]) -> NDArray[np.float64]:
    values = np.array([entry.get(curve.key, np.nan) for entry in series])
    # a residual of exactly zero has no logarithm
    return np.log10(values, out=np.full_like(values, np.nan), where=values > 0) if curve.logarithmic else values


def _plot(gui: viser.GuiApi, title: str, curves: tuple[Curve, ...]) -> viser.GuiUplotHandle:
    lines = (uplot.Series(label=c.label, stroke=c.colour, width=1.5, points={"show": False}) for c in curves)
    series = (uplot.Series(label="time [s]"), *lines)
    return gui.add_uplot(
        data=tuple(np.zeros(1) for _ in series),
        series=series,
        title=title,
        scales={"x": uplot.Scale(time=False)},  # dates otherwise
        height=170,
    )


def _css(colour: tuple[int, ...]) -> str:
    return "rgb({},{},{})".format(*colour)
