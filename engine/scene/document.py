"""The bytes of a scene as a checked JSON object, before anyone asks what it means."""

import json
import re
from collections import Counter
from typing import Any

import numpy as np

from engine.scene.problems import Problem, SceneError, path_of, shown

SIZE_LIMIT = 16_000_000  # bytes
DEPTH_LIMIT = 32

# to the end of the text where the closing quote is missing, so that the search never has to go back
_STRING = re.compile(rb'"(?:[^"\\]|\\.?)*+"?', re.DOTALL)
_PATH_PART = re.compile(r"(?P<key>[\w-]+)|\[(?P<index>\d{1,9})\]", re.ASCII)


def parse(raw: bytes) -> dict[str, Any]:
    """Return the JSON object that `raw` holds.

    Raises SceneError for what is too large, nested too deep, empty, not UTF-8, not JSON, not an object, or gives a key
    twice. Numbers that JSON does not know (NaN, 1e999) pass, for the schema to refuse by their paths.
    """
    if len(raw) > SIZE_LIMIT:
        raise _refusal("is too large", f"at most {SIZE_LIMIT:,} bytes")
    if not raw.strip():
        raise _refusal("is empty", "a JSON object")
    document = _parse_value(raw)
    if not isinstance(document, dict):
        raise _refusal(f"is {shown(document)}", "a JSON object")
    return document


def override(document: dict[str, Any], assignment: str) -> None:
    """Set one value of `document`, given as path.to[0].key=value; the value is JSON or, if it is none, text.

    Objects on the way are made where they are missing, entries of lists are not. Raises SceneError.
    """
    path, equals, text = assignment.partition("=")
    location = _location(path)
    if not equals or not location:
        raise SceneError([Problem(assignment, "is no override", "path.to[0].key=value")])
    try:
        value = _parse_value(text.encode("utf-8", "surrogatepass"))
    except SceneError:
        value = text
    place: Any = document
    for depth, part in enumerate(location[:-1], 1):
        if isinstance(place, dict) and isinstance(part, str):
            place.setdefault(part, {})
        _require(place, location[:depth])
        place = place[part]
    _require(place, location)
    place[location[-1]] = value


def _require(place: Any, location: list[str | int]) -> None:
    """Refuse a location whose last part is nothing that the `place` above it can have."""
    part, above = location[-1], path_of(location[:-1])
    if isinstance(part, str):
        message = None if isinstance(place, dict) else f"{above} is no object"
    elif not isinstance(place, list):
        message = f"{above} is no list"
    else:
        message = None if part < len(place) else f"{above} has no entry {part}"
    if message:
        raise SceneError([Problem(path_of(location), f"cannot be set: {message}")])


def _refusal(message: str, allowed: str) -> SceneError:
    return SceneError([Problem("", message, allowed)])


def _parse_value(raw: bytes) -> Any:
    if _depth(raw) > DEPTH_LIMIT:
        raise _refusal("is nested too deep", f"at most {DEPTH_LIMIT} levels")
    repeated: list[tuple[dict, str]] = []

    def object_of(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        made = dict(pairs)
        if len(made) < len(pairs):
            repeated.append((made, Counter(key for key, _ in pairs).most_common(1)[0][0]))
        return made

    try:
        value = json.loads(raw.decode("utf-8-sig"), object_pairs_hook=object_of)
    except UnicodeDecodeError as error:
        raise _refusal(f"is not UTF-8 at byte {error.start:,}", "JSON in UTF-8") from None
    except json.JSONDecodeError as error:
        raise _refusal(f"is not JSON at line {error.lineno}, column {error.colno}: {error.msg}", "JSON") from None
    except ValueError:
        raise _refusal("has an integer of thousands of digits", "numbers of up to 18 digits") from None
    if repeated:
        raise SceneError([Problem(path_of([*_find(value, made), key]), "is given twice") for made, key in repeated[:1]])
    return value


def _depth(raw: bytes) -> int:
    """Deepest nesting of brackets outside strings, found without recursion."""
    marks = np.frombuffer(_STRING.sub(b"", raw), np.uint8)
    opens = (marks == ord("[")) | (marks == ord("{"))
    closes = (marks == ord("]")) | (marks == ord("}"))
    return int(np.cumsum(opens.astype(np.int8) - closes.astype(np.int8), dtype=np.int64).max(initial=0))


def _find(value: Any, target: dict) -> list[str | int]:
    """Location of the very object `target` in `value`, which holds it."""
    pending: list[tuple[Any, list[str | int]]] = [(value, [])]
    while pending:
        place, location = pending.pop()
        if place is target:
            return location
        if isinstance(place, dict):
            pending += [(inner, [*location, key]) for key, inner in place.items()]
        elif isinstance(place, list):
            pending += [(inner, [*location, index]) for index, inner in enumerate(place)]
    return []  # the object stood under a key that was itself given twice


def _location(path: str) -> list[str | int]:
    """Keys and indices of a path such as fabrics[2].spacing; none if it is no path."""
    if not re.fullmatch(r"[\w-]+(\[\d{1,9}\]|\.[\w-]+)*", path, re.ASCII):
        return []
    return [match["key"] or int(match["index"]) for match in _PATH_PART.finditer(path)]
