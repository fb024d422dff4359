"""A still picture of one frame: the live page's own drawing, in a Chromium without a window, saved as a file.

A page is served to this one browser on a free local port and asked for a rendering of the scene without the panel, at
twice the size and scaled down, which smooths yarns that are thinner than a pixel.
"""

import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, SimpleQueue

import numpy as np
import viser
from PIL import Image
from scipy.spatial.transform import Rotation

from engine.arrays import Floats
from engine.contact.obstacles import posed
from engine.run.frames import frame_paths, read_frame
from viewer import layers
from viewer.gate import Gate, guarding
from viewer.jobs import Job
from viewer.lay import layout_of
from viewer.server import PrivateServer
from viewer.stage import Shown, Stage

CHROMIUM = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = (
    "--headless --no-sandbox --use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader --disable-quic "
    "--no-first-run --disable-background-networking --disable-component-update --disable-sync --disable-dev-shm-usage "
    "--hide-scrollbars"
).split()
PREVIEW = 16  # renderings that only tell whether the page has come to rest are smaller by this factor
PREVIEW_OF_FINE = 4  # by which strands and drops do not vanish between the pixels
PAUSE = 0.25  # between two of them [s]
FINER = 2  # the rendering is larger than the picture by this factor
MARGIN = 1.04  # distance of the eye against that at which the scene touches the picture's border
BACKGROUND = (250, 250, 248)
PATIENCE = 300.0  # for the browser to open the page, and again for it to draw, on a machine that has other work [s]


class CannotDraw(Exception):
    """There is no picture; the message says why."""


@dataclass(frozen=True)
class View:
    """From where a scene is seen."""

    azimuth: float = -45.9  # of the eye, from x towards y [degrees]
    elevation: float = 27.3  # of the eye above the horizon [degrees]
    zoom: float = 1.0  # 1: the whole scene fills the picture
    centre: tuple[float, float, float] | None = None  # of the picture, the scene's middle by default [m]


def draw(job: Path, index: int, shown: Shown, view: View, size: tuple[int, int], path: Path) -> str:
    """Save a picture of frame `index` of a job directory, from the end where negative; `size` is width by height.

    Returns what part of the frame is shown. Raises CannotDraw where there is no such frame or no Chromium, or the colours
    cannot say what they should, SceneError where the scene cannot be read.
    """
    paths = frame_paths(job)
    if not -len(paths) <= index < len(paths):
        raise CannotDraw(f"{job} has {len(paths)} frames, none with number {index}")
    scene, built = Job(job).scene()
    frame = read_frame(paths[index])
    if shown.paint not in (None, *(paints := layers.paints_of(frame))):
        raise CannotDraw(f"colours of this scene say {', '.join(paints[:-1])} or {paints[-1]}, not {shown.paint}")
    low, high = layers.scene_bounds(frame, posed(built.obstacles, built.handles, frame.time))
    width, height = (FINER * side for side in size)
    eye, target = _eye(low, high, view, width / height)

    def render(scale: int) -> Floats:
        client.flush()
        return client.get_render(
            height // scale, width // scale, wxyz=_towards(target - eye), position=eye, fov=layers.FIELD_OF_VIEW,
            transport_format="png", timeout=PATIENCE,
        )

    with _page() as client:
        stage = Stage(client)
        stage.frame_camera(low, high)
        said = [stage.draw(frame, layout_of(scene, built), shown)]
        _settle(lambda: render(PREVIEW if frame.yarns is not None else PREVIEW_OF_FINE))
        stage.set_obstacles(built.obstacles, low, high)  # only now: they are there at once, and yarns would be missed
        stage.move_obstacles(built.obstacles, built.handles, frame.time)
        drawn = Image.fromarray(render(1))
    picture = Image.new("RGBA", drawn.size, (*BACKGROUND, 255))
    picture.alpha_composite(drawn)
    picture.convert("RGB").resize(size, Image.Resampling.LANCZOS).save(path)
    return "; ".join(said + layers.colours_in_words(frame, shown.paint))  # a picture has no key


def _settle(render: Callable[[], Floats]) -> None:
    """Return when the page shows something and has come to rest: it builds large meshes after it has taken them in."""
    last, deadline = render(), time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        time.sleep(PAUSE)
        now = render()
        if now[..., 3].any() and np.array_equal(now, last):
            return
        last = now
    raise TimeoutError


def _eye(low: Floats, high: Floats, view: View, aspect: float) -> tuple[Floats, Floats]:
    """Return where the eye is and what it looks at [m]: the box from `low` to `high` fills the picture at zoom 1."""
    azimuth, elevation = np.radians((view.azimuth, view.elevation))
    back = np.array((np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)))
    target = np.array(view.centre) if view.centre else (low + high) / 2
    right, down, forward = Rotation.from_quat(_towards(-back), scalar_first=True).as_matrix().T
    corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T - (low + high) / 2
    tangent = np.tan(layers.FIELD_OF_VIEW / 2)
    # each corner, as far from the middle as it is and as near as it is, has to be inside the picture
    across = np.maximum(np.abs(corners @ right) / aspect, np.abs(corners @ down))
    return target + (across / tangent - corners @ forward).max() * MARGIN / view.zoom * back, target


def _towards(forward: Floats) -> Floats:
    """Return the rotation (w, x, y, z) of a camera that looks along `forward`, its x right and its y down."""
    z = forward / np.linalg.norm(forward)
    x = np.cross(z, (0.0, 0.0, 1.0)) if abs(z[2]) < 1 - 1e-9 else np.array((1.0, 0.0, 0.0))
    x /= np.linalg.norm(x)
    return Rotation.from_matrix(np.column_stack([x, np.cross(z, x), z])).as_quat(scalar_first=True)


@contextmanager
def _page() -> Iterator[viser.ClientHandle]:
    """Open an empty page in a browser of its own; raises CannotDraw where there is none or it does not come."""
    program = next((found for name in CHROMIUM if (found := shutil.which(name))), None)
    if program is None:
        raise CannotDraw("pictures need Chromium, and there is none on PATH")
    with guarding(Gate()), redirect_stdout(None):  # it greets even when told to be silent
        server = PrivateServer(host="127.0.0.1", port=0, verbose=False)
    visitors: SimpleQueue[viser.ClientHandle] = SimpleQueue()
    server.on_client_connect(visitors.put)
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        address = f"http://127.0.0.1:{server.get_port()}/"
        # a remote port keeps it open; the page alone would be printed and left
        command = [
            program, *FLAGS, f"--user-data-dir={profile}", "--window-size=320,240", "--remote-debugging-port=0", address,
        ]  # its window is small because it draws that too
        browser = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            yield visitors.get(timeout=PATIENCE)
        except Empty:
            raise CannotDraw(f"{program} did not open the page") from None
        except TimeoutError:
            raise CannotDraw(f"{program} did not draw the page") from None
        finally:
            browser.terminate()
            browser.wait()
            with redirect_stdout(None):
                server.stop()
