"""The self-contained HTML page that results stand on, light or dark as its reader prefers."""

from html import escape

STYLE = """
:root { color-scheme: light dark;
  --page: #fbfaf7; --card: #ffffff; --ink: #1d2329; --soft: #5b6570; --line: #dcd9d1; --grid: #ebe8e1;
  --pass: #14713d; --fail: #b3261e; --s0: #1f63c6; --s1: #b4540a; --s2: #0b7a6a; --s3: #8b3fb0; }
@media (prefers-color-scheme: dark) { :root {
  --page: #14171b; --card: #1c2127; --ink: #e8eaed; --soft: #a4adb7; --line: #323942; --grid: #2a3038;
  --pass: #5fce8d; --fail: #ff8a80; --s0: #7db1ff; --s1: #ffb066; --s2: #56d3c0; --s3: #d7a1f2; } }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 76rem; padding: 2rem 1.25rem 4rem; background: var(--page); color: var(--ink);
  font: 16px/1.5 system-ui, sans-serif; }
h1 { margin: 0; font-size: 1.7rem; } h2 { margin: 0; font-size: 1.1rem; font-family: ui-monospace, monospace; }
p { margin: .35rem 0; } .soft { color: var(--soft); }
section { margin-top: 1.25rem; padding: 1.1rem 1.25rem; background: var(--card); border: 1px solid var(--line);
  border-radius: 12px; }
.head { display: flex; gap: .75rem; align-items: baseline; flex-wrap: wrap; }
.status { font-weight: 650; } .pass { color: var(--pass); } .fail { color: var(--fail); }
.pair { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 26rem), 1fr)); gap: 1.25rem;
  align-items: start; margin-top: .75rem; }
.scroll { overflow-x: auto; } table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
caption { text-align: left; color: var(--soft); padding-bottom: .3rem; }
th, td { padding: .28rem .6rem; border-bottom: 1px solid var(--grid); text-align: right; white-space: nowrap; }
th:first-child, td:first-child { text-align: left; } thead th { color: var(--soft); font-weight: 600; }
svg { width: 100%; max-width: 40rem; height: auto; display: block; } svg text { fill: var(--soft); font-size: 12px; }
.grid { stroke: var(--grid); } .frame { stroke: var(--line); fill: none; }
.bar { stroke: var(--fail); stroke-dasharray: 6 4; } svg text.barname { fill: var(--fail); }
"""


def page(title: str, lead: list[str], sections: list[str]) -> str:
    """Return a whole HTML page that needs no other file; `lead` is plain text, `sections` are HTML."""
    paragraphs = "".join(f'<p class="soft">{escape(line)}</p>' for line in lead)
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><style>{STYLE}</style></head>\n'
        f"<body><header><h1>{escape(title)}</h1>{paragraphs}</header><main>\n"
        + "\n".join(sections)
        + "\n</main></body></html>\n"
    )


def table(caption: str, columns: list[str], rows: list[list[str]]) -> str:
    """Return an HTML table of plain-text cells."""
    head = "".join(f'<th scope="col">{escape(column)}</th>' for column in columns)
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return (
        f'<div class="scroll"><table><caption>{escape(caption)}</caption><thead><tr>{head}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>"
    )


def number(value: float | None) -> str:
    """Return a number as pages show it: whole ones in full up to a million, others to three digits, a dash for none."""
    if value is None:
        return "–"
    return f"{value:.0f}" if value == round(value) and abs(value) <= 1e6 else f"{value:.3g}"
