"""The catalogue's result as one HTML page: per case a table and a plot of error against seconds."""

from html import escape

from engine.validate.html import number, page, table
from engine.validate.plot import Series, loglog


def validation_page(result: dict) -> str:
    """Return the page for a result of `engine.validate.catalogue.run`, self-contained."""
    entries, machine = result["cases"], result["machine"]
    passing = sum(entry["status"] == "pass" for entry in entries)
    lead = [
        f"{passing} of {len(entries)} cases are at their bar. Each plot shows what a smaller error costs.",
        f"{machine['cpu']}, {machine['threads']} threads; "
        + ", ".join(f"{name} {version}" for name, version in machine["versions"].items()),
    ]
    return page("Strandline validation", lead, [_section(entry) for entry in entries])


def _section(entry: dict) -> str:
    status = entry["status"]
    mark = {"pass": "✓ pass", "fail": "✗ fail"}[status]
    judged = f"error {number(entry['error'])}, bar {number(entry['bar'])}"
    if entry["order"] is not None:
        judged += f"; order {number(entry['order'])}"
    if entry["order_bar"] is not None:
        judged += f", at least {number(entry['order_bar'])}"
    rows = [[row["knob"], *(number(row[name]) for name in ("value", "error", "seconds"))] for row in entry["rows"]]
    note = f"<p>{escape(entry['note'])}</p>" if entry["note"] else ""
    identity = escape(entry["id"], quote=True)
    return (
        f'<section aria-labelledby="{identity}"><div class="head"><h2 id="{identity}">{identity}</h2>'
        f'<span class="status {status}">{mark}</span><span class="soft">{escape(judged)}</span></div>'
        f"<p>{escape(entry['summary'])}</p>{note}"
        f'<div class="pair">{loglog(_title(entry), "seconds", "error", _series(entry["rows"]), entry["bar"])}'
        f"{table('What each setting cost and bought', ['knob', 'value', 'error', 'seconds'], rows)}</div></section>"
    )


def _title(entry: dict) -> str:
    return f"{entry['id']}: error against seconds, both logarithmic"


def _series(rows: list[dict]) -> list[Series]:
    """One series per knob, in the order in which they first appear."""
    series = []
    for knob in dict.fromkeys(row["knob"] for row in rows):
        own = [row for row in rows if row["knob"] == knob]
        labels = [
            f"{knob} = {number(row['value'])}: error {number(row['error'])}, {number(row['seconds'])} s" for row in own
        ]
        series.append(Series(knob, [row["seconds"] for row in own], [row["error"] for row in own], labels))
    return series
