"""The command that draws a frame of a job into a file."""

import logging
from pathlib import Path
from typing import Annotated, Literal

import typer

from service.terminal import DEFAULT_DATA, EXIT_INVALID, fail, out


def picture(
    what: Annotated[str, typer.Argument(metavar="DIR|ID", help="A job's directory, or a job's id.")],
    to: Annotated[Path, typer.Option("--out", help="The file to write; its suffix says the format.")],
    frame: Annotated[int, typer.Option(help="Number of the frame; negative from the end.")] = -1,
    view: Annotated[
        tuple[float, float], typer.Option(metavar="AZIMUTH ELEVATION", help="Where the eye is: degrees from x to y, and up.")
    ] = (-46.0, 27.0),
    zoom: Annotated[float, typer.Option(min=1e-3, help="1: the whole scene fills the picture.")] = 1.0,
    at: Annotated[
        tuple[float, float, float] | None, typer.Option(metavar="X Y Z", help="What the eye looks at [m]; the middle by default.")
    ] = None,
    size: Annotated[tuple[int, int], typer.Option(metavar="WIDTH HEIGHT", help="Of the picture, in pixels.")] = (1200, 800),
    paint: Annotated[
        Literal["fabric", "group", "strain", "curvature", "force", "liquid", "speed", "pressure", "shear", "yielded"] | None,
        typer.Option(help=(
            "What colours say: of yarns fabric or strain, of strands group, strain, curvature or contact force, of liquids "
            "nothing, speed, pressure, shear stress or where they have yielded."
        )),
    ] = None,
    nodes: Annotated[bool, typer.Option(help="Show the nodes of yarns, on thin yarns.")] = False,
    surface: Annotated[
        bool, typer.Option(help="Show the surface of a liquid, if the frame has it, where colours say nothing of its particles.")
    ] = True,
    detail: Annotated[
        Literal["auto", "fine", "region"], typer.Option(help="How much is drawn; a region is the one around --at.")
    ] = "fine",
    data: Annotated[Path, typer.Option(help="Directory of all jobs.")] = DEFAULT_DATA,
) -> None:
    """Draw a still picture of a frame, with the Chromium that is installed; no window opens."""
    from engine.run.compile_cache import prepare_compile_cache

    prepare_compile_cache()
    from engine.scene.load import SceneError
    from viewer.picture import CannotDraw, View, draw
    from viewer.stage import Shown

    directory = Path(what) if Path(what).is_dir() else data / what
    if not (directory / "scene.json").exists():
        fail(f"{what}: neither a job's directory nor a job in {data}", EXIT_INVALID)
    logging.getLogger("websockets").setLevel(logging.CRITICAL)  # the browser opens connections and thinks better of it
    focus = at or (0.0, 0.0, 0.0)
    shown = Shown(lines=True, nodes=nodes, obstacles=True, paint=paint, level=detail, focus=focus, surface=surface)
    try:
        said = draw(directory, frame, shown, View(*view, zoom, at), size, to)
    except (CannotDraw, SceneError, OSError, ValueError) as problem:
        fail(problem)
    out.print(f"{to}: {said}", soft_wrap=True)
