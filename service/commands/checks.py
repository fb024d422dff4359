"""The commands that judge the engine: `validate` for its error, `bench` for its speed."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from service.terminal import EXIT_FAILED, EXIT_INVALID, err, fail, out
from service.wording import duration, number

AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]
Html = Annotated[Path | None, typer.Option(help="Write a page with plots to this file.")]
BENCH_COLUMNS = ("case", "size", "time", "throughput", "of bandwidth", "peer", "ratio", "error", "front")
Threads = Annotated[int | None, typer.Option(help="Threads to use; all by default.", min=1)]


def validate(
    ids: Annotated[list[str] | None, typer.Argument(help="Cases to run; all by default.")] = None,
    quick: Annotated[bool, typer.Option("--quick", help="The part that continuous integration runs.")] = False,
    as_json: AsJson = False, html: Html = None, threads: Threads = None,
) -> None:
    """Measure the engine's error against references that nobody here wrote.

    Exit code 0 if every case is at its bar, else 3.
    """
    _prepare()
    from engine.validate.catalogue import UnknownCase, passed, run
    from engine.validate.page import validation_page

    with Progress(SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(),
                  TimeElapsedColumn(), console=err) as progress:
        task = progress.add_task("validate", total=None)
        try:
            result = run(ids or [], quick, threads=threads, on_progress=lambda done, total, case: progress.update(
                task, completed=done, total=total, description=case or "validate"))
        except (UnknownCase, ValueError) as error:
            fail(error, EXIT_INVALID)
    _publish(result, validation_page(result) if html else None, html, as_json, _validation_table)
    if not passed(result):
        raise typer.Exit(EXIT_FAILED)


def bench(
    names: Annotated[list[str] | None, typer.Argument(help="Benchmarks to run; all by default.")] = None,
    as_json: AsJson = False, html: Html = None, threads: Threads = None,
) -> None:
    """Measure the engine's speed: throughput, share of bandwidth, scaling, and the ratio to peers."""
    _prepare()
    from engine.bench.page import bench_page
    from engine.bench.suite import UnknownBenchmark, run

    with Progress(SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn(), console=err) as progress:
        task = progress.add_task("measuring", total=None)
        try:
            results = run(names or [], threads=threads, on_progress=lambda benchmark, case: progress.update(
                task, description=f"{benchmark}: {case} done"))
        except (UnknownBenchmark, ValueError) as error:
            fail(error, EXIT_INVALID)
    _publish(results, bench_page(results) if html else None, html, as_json, _bench_tables)


def _prepare() -> None:
    from engine.run.compile_cache import prepare_compile_cache

    prepare_compile_cache()  # before anything imports numba


def _publish(result: Any, page: str | None, html: Path | None, as_json: bool, tables: Any) -> None:
    if html is not None and page is not None:
        html.write_text(page, encoding="utf-8")
        err.print(f"page {escape(str(html))}", soft_wrap=True)
    if as_json:
        print(json.dumps(result, indent=2))
        return
    for table in tables(result):
        out.print(table)


def _validation_table(result: dict[str, Any]) -> list[Table]:
    table = Table(box=None)
    for column in ("case", "", "error", "bar", "order", "runs", "time", "note"):
        table.add_column(column, justify="right" if column in ("error", "bar", "order", "runs", "time") else "left")
    for case in result["cases"]:
        verdict = "[green]pass[/]" if case["status"] == "pass" else "[bold red]fail[/]"
        table.add_row(case["id"], verdict, number(case["error"]), number(case["bar"]), number(case["order"]),
                      str(len(case["rows"])), duration(sum(row["seconds"] for row in case["rows"])),
                      escape(case["note"]))
    return [table]


def _bench_tables(results: list[dict[str, Any]]) -> list[Table]:
    tables = []
    for result in results:
        exponent = f", scaling exponent {result['exponent']:.2f}" if result["exponent"] is not None else ""
        note = f", [red]{escape(result['note'])}[/]" if result["note"] else ""
        table = Table(title=f"[bold]{result['name']}[/]: {escape(result['summary'])}{exponent}{note}", box=None,
                      title_justify="left")
        cells = [_bench_cells(row) for row in result["rows"]]
        filled = [k for k in range(len(BENCH_COLUMNS)) if not cells or any(row[k] for row in cells)]
        for k in filled:
            table.add_column(BENCH_COLUMNS[k], justify="left" if BENCH_COLUMNS[k] in ("case", "peer", "front") else "right")
        for row in cells:
            table.add_row(*(row[k] for k in filled))
        tables.append(table)
    return tables


def _bench_cells(row: dict[str, Any]) -> list[str]:
    """Return what the table says of a measurement, for each of BENCH_COLUMNS; empty where that is nothing."""
    share = "" if row["bandwidth_share"] is None else f"{100 * row['bandwidth_share']:.0f} %"
    ratio = "" if row["ratio"] is None else f"{row['ratio']:.3g}"
    error = "" if row["error"] is None else number(row["error"])
    front = [word for key, word in (("default", "default"), ("on_front", "on it")) if (row["standing"] or {}).get(key)]
    return [row["case"], number(row["size"]), duration(row["seconds"]), f"{number(row['throughput'])} {row['unit']}", share,
            row["peer"] or "", ratio, error, ", ".join(front)]
