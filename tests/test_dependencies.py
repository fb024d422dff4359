"""The packages that pyproject.toml declares are those that the code imports."""

import ast
import re
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
OURS = {"engine", "service", "viewer", "jobs", "tests"}
ON_BEHALF = {"jinja2"}  # imported by fastapi.templating, which does not ask for it itself

UNINSTALLED = {"elastica": "pyelastica"}  # packages of extras whose modules have another name


def declared(requirements: list[str]) -> set[str]:
    """Normalised names of what is required."""
    return {re.split(r"[^\w.-]", requirement)[0].lower() for requirement in requirements}


def imported(*tops: str) -> set[str]:
    """Normalised names of the packages of other people whose modules are imported below some directories."""
    modules = set()
    for path in (path for top in tops for path in (ROOT / top).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                modules |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                modules.add(node.module.split(".")[0])
    packages = packages_distributions()
    others = modules - OURS - set(sys.stdlib_module_names)
    return {packages.get(module, [UNINSTALLED.get(module, module)])[0].lower() for module in others}


def test_every_dependency_is_imported_and_every_import_declared():
    needed = imported("engine", "service", "viewer", "jobs")
    bench = declared(PROJECT["optional-dependencies"]["bench"])
    assert needed - bench == declared(PROJECT["dependencies"]) - ON_BEHALF


def test_what_tests_import_is_declared():
    extras = PROJECT["optional-dependencies"]
    assert imported("tests") <= declared(PROJECT["dependencies"] + extras["test"] + extras["bench"])
