"""Files beside a scene's own, the only ones that it may name."""

from collections.abc import Sequence
from pathlib import Path

from engine.scene.problems import Problem, SceneError, shown


def read_beside(path: str, name: str, directory: Path, kinds: Sequence[str], limit: int) -> tuple[bytes, str]:
    """Return what the file `name` in `directory` or below it holds, and of which of the `kinds` it is by its ending.

    `path` is where the scene names it, `limit` the size that it may have [bytes]. Raises SceneError for anything else that
    `name` leads to.
    """
    kind = Path(name).suffix[1:].lower()
    if kind not in kinds:
        raise SceneError([Problem(path, f"cannot be {shown(name)}", f"files that end in {', '.join(kinds)}")])
    try:
        base = directory.resolve()
        place = (base / name).resolve()
        if Path(name).is_absolute() or ".." in Path(name).parts or not place.is_relative_to(base):
            raise SceneError([Problem(path, f"{shown(name)} is not beside the scene: a scene reads no other files",
                                      "a path from the scene's own directory downwards, without ..")])
        if place.exists() and not place.is_file():
            raise SceneError([Problem(path, f"{shown(name)} is no file", "a file, no directory or device")])
        with place.open("rb") as file:
            content = file.read(limit + 1)
    except (OSError, ValueError, RuntimeError) as error:  # the latter for names that no system has, and for links in a circle
        reason = error.strerror if isinstance(error, OSError) else "no such name"
        raise SceneError([Problem(path, f"cannot be read from {shown(name)}: {reason}")]) from None
    if len(content) > limit:
        raise SceneError([Problem(path, f"{shown(name)} is too large", f"at most {limit:,} bytes")])
    return content, kind


def unread(path: str, instead: str) -> Problem:
    """Return the problem of a file that a scene names at `path` which does not come from a file itself."""
    return Problem(path, "is not read for a scene that does not come from a file itself: "
                   "nobody may ask a service for files of its machine", f"{instead} in the scene")
