"""Benchmark results as one HTML page: per benchmark a table, plots of seconds by size, of error by seconds and iterations."""

from html import escape
from itertools import product

from engine.validate.html import number, page, table
from engine.validate.plot import Series, loglog

_COLUMNS = [
    "case", "size", "seconds", "throughput", "unit", "bandwidth_share", "peer", "peer_seconds", "ratio", "error",
]


def bench_page(results: list[dict]) -> str:
    """Return the page for the results of `engine.bench.suite.run`, self-contained."""
    lead = ["Medians of repeated runs; where solvers converge, single ones."]
    if results:
        machine = results[0]["machine"]
        lead.append(
            f"{machine['cpu']}, {machine['threads']} threads, "
            f"{machine['bandwidth_bytes_per_s'] / 1e9:.1f} GB/s measured by a triad"
        )
    return page("Strandline benchmarks", lead, [_section(result) for result in results])


def _section(result: dict) -> str:
    name = escape(result["name"], quote=True)
    details = list(dict.fromkeys(key for row in result["rows"] for key in row["details"]))
    shown = [column for column in _COLUMNS if any(row[column] is not None for row in result["rows"])]
    rows = [
        [_cell(row[column]) for column in shown] + [number(row["details"].get(key)) for key in details]
        for row in result["rows"]
    ]
    ranked = any(row["standing"] for row in result["rows"])
    if ranked:
        rows = [[case, _standing(row["standing"]), *cells] for (case, *cells), row in zip(rows, result["rows"], strict=True)]
        shown.insert(1, "front")
    columns = [column.replace("_", " ") for column in (*shown, *details)]
    exponent = "" if result["exponent"] is None else f"seconds grow as size to the power {result['exponent']:.2f}"
    note = f'<p class="fail">{escape(result["note"])}</p>' if result["note"] else ""
    if ranked:
        plots = _errors(result["rows"], {"seconds": "seconds"})
    else:
        title = f"{result['name']}: seconds against size, both logarithmic"
        plots = [loglog(title, "size", "seconds", _series([row for row in result["rows"] if not row["converging"]]))]
        plots += _errors([row for row in result["rows"] if row["converging"]], {"size": "iterations", "seconds": "seconds"})
    return (
        f'<section aria-labelledby="{name}"><div class="head"><h2 id="{name}">{name}</h2>'
        f'<span class="soft">{exponent}</span></div><p>{escape(result["summary"])}</p>{note}'
        f'<div class="pair">{"".join(plots)}</div>'
        f"{table('What was measured', columns, rows)}</section>"
    )


def _standing(standing: dict[str, bool]) -> str:
    return ", ".join(word for key, word in (("default", "default"), ("on_front", "on it")) if standing[key])


def _cell(value: float | str | None) -> str:
    return value if isinstance(value, str) else number(value)


def _errors(rows: list[dict], axes: dict[str, str]) -> list[str]:
    """Plots of error, one per scene and axis, with a series for every other knob; a case is "scene, knob".

    `axes` are keys of rows, with the names that they have in plots.
    """
    plots = []
    scenes = dict.fromkeys(row["case"].split(", ")[0] for row in rows)
    for scene, (key, name) in product(scenes, axes.items()):
        series = []
        for case in dict.fromkeys(row["case"] for row in rows if row["case"].startswith(f"{scene}, ")):
            own = [row for row in rows if row["case"] == case]
            labels = [f"{case}, {number(row['size'])} {row['unit'].removesuffix('/s')}: {number(row['seconds'])} s, "
                      f"error {number(row['error'])}"
                      + (", the default" if row["standing"] and row["standing"]["default"] else "") for row in own]
            series.append(Series(case.removeprefix(f"{scene}, "), [row[key] for row in own],
                                 [row["error"] for row in own], labels))
        plot = loglog(f"{scene}: error against {name}", name, "error", series)
        plots.append(f"<div><h3>{escape(scene)}</h3>{plot}</div>")
    return plots


def _series(rows: list[dict]) -> list[Series]:
    """One series per case, and one per peer of a case."""
    series = []
    for case in dict.fromkeys(row["case"] for row in rows):
        own = [row for row in rows if row["case"] == case]
        sizes = [row["size"] for row in own]
        for name, key in ((case, "seconds"), (f"{case}, {own[0]['peer']}", "peer_seconds")):
            if any(row[key] is not None for row in own):
                labels = [f"{name}, size {number(row['size'])}: {number(row[key])} s" for row in own]
                series.append(Series(name, sizes, [row[key] for row in own], labels))
    return series
