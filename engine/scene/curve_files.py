"""Strands given as curves in files: lines of OBJ, tables of CSV."""

import csv
from collections.abc import Iterable
from math import isfinite
from pathlib import Path
from typing import Any

from engine.scene.beside import read_beside
from engine.scene.problems import Problem, SceneError, shown

CURVE_TYPES = ("obj", "csv")
CURVE_FILE_LIMIT = 16_000_000  # bytes
CURVE_POINT_LIMIT = 100_000  # of all curves of a scene together, so that the scene with them in it can be read again
COLUMNS = ("strand", "x", "y", "z")

Place = tuple[float, float, float]


class _NoCurvesError(ValueError):
    """What is wrong with a file."""


def read_curve_files(document: Any, directory: Path | None) -> None:
    """Replace `file` of every group of strands in a scene's `document` by the curves in it.

    Files are looked up in `directory`, as those of meshes are. Raises SceneError.
    """
    groups = document.get("strands")
    for i, entry in enumerate(groups if isinstance(groups, list) else []):
        if directory is None or not isinstance(entry, dict) or entry.get("curves") or entry.get("groom"):
            continue
        if isinstance(name := entry.get("file"), str):
            entry["curves"] = _read(f"strands[{i}].file", name, directory)
            del entry["file"]


def _read(path: str, name: str, directory: Path) -> list[list[Place]]:
    """Read the curves of a file; `path` is where the scene names it."""
    content, kind = read_beside(path, name, directory, CURVE_TYPES, CURVE_FILE_LIMIT)
    lines = content.decode("utf-8-sig", "replace").splitlines()
    try:
        curves = curves_of_obj(lines) if kind == "obj" else curves_of_csv(lines)
        if not curves:
            raise _NoCurvesError("it has no curves")
    except (_NoCurvesError, csv.Error) as error:
        raise SceneError([Problem(path, f"{shown(name)} cannot be read as {kind}: {error}")]) from None
    return curves


def curves_of_obj(lines: Iterable[str]) -> list[list[Place]]:
    """Return the points [m] of the lines of an OBJ file; a line that begins where the one before ended goes on with it."""
    places: list[Place] = []
    runs: list[tuple[int, list[int]]] = []  # the line of the file at which each begins, and its points
    joined = 0
    for number, line in enumerate(lines, 1):
        key, *values = line.partition("#")[0].split(maxsplit=CURVE_POINT_LIMIT + 1) or [""]
        if key == "v":
            places.append(_place(values[:3], number))
        elif key == "l":
            joined += len(values)
            _check_count(joined)
            run = [_index(value, len(places), number) for value in values]
            if len(run) < 2:
                raise _NoCurvesError(f"line {number} joins fewer than two points")
            if runs and runs[-1][1][-1] == run[0]:
                runs[-1][1].extend(run[1:])
                joined -= 1
            else:
                runs.append((number, run))
        _check_count(len(places))
    for number, run in runs:
        if not all(0 <= index < len(places) for index in run):
            raise _NoCurvesError(f"line {number} joins points that are not there")
    return [[places[index] for index in run] for _, run in runs]


def curves_of_csv(lines: Iterable[str]) -> list[list[Place]]:
    """Return the points [m] of every strand of a table with the columns strand, x, y, z, in the order of its lines."""
    table = csv.DictReader(lines)
    if missing := [column for column in COLUMNS if column not in (table.fieldnames or ())]:
        raise _NoCurvesError(f"its first line does not name the column {missing[0]}")
    curves: dict[str, list[Place]] = {}
    for count, line in enumerate(table, 1):
        _check_count(count)
        if line["strand"] is None:
            raise _NoCurvesError(f"line {table.line_num} is of no strand")
        curves.setdefault(line["strand"], []).append(_place([line[column] for column in "xyz"], table.line_num))
    return list(curves.values())


def _place(values: list[Any], number: int) -> Place:
    try:
        x, y, z = map(float, values)
    except (TypeError, ValueError):
        raise _NoCurvesError(f"line {number} has no three numbers") from None
    if not (isfinite(x) and isfinite(y) and isfinite(z)):
        raise _NoCurvesError(f"line {number} has a number that is not finite")
    return x, y, z


def _index(value: str, places: int, number: int) -> int:
    """Index of a point of an OBJ line, which counts from 1, or backwards from the last one that was given."""
    try:
        index = int(value.split("/")[0])
    except ValueError:
        raise _NoCurvesError(f"line {number} names a point {shown(value)}") from None
    return index - 1 if index > 0 else places + index if index < 0 else -1


def _check_count(points: int) -> None:
    if points > CURVE_POINT_LIMIT:
        raise _NoCurvesError(f"it has more than {CURVE_POINT_LIMIT:,} points")
