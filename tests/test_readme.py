"""What README.md promises: its commands, scene, addresses, pictures and list of scenes are those of the code."""

import os
import re
from pathlib import Path

import typer

from engine.run.simulation import run
from engine.scene.load import load_scene, shipped_scenes
from service.api import router
from service.cli import main

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text()
PICTURE_LIMIT = 400_000  # bytes


def blocks(language: str) -> list[str]:
    """The fenced blocks of one language."""
    return re.findall(rf"^```{language}\n(.*?)^```$", README, re.DOTALL | re.MULTILINE)


def shell_lines() -> list[str]:
    """The command lines of all shell blocks, without comments."""
    lines = [line.split("  #")[0].strip() for block in blocks("sh") for line in block.splitlines()]
    return [line for line in lines if line]


def test_one_command_runs_the_demo_and_one_the_tests_as_ci_does():
    demo, tests = [line for line in shell_lines() if line.startswith("python3 -m venv")]
    assert demo.endswith("strandline demo") and "pytest" in tests
    script = ROOT / ".ci" / "run"
    assert os.access(script, os.X_OK)
    assert [line for line in script.read_text().splitlines() if line.startswith(tests)]


def test_every_command_and_option_exists():
    commands = typer.main.get_command(main).commands
    typed = [line.rpartition("strandline ")[2] for line in shell_lines() if "strandline " in line]
    calls = [call.split() for call in typed + re.findall(r"`strandline ([^`]+)`", README)]
    assert len(calls) > 10
    for name, *arguments in calls:
        assert name in commands, name
        options = {option for parameter in commands[name].params for option in parameter.opts}
        assert {argument for argument in arguments if argument.startswith("--")} <= options, (name, arguments)


def test_every_shipped_scene_is_listed():
    table = README[README.index("| scene |"):].split("\n\n")[0]
    assert set(re.findall(r"`([\w-]+)`", table)) == set(shipped_scenes())


def test_the_example_scene_runs(tmp_path):
    (example,) = blocks("json")
    report = run(load_scene(example.encode()), tmp_path, until=0.05)
    assert report["state"] == "succeeded"
    assert report["error"]["newton_residual_max"] < load_scene(example.encode()).step.tolerance


def test_every_section_of_a_scene_is_explained():
    table = README[README.index("| section |"):].split("\n\n")[0]
    explained = set(re.findall(r"`(\w+)`", "\n".join(row.split("|")[1] for row in table.splitlines())))
    assert explained == set(type(load_scene(shipped_scenes()["quickstart"])).model_fields) - {
        "strandline", "name", "description"}


def test_every_address_is_served():
    addresses = re.findall(r"127\.0\.0\.1:8765(/v1/\S+)", "\n".join(shell_lines()))
    assert len(addresses) == 5
    for address in addresses:
        assert any(route.path_regex.match(address) for route in router.routes), address


def test_links_and_pictures_resolve():
    for target in re.findall(r"\]\(([^)]+)\)", README):
        assert target.startswith("https://") or (ROOT / target).is_file(), target
    for picture in (ROOT / "docs").glob("*.png"):
        assert f"](docs/{picture.name})" in README, "a picture that is shown nowhere"
        assert picture.stat().st_size < PICTURE_LIMIT


def test_the_report_keys_are_explained():
    for key in ("time", "error", "counts", "memory_peak_bytes", "memory_per_node_bytes", "machine"):
        assert f"`{key}`" in README


