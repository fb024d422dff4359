"""Scenes from files, bytes, text or objects: read, checked, or refused with everything that is wrong."""

from collections.abc import Sequence
from copy import deepcopy
from importlib.resources import files
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from engine.scene.curve_files import read_curve_files
from engine.scene.document import SIZE_LIMIT, override, parse
from engine.scene.meshes import read_mesh_files
from engine.scene.problems import Problem, SceneError, first_problems, problems_of
from engine.scene.references import disagreements
from engine.scene.schema import Scene, scene_schema
from engine.scene.size import excesses

__all__ = ["Problem", "SceneError", "load_scene", "scene_schema", "shipped_scenes"]


def load_scene(source: Path | bytes | str | dict[str, Any], overrides: Sequence[str] = ()) -> Scene:
    """Return the scene that a file, JSON bytes, JSON text or an object gives, changed by `overrides`.

    An override is path.to[0].key=value, where the value is JSON or bare text. Raises SceneError, with all problems
    that were found, for anything that cannot be simulated, from bytes that are no JSON to more nodes than allowed.
    """
    document = deepcopy(source) if isinstance(source, dict) else parse(_bytes_of(source))
    for assignment in overrides:
        override(document, assignment)
    directory = source.parent if isinstance(source, Path) else None
    read_mesh_files(document, directory)
    read_curve_files(document, directory)
    try:
        scene = Scene.model_validate(document)
    except ValidationError as error:
        raise SceneError(problems_of(error, Scene, document)) from None
    for check in (disagreements, excesses):
        if problems := first_problems(check(scene)):
            raise SceneError(problems)
    return scene


def shipped_scenes() -> dict[str, Path]:
    """Return the scenes that come with Strandline, by name."""
    scenes = (Path(str(entry)) for entry in files("jobs").iterdir() if entry.name.endswith(".json"))
    return {path.stem: path for path in sorted(scenes)}


def _bytes_of(source: Path | bytes | str) -> bytes:
    if isinstance(source, bytes):
        return source
    if isinstance(source, str):
        return source.encode("utf-8", "surrogatepass")  # text that is no Unicode is refused as bytes that are not
    try:
        with source.open("rb") as file:
            return file.read(SIZE_LIMIT + 1)
    except OSError as error:
        raise SceneError([Problem("", f"cannot be read from {source}: {error.strerror}")]) from None
