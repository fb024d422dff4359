"""The time loop: from a scene to frames, checkpoints and a report in a job directory."""

from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from math import inf, isfinite
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from numba.core import event
from numpy.typing import NDArray

from engine.run.adaptivity import (
    ROUND_OFF,
    StepLimits,
    StepSize,
    StepTooSmall,
    after_accepted,
    after_rejected,
    first_size,
    plan,
)
from engine.run.checkpoint import Checkpoint, CheckpointMismatch, checkpoint_path, read_checkpoint, write_checkpoint
from engine.run.directory import JobDirectory, fingerprint
from engine.run.frames import Frame, write_frame
from engine.run.memory import ProgramMemory, give_back_large_arrays, memory_peak
from engine.run.report import make_report
from engine.run.simulated import Simulated, assemble
from engine.run.statistics import Statistics
from engine.run.threads import set_threads, threads_for

if TYPE_CHECKING:
    from engine.scene.schema import Scene
    from engine.steppers.step_report import StepReport

CHECKPOINT_INTERVAL = 20.0  # wall seconds after which a checkpoint is written in the midst of the frames of one
PROGRESS_INTERVAL = 0.1  # wall seconds between calls of on_progress
RECENT = 30  # steps that the current rate is the mean of


class SimulationFailed(Exception):
    """A job ended before its time; frames up to there and the report are whole."""

    def __init__(self, reason: str):
        super().__init__(reason)
        self.reason = reason


@dataclass(frozen=True)
class Progress:
    """How far a run is, as of its last accepted step."""

    time: float  # [s]
    until: float  # [s]
    step: int
    frame: int  # frames written
    dt: float  # the step taken [s]
    newton_iterations: int
    residual: float
    contact_gap: float  # [radii]
    counts: dict[str, int]
    s_per_step: float  # of recent steps
    wall_s: float


