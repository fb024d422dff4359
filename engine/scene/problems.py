"""What is wrong with a scene: where, why, and what is allowed there."""

import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from itertools import islice
from typing import Any, get_args, get_origin

from pydantic import BaseModel, ValidationError

_SHOWN_PROBLEMS = 20
_SHOWN_CHARACTERS = 60


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong with a scene."""

    path: str  # such as fabrics[2].spacing, empty for the scene as a whole
    message: str  # what is wrong
    allowed: str | None = None  # what may stand there instead

    def __str__(self) -> str:
        allowed = f" (allowed: {self.allowed})" if self.allowed else ""
        return f"{self.path or 'scene'}: {self.message}{allowed}"


class SceneError(Exception):
    """A scene that cannot be simulated as it stands; `problems` says why, in the order of the document."""

    def __init__(self, problems: Sequence[Problem]):
        super().__init__(problems)
        self.problems = list(problems)

    def __str__(self) -> str:
        return "\n".join(str(problem) for problem in self.problems)


def first_problems(problems: Iterable[Problem]) -> list[Problem]:
    """Return as many problems as someone may care to read; those after them are not even looked for."""
    rest = iter(problems)
    shown = list(islice(rest, _SHOWN_PROBLEMS))
    if next(rest, None) is not None:
        shown.append(Problem("", f"has more problems than these {_SHOWN_PROBLEMS}"))
    return shown


def path_of(location: Sequence[str | int]) -> str:
    """Return `location`, keys and list indices from the scene downwards, as fabrics[2].spacing."""
    path = ""
    for part in location:
        if isinstance(part, int):
            path += f"[{part}]"
        elif re.fullmatch(r"[\w-]+", part, re.ASCII):
            path += f".{_shorten(part)}" if path else _shorten(part)
        else:
            path += f"[{_shorten(json.dumps(part))}]"
    return path


def unknown_name(path: str, name: str, known: Sequence[str], kind: str) -> Problem:
    """Return the problem of a `name` that refers to none of the `known` things of a `kind`."""
    return Problem(path, f"there is no {kind} {shown(name)}{_suggestion(name, known)}", _listed(known))


def problems_of(error: ValidationError, model: type[BaseModel], document: Any) -> list[Problem]:
    """Return what pydantic found wrong with `document` as a `model`."""
    details = (detail for detail in error.errors(include_url=False) if not _follows(detail))
    return first_problems(_problem(detail, model, document) for detail in details)


def _follows(detail: Any) -> bool:
    """Whether an error comes from others: a default that needs a wrong value, or a list in which wrong entries do not count."""
    short = detail["type"] == "too_short" and detail["ctx"]["actual_length"] < len(detail["input"])
    return short or detail["type"] == "default_factory_not_called"


def _problem(detail: Any, model: type[BaseModel], document: Any) -> Problem:
    kind, location, context = detail["type"], detail["loc"], detail.get("ctx", {})
    path = path_of(_without_tags(location, document, kind == "missing"))
    if kind == "missing":
        fields = [part.model_fields[location[-1]] for part in _parts_at(model, location[:-1])]
        return Problem(path, "is missing", _one_line(fields[0].description) if fields else "a list with this entry")
    if kind == "extra_forbidden":
        known = [name for part in _parts_at(model, location[:-1]) for name in part.model_fields]
        return Problem(path, f"unknown key{_suggestion(str(location[-1]), known)}", _listed(known))
    if kind in ("union_tag_not_found", "union_tag_invalid"):
        key = context["discriminator"].strip("'")
        tags = [tag for part in _parts_at(model, location) for tag in get_args(part.model_fields[key].annotation)]
        tag = detail["input"].get(key)
        message = "is missing" if kind == "union_tag_not_found" else f"cannot be {shown(tag)}{_suggestion(tag, tags)}"
        return Problem(f"{path}.{key}", message, _listed(tags))
    if kind == "value_error":
        return Problem(path, "its keys contradict each other", str(context["error"]))
    if location[-1:] == ("[key]",):
        path = path_of(location[:-1])
    return Problem(path, f"cannot be {shown(detail['input'])}", _expectation(detail["msg"]))


def _one_line(text: str | None) -> str | None:
    return " ".join(text.split()) if text else None


def _expectation(message: str) -> str:
    """What pydantic's `message` asks for."""
    asked = re.sub(r"^(Input|String|List|Tuple|Dictionary|Value) should (be |have )?", "", message)
    for python, plain in (
        ("valid tuple", "list"), ("valid dictionary or instance of", "JSON object with the keys of"),
        ("valid dictionary", "JSON object"), (" after validation", ""), (" or object to extract fields from", ""),
        ("valid string, unable to parse raw data as a unicode string", "string of Unicode characters"),
    ):
        asked = asked.replace(python, plain)
    return asked


def _without_tags(location: Sequence[str | int], document: Any, missing: bool) -> list[str | int]:
    """Leave out the parts of a location that name a member of a union: no key of the document, nor one that is `missing`."""
    kept: list[str | int] = []
    for depth, part in enumerate(location):
        listed = isinstance(document, list | tuple) and isinstance(part, int) and part < len(document)
        if listed or (isinstance(document, dict) and part in document):
            document = document[part]
        elif not missing or depth < len(location) - 1:
            continue
        kept.append(part)
    return kept


def _parts_at(model: type[BaseModel], location: Sequence[str | int]) -> list[type[BaseModel]]:
    """Models of what may stand at a location, more than one where its tag is unknown."""
    annotation: Any = model
    for part in location:
        parts = _models_in(annotation)
        if isinstance(part, int) or not parts:
            continue
        if get_origin(annotation) is dict:
            annotation = get_args(annotation)[1]
        elif len(parts) == 1:
            annotation = parts[0].model_fields[part].annotation
        else:
            annotation = next(m for m in parts if part in _tags(m))
    return _models_in(annotation)


def _tags(model: type[BaseModel]) -> list[str]:
    return [tag for field in model.model_fields.values() for tag in get_args(field.annotation)]


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for argument in get_args(annotation) for model in _models_in(argument)]


def shown(value: Any) -> str:
    """Return how a message names a value, which may be large."""
    if isinstance(value, dict):
        return "an object"
    if isinstance(value, list | tuple):
        return f"a list of {len(value)}"
    if isinstance(value, int) and abs(value) > 10**18:
        return "an integer of more than 18 digits"
    if isinstance(value, str | int | float | bool | None):
        return _shorten(json.dumps(value))
    return f"a {type(value).__name__}"


def _shorten(text: str) -> str:
    return text if len(text) <= _SHOWN_CHARACTERS else text[:_SHOWN_CHARACTERS] + "..."


def _suggestion(word: Any, known: Sequence[str]) -> str:
    close = get_close_matches(word[:_SHOWN_CHARACTERS], known, 1) if isinstance(word, str) else []
    return f"; did you mean {close[0]}?" if close else ""


def _listed(known: Sequence[str]) -> str:
    return ", ".join(known[:_SHOWN_PROBLEMS]) + (", ..." if len(known) > _SHOWN_PROBLEMS else "") or "none"
