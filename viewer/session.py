"""One open page: the job it shows, the moment it is at, and how both move on."""

import logging
from collections.abc import Callable
from pathlib import Path
from queue import SimpleQueue

import numpy as np
import viser

from engine.contact.obstacles import posed
from engine.geometry.handles import no_handles
from engine.run.frames import Frame
from engine.scene.load import SceneError
from viewer.jobs import NO_OBSTACLES, Job, job_ids, read_frame_once
from viewer.lay import Layout, layout_of, unchanged
from viewer.layers import scene_bounds
from viewer.panel import NO_JOB, PAINTS, SPEEDS, Panel, drawn_html, legend_html, solver_html, status_html
from viewer.stage import Shown, Stage
from viewer.timeline import Timeline

LOOK_INTERVAL = 0.25  # between looks at the directory for new frames [s]
FOCUS_STEP = 0.05  # a region follows the camera in steps of this share of its distance
FAR = 4.0  # sizes of what there is at the start, above which the picture does not reach to what has left it
SERIES_PER_TICK = 64  # frames whose series are read at once, so that a long job does not hold up the picture
log = logging.getLogger(__name__)


class Session:
    """What one client sees. `tick` does all the work, on one thread; callbacks of widgets only leave it notes."""

    def __init__(self, client: viser.ClientHandle, data: Path, asked: str | None):
        self._client = client
        self._data = data
        self._asked = asked
        self._panel = Panel(client.gui)
        self._stage = Stage(client)
        self._timeline = Timeline()
        self._notes: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._job: Job | None = None
        self._title = ""
        self._layout: Layout = unchanged
        self._obstacles, self._handles = NO_OBSTACLES, no_handles()
        self._framed = False  # obstacles and camera have been set for the present job
        self._drawn: tuple[Frame, Shown] | None = None
        self._focus = np.full(3, np.inf)  # what the camera looked at when the region last moved [m]
        self._next_look = 0.0
        self._last_tick: float | None = None
        self._listen()

    def tick(self, now: float) -> None:
        """Bring the page up to date; `now` is a monotonic wall time [s]."""
        passed, self._last_tick = now - (self._last_tick or now), now
        with self._client.atomic():
            while not self._notes.empty():
                self._notes.get()()
            if now >= self._next_look:
                self._next_look = now + LOOK_INTERVAL
                self._look()
            if self._job is not None:
                self._timeline.advance(passed * SPEEDS[self._panel.speed.value])
                self._show(self._job)
        self._client.flush()

    def _listen(self) -> None:
        panel, timeline, note = self._panel, self._timeline, self._notes.put
        steps = {
            "first": lambda: 0, "back": lambda: timeline.index - 1,
            "next": lambda: timeline.index + 1, "last": lambda: timeline.last,
        }  # fmt: skip

        @panel.frame.on_update
        def _(event: viser.GuiEvent) -> None:
            if event.client is not None:  # moved by the visitor, not by this program
                index = panel.frame.value
                note(lambda: timeline.seek(index))

        @panel.step.on_click
        def _(event: viser.GuiEvent) -> None:
            target = steps[panel.step.value]
            note(lambda: timeline.seek(target()))

        @panel.play.on_click
        def _(_event: viser.GuiEvent) -> None:
            note(lambda: timeline.seek(timeline.index) if timeline.playing else timeline.play())

        @panel.follow.on_update
        def _(event: viser.GuiEvent) -> None:
            if event.client is not None:
                wanted = panel.follow.value
                note(lambda: self._follow(wanted))

        @panel.job.on_update
        def _(event: viser.GuiEvent) -> None:
            if event.client is not None:
                chosen = panel.job.value
                note(lambda: self._choose(chosen))

        @panel.refit.on_click
        def _(_event: viser.GuiEvent) -> None:
            note(self._refit)

    def _look(self) -> None:
        """See which jobs there are and what the present one has written."""
        ids = job_ids(self._data)
        self._panel.set_jobs(ids)
        if self._job is None:
            wanted = self._asked or next(iter(ids), "")
            if wanted not in ids:
                self._panel.status.content = status_html(wanted or "no job yet", "shown here as soon as it begins")
                return
            self._job = self._open(wanted)
        changed = self._job.look()
        if self._job.read_series(SERIES_PER_TICK) or changed:
            self._next_look = 0.0  # there may be more
            self._timeline.extend(self._job.times)
            self._panel.set_frame_count(len(self._job.times))
            self._panel.set_plots(self._job.times, self._job.series)

    def _choose(self, job_id: str) -> None:
        if job_id != NO_JOB:
            self._job = self._open(job_id)

    def _open(self, job_id: str) -> Job:
        """Make the page ready for another job, and return it."""
        job = Job(self._data / job_id)
        self._framed, self._drawn = False, None
        self._stage.clear()
        self._timeline.extend([])
        try:
            scene, built = job.scene()
        except SceneError as problem:
            # what moves is in the frames; without the scene, yarns' order over each other and the obstacles are missing
            self._title, self._layout = "scene not readable", unchanged
            self._obstacles, self._handles = NO_OBSTACLES, no_handles()
            log.warning("job %s: %s", job_id, problem)
        else:
            self._title, self._layout = scene.name, layout_of(scene, built)
            self._obstacles, self._handles = built.obstacles, built.handles
        self._panel.job.value = job_id  # type: ignore[misc]  # settable: mypy loses the setter in viser's inheritance
        self._follow(True)
        self._next_look = 0.0
        return job

    def _follow(self, wanted: bool) -> None:
        self._timeline.playing, self._timeline.follow = False, wanted
        self._timeline.extend(self._timeline.times)

    def _show(self, job: Job) -> None:
        """Draw the frame that the timeline is at, if it is not on the page already."""
        timeline, panel = self._timeline, self._panel
        panel.show_timeline(timeline)
        if not timeline.times:
            panel.status.content = status_html(self._title, f"{job.state}, no frame yet")
            return
        frame = read_frame_once(job.frames[timeline.index])
        detail = f"{job.state} · time {frame.time:.3f} s · frame {frame.index} of {timeline.last} · step {frame.step}"
        panel.status.content = status_html(self._title, detail)
        if not self._framed:
            bounds = self._opening_bounds(job, frame)
            self._stage.set_obstacles(self._obstacles, *bounds)
            self._stage.frame_camera(*bounds)
            panel.offer(frame)
            self._framed = True
        shown = panel.shown(self._look_at())
        if self._drawn is None or self._drawn[0] is not frame or self._drawn[1] != shown:
            self._stage.move_obstacles(self._obstacles, self._handles, frame.time)
            panel.drawn.content = drawn_html(self._stage.draw(frame, self._layout, shown))
            panel.legend.content = legend_html(frame, PAINTS[panel.paint.value])
            panel.solver.content = solver_html(frame)
            self._drawn = (frame, shown)

    def _look_at(self) -> tuple[float, float, float]:
        """Return the middle of the region to draw [m]: it stays while the camera moves little, or no region is shown."""
        camera = self._client.camera
        moved = np.linalg.norm(camera.look_at - self._focus)
        if self._panel.level.value == "region" and moved > FOCUS_STEP * np.linalg.norm(camera.position - camera.look_at):
            self._focus = camera.look_at
        x, y, z = self._focus.tolist()
        return x, y, z

    def _refit(self) -> None:
        if self._drawn is not None:
            self._stage.frame_camera(*self._bounds([self._drawn[0]]))

    def _opening_bounds(self, job: Job, present: Frame) -> tuple[np.ndarray, np.ndarray]:
        """Return the box that a page opens on: around the first frame and the present one.

        Where all would be a speck in that, since it has gone far, it is that of the first alone; a job that has ended is shown
        from its beginning then.
        """
        first = read_frame_once(job.frames[0])
        start, both = self._bounds([first]), self._bounds([first, present])
        if np.linalg.norm(both[1] - both[0]) < FAR * np.linalg.norm(start[1] - start[0]):
            return both
        if job.state != "running":
            self._timeline.seek(0)
        return start

    def _bounds(self, frames: list[Frame]) -> tuple[np.ndarray, np.ndarray]:
        boxes = (scene_bounds(frame, posed(self._obstacles, self._handles, frame.time)) for frame in frames)
        lows, highs = zip(*boxes, strict=True)
        return np.min(lows, axis=0), np.max(highs, axis=0)