def run(
    scene: "Scene",
    directory: Path,
    *,
    until: float | None = None,
    threads: int | None = None,
    resume: bool = False,
    on_progress: Callable[[Progress], None] | None = None,
    on_frame: Callable[[Frame], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> dict:
    """Simulate `scene` up to `until` [s] (at most, and by default, its duration) into `directory`; return the report.

    With `resume` it continues from the directory's checkpoint, bitwise as if it had never stopped, or begins where
    there is none. When `should_stop` becomes true a checkpoint is written and the report says "cancelled". It uses at most
    `threads`, all there are by default, and for small scenes one: results are the same on any number.

    Raises SimulationFailed when the simulation cannot go on, after writing a report that says so, and DirectoryTaken
    when the directory belongs to something else.
    """
    used_threads = set_threads(threads)
    give_back_large_arrays()
    job = JobDirectory(directory)
    job.open(scene, resume)
    job.set_state("running")
    with (
        event.install_listener("numba:compile", event.TimingListener()) as compilation,
        event.install_listener(ProgramMemory.EVENT, ProgramMemory()) as program,
    ):
        loop = _Loop(scene, job, min(scene.duration, scene.duration if until is None else until), compilation, program)
        loop.on_progress, loop.on_frame = on_progress, on_frame
        try:
            loop.begin(resume)
            with threads_for(loop.nodes) as used_threads:
                state = loop.advance(should_stop or (lambda: False))
        except Exception as error:
            foreseen = isinstance(error, SimulationFailed | CheckpointMismatch | OSError)
            reason = str(error) if foreseen else f"{type(error).__name__}: {error}"
            with suppress(OSError):  # a full disk is the reason already, and may not hold the report
                loop.finish("failed", used_threads, reason)
            if isinstance(error, SimulationFailed):
                raise
            raise SimulationFailed(reason) from error
        return loop.finish(state, used_threads)


class _Loop:
    """A run in progress: the clock, the step controller, the statistics, and where output goes."""

    def __init__(
        self, scene: "Scene", job: JobDirectory, end: float, compilation: event.TimingListener, program: ProgramMemory
    ):
        self.scene, self.job, self.compilation, self.program = scene, job, compilation, program
        self.nodes = 0
        self.on_progress: Callable[[Progress], None] | None = None
        self.on_frame: Callable[[Frame], None] | None = None
        self.limits = StepLimits(scene.step.default, scene.step.min, scene.step.max)
        self.last_frame = int(end * scene.fps + ROUND_OFF)
        ends_on_frame = end * scene.fps - self.last_frame < ROUND_OFF
        self.end = self.last_frame / scene.fps if ends_on_frame else end
        self.time, self.step, self.next_frame = 0.0, 0, 0
        self.size: StepSize = first_size(self.limits)
        self.statistics = Statistics()
        self.report_keys: set[str] = set()
        self.began = self.checkpointed = perf_counter()
        self.earlier_wall = self.earlier_compile = 0.0  # of the processes that this one continues
        self.checkpoint_cost, self.checkpointed_frame = 0.0, 0
        self.progressed = -inf
        self.recent: deque[float] = deque(maxlen=RECENT)

    def begin(self, resume: bool) -> None:
        """Assemble the scene, at its initial state or at the checkpoint's."""
        self.simulated: Simulated = assemble(self.scene)
        self.report_keys, self.nodes = self.simulated.report_keys, self.simulated.nodes
        self.scene_fingerprint = fingerprint(self.scene)
        if resume and checkpoint_path(self.job.path).exists():
            saved = read_checkpoint(self.job.path, self.scene_fingerprint, self.simulated.arrays(), self.simulated.varying)
            self.simulated.restore(saved.arrays)
            self.time, self.step, self.next_frame, self.size = saved.time, saved.step, saved.next_frame, saved.size
            self.statistics, self.checkpointed_frame = saved.statistics, saved.next_frame
            self.earlier_wall, self.earlier_compile = saved.statistics.wall_s, saved.statistics.compile_s
        self.job.log("started", time=self.time, step=self.step, until=self.end)

    def advance(self, should_stop: Callable[[], bool]) -> str:
        """Step until the end, with a frame at each frame time; returns the state that the job ends in."""
        if self.next_frame == 0:
            self._write_frame(0.0, None)
        while self.time < self.end:
            if should_stop():
                self._write_checkpoint()
                return "cancelled"
            target = self._next_target()
            h, report = self._accepted_step(target)
            if self.time == target and self.next_frame <= self.last_frame:
                self._write_frame(h, report)
            self._tell(h, report)
            if self._checkpoint_is_due():
                self._write_checkpoint()
        self._write_checkpoint()
        return "succeeded"

    def finish(self, state: str, threads: int, reason: str | None = None) -> dict:
        """Write the report and the final state of the job; returns the report."""
        self._take_times()
        report = make_report(
            self.scene.name, state, self.time, self.limits, self.statistics, self.report_keys, threads,
            self._memory(), reason,
        )
        self.job.write_report(report)
        self.job.set_state(state, **({} if reason is None else {"reason": reason}))
        self.job.log(state, time=self.time, step=self.step, **({} if reason is None else {"reason": reason}))
        return report

    def _next_target(self) -> float:
        """The next time [s] to hit exactly. Frame times are counted, not summed: they gather no round-off."""
        return self.next_frame / self.scene.fps if self.next_frame <= self.last_frame else self.end

    def _accepted_step(self, target: float) -> tuple[float, "StepReport"]:
        """Take one step towards `target`, smaller where it is rejected; returns its size [s] and report."""
        began, compiled_before = perf_counter(), self._compile_seconds()
        before = self._copy_for_sample()
        remaining = target - self.time
        while not (report := self.simulated.step(self.time, h := plan(self.size.dt, remaining))).accepted:
            self.statistics.rejected_steps += 1
            self.job.log("rejected", time=self.time, step=self.step, h=h, reason=report.reason)
            try:
                self.size = after_rejected(h, self.limits)
            except StepTooSmall as error:
                raise SimulationFailed(f"at {self.time:.6g} s: {report.reason}; {error}") from error
        seconds, compiled = perf_counter() - began, self._compile_seconds() > compiled_before
        self._refuse_nonfinite()
        self.statistics.accepted(h, report, seconds, compiled)
        self.statistics.counted(self.simulated.counts())
        if before is not None:
            self.statistics.sampled(self.simulated.half_step_errors(before, self.time, h))
        self.recent.append(seconds)
        self.size = after_accepted(self.size, self.limits)
        self.step += 1
        self.time = target if h == remaining else self.time + h
        return h, report

    def _copy_for_sample(self) -> dict[str, NDArray] | None:
        """The state before the first step after a frame, where the scene asks for an estimate of the error."""
        if not self.scene.output.error_estimate or self.time != (self.next_frame - 1) / self.scene.fps:
            return None
        return {name: values.copy() for name, values in self.simulated.arrays().items()}

    def _refuse_nonfinite(self) -> None:
        """End the job before anything that is not a number reaches the disk."""
        for name, values in self.simulated.arrays().items():
            if not isfinite(values.sum()):  # the sum is finite only where every entry is, and needs no temporary
                raise SimulationFailed(f"at {self.time:.6g} s: {name} is no longer finite after step {self.step + 1}")

    def _write_frame(self, h: float, report: "StepReport | None") -> None:
        """Write the frame that is due and observe what the motion should have kept; the first has no step before."""
        began, compiled_before = perf_counter(), self._compile_seconds()
        energies = self.simulated.energies()
        self.statistics.observed(self.simulated.invariants(self.time, energies))
        series = {
            "dt": h,
            "newton_iterations": float(report.newton_iterations if report else 0),
            "linear_iterations": float(report.linear_iterations if report else 0),
            "residual": float(report.residual if report else 0.0),
            "contact_gap": float(report.contact_gap if report else 0.0),
            "kinetic_energy": energies["kinetic"],
            "potential_energy": energies["potential"],
            **{name: float(count) for name, count in self.simulated.counts().items()},
        }
        frame = Frame(self.next_frame, self.time, self.step, series=series, **self.simulated.components())
        if self.scene.output.frames:
            write_frame(self.job.path, frame)
        self.next_frame += 1
        self._spent_on_output(began, compiled_before)
        if self.on_frame:
            self.on_frame(frame)

    def _checkpoint_is_due(self) -> bool:
        """Every few frames as the scene says, and earlier where these take long; never a tenth of the run's time."""
        waited = perf_counter() - self.checkpointed
        frames = self.next_frame - self.checkpointed_frame
        return waited > 10 * self.checkpoint_cost and (
            frames >= self.scene.output.checkpoint_every or waited > CHECKPOINT_INTERVAL
        )

    def _write_checkpoint(self) -> None:
        began, compiled_before = perf_counter(), self._compile_seconds()
        self._take_times()
        write_checkpoint(self.job.path, Checkpoint(
            self.scene_fingerprint, self.time, self.step, self.next_frame, self.size, self.simulated.arrays(),
            self.statistics,
        ))
        self._spent_on_output(began, compiled_before)
        self.checkpointed, self.checkpointed_frame = perf_counter(), self.next_frame
        self.checkpoint_cost = self.checkpointed - began
        self.job.log("checkpoint", time=self.time, step=self.step)

    def _tell(self, h: float, report: "StepReport") -> None:
        """Call on_progress, at most at its interval and always at the end."""
        now = perf_counter()
        if self.on_progress is None or (now - self.progressed < PROGRESS_INTERVAL and self.time < self.end):
            return
        self.progressed = now
        self.on_progress(Progress(
            time=self.time, until=self.end, step=self.step, frame=self.next_frame, dt=h,
            newton_iterations=report.newton_iterations, residual=report.residual, contact_gap=report.contact_gap,
            counts=self.simulated.counts(), s_per_step=sum(self.recent) / len(self.recent),
            wall_s=self.earlier_wall + now - self.began,
        ))

    def _spent_on_output(self, began: float, compiled_before: float) -> None:
        """Count the time since `began` as a stage, unless kernels were compiled in it."""
        if self._compile_seconds() == compiled_before:
            stages = self.statistics.stages
            stages["output"] = stages.get("output", 0.0) + perf_counter() - began

    def _compile_seconds(self) -> float:
        return self.compilation.duration if self.compilation.done else 0.0

    def _memory(self) -> dict[str, int]:
        """The report's keys on memory [bytes]."""
        memory = {"memory_peak_bytes": memory_peak()}
        if self.nodes:
            memory["memory_per_node_bytes"] = max(memory["memory_peak_bytes"] - self.program.bytes, 0) // self.nodes
        return memory

    def _take_times(self) -> None:
        self.statistics.wall_s = self.earlier_wall + perf_counter() - self.began
        self.statistics.compile_s = self.earlier_compile + self._compile_seconds()
