"""The structure that design relies on: floors that imports only go down, small modules, well-formed equation tags."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
MODULES = sorted(path for top in ("engine", "service", "viewer", "jobs") for path in (ROOT / top).rglob("*.py"))

FLOORS = [
    {"engine.arrays", "engine.linalg", "engine.geometry"},
    {"engine.yarns", "engine.strands", "engine.shells", "engine.liquid"},
    {"engine.coupling", "engine.contact", "engine.film"},
    {"engine.steppers"},
    {"engine.scene", "engine.run", "engine.validate", "engine.bench", "jobs"},
    {"viewer"},
    {"service"},
]
FLOOR = {package: floor for floor, packages in enumerate(FLOORS) for package in packages}
SIDEWAYS = {  # within a floor
    ("engine.linalg", "engine.arrays"), ("engine.geometry", "engine.arrays"),
    ("engine.scene", "jobs"),
    ("engine.run", "engine.scene"),
    ("engine.validate", "engine.run"), ("engine.validate", "engine.scene"),
    ("engine.bench", "engine.run"), ("engine.bench", "engine.scene"), ("engine.bench", "engine.validate"),
}
EQUATION = r"\(?[A-Z]?\d+(\.\d+)*[a-z]?\)?"
TAG = re.compile(rf"\b(eq\. {EQUATION}|eqs\. {EQUATION}((, | and | to |-){EQUATION})+)(?![\w(])")


def package_of(module: str) -> str | None:
    """The package of FLOORS that a dotted module is in; None for the root of the engine and for other people's."""
    parts = module.split(".")
    name = ".".join(parts[:2]) if parts[0] == "engine" else parts[0]
    return name if name in FLOOR else None


def imports(tree: ast.Module):
    """All modules that a source imports, with their lines; `from a import b` counts as a.b as b may be a module."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            yield from ((f"{node.module}.{alias.name}", node.lineno) for alias in node.names)


def faults_of_imports(here: str, source: str) -> list[str]:
    """Imports of a module in package `here` that do not go downward."""
    faults = []
    for module, line in imports(ast.parse(source)):
        there = package_of(module)
        if there is None or there == here or (here, there) in SIDEWAYS or FLOOR[there] < FLOOR[here]:
            continue
        faults.append(f"line {line}: {here} imports {module}")
    return faults


def faults_of_tags(docstring: str) -> list[str]:
    """Mentions of equations that no reader, human or script, could resolve."""
    tagged = {match.start() for match in TAG.finditer(docstring)}
    loose = re.finditer(r"\b(eqs?|eqns?|equations?)\b\.?\s*(?=\(?\d)", docstring, re.IGNORECASE)
    return [docstring[match.start() : match.start() + 30] for match in loose if match.start() not in tagged]


def dotted(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts)


@pytest.mark.parametrize("path", MODULES, ids=dotted)
def test_module_keeps_to_its_floor_size_and_tags(path):
    source = path.read_text()
    here = package_of(dotted(path))
    if here is not None:
        assert faults_of_imports(here, source) == []
    else:
        assert dotted(path) == "engine.__init__", "a package that design.md does not place on a floor"
    assert len(source.splitlines()) < 400
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef)
    docstrings = [ast.get_docstring(node) or "" for node in ast.walk(ast.parse(source)) if isinstance(node, documented)]
    assert [fault for text in docstrings for fault in faults_of_tags(text)] == []


def test_floors_are_judged():
    assert faults_of_imports("engine.linalg", "from engine.yarns import model") != []
    assert faults_of_imports("engine.scene", "import engine.run.simulation") != []
    assert faults_of_imports("engine.yarns", "def f():\n    from service import app") != []
    assert faults_of_imports("engine.yarns", "from engine.linalg.block_matrix import x\nimport numpy") == []


def test_tags_are_judged():
    good = "As eq. 13.12 and eqs. 7 to 10, eqs. 8.5, 8.6 and 8.11, eq. (4), eq. A.3, eqs. 7-10 say."
    assert faults_of_tags(good) == []
    for bad in ("Eq. 13", "eq 13.12", "equation 7", "eqs. 7", "eq. 7x9"):
        assert faults_of_tags(bad) != [], bad


def test_engine_and_viewer_know_no_web_server():
    for path in MODULES:
        if not dotted(path).startswith("service"):
            names = {module.split(".")[0] for module, _ in imports(ast.parse(path.read_text()))}
            assert not names & {"fastapi", "uvicorn", "starlette", "typer", "httpx"}, path
