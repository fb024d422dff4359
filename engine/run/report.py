"""`report.json`: what a run cost and how wrong it is. Keys that do not apply to a scene are absent."""

import numpy as np

from engine.run.adaptivity import StepLimits
from engine.run.machine import describe_machine
from engine.run.statistics import Statistics


def make_report(
    name: str, state: str, simulated: float, limits: StepLimits, statistics: Statistics, applies: set[str],
    threads: int, memory: dict[str, int], reason: str | None = None,
) -> dict:
    """Return the report of a run.

    `simulated` is the time reached [s]; `applies` names the optional keys that make sense for the scene
    (`contacts_added`, `contacts_removed`, `linear_iterations`, `contact_gap_max`, `addition_gap_max`, `penetration_max`);
    `memory` has the keys on memory [bytes]; `reason` says why a failed job failed.
    """
    report: dict = {"strandline": 1, "scene": name, "state": state}
    if reason is not None:
        report["reason"] = reason
    return report | {
        "counts": _counts(statistics, applies),
        "time": _time(simulated, limits, statistics),
        **memory,
        "error": _error(statistics, applies),
        "machine": describe_machine(threads),
    }


def _counts(statistics: Statistics, applies: set[str]) -> dict[str, int]:
    """Node counts: what never changes by its name, what does as the largest; contacts that began and ended in all."""
    changing = {"eol_inter", "eil", "contacts", "collisions", "particles", "grid_cells"}
    counts = {f"{name}_max" if name in changing else name: count for name, count in statistics.counts.items()}
    return counts | {name: getattr(statistics, name) for name in ("contacts_added", "contacts_removed") if name in applies}


def _time(simulated: float, limits: StepLimits, statistics: Statistics) -> dict:
    time: dict = {
        "simulated_s": simulated,
        "steps": len(statistics.newton_iterations),
        "rejected_steps": statistics.rejected_steps,
        "dt_default": limits.default,
    }
    if statistics.dt_min is not None:
        time["dt_min"] = statistics.dt_min
    time |= {"compile_s": statistics.compile_s, "wall_s": statistics.wall_s}
    if statistics.seconds:
        median, p95 = np.percentile(statistics.seconds, [50, 95])
        time["s_per_step"] = {"median": float(median), "p95": float(p95)}
        steps = len(statistics.seconds)
        time["stages"] = {stage: {"s_per_step": spent / steps} for stage, spent in statistics.stages.items()}
    return time


def _error(statistics: Statistics, applies: set[str]) -> dict:
    error: dict = {}
    if statistics.newton_iterations:
        error["newton_residual_max"] = statistics.residual_max
        error["newton_iterations"] = _median_and_max(statistics.newton_iterations)
        if "linear_iterations" in applies:
            error["linear_iterations"] = _median_and_max(statistics.linear_iterations)
        for name in ("contact_gap_max", "addition_gap_max", "penetration_max"):
            if name in applies:
                error[name] = getattr(statistics, name)
    if statistics.momentum_scale > 0:
        error["momentum_drift"] = statistics.momentum_change / statistics.momentum_scale
    if statistics.energy_scale > 0:
        error["energy_drift"] = statistics.energy_change / statistics.energy_scale
    if statistics.volume_start is not None:
        error["volume_drift"] = statistics.volume_change
    if statistics.step_errors or statistics.failed_samples:
        # per field: how far one step is from two half steps, in the largest norm and the field's unit
        error["step_error"] = {name: _median_and_max(errors) for name, errors in statistics.step_errors.items()}
        error["step_error"]["samples"] = max((len(errors) for errors in statistics.step_errors.values()), default=0)
        error["step_error"]["failed_samples"] = statistics.failed_samples
    return error


def _median_and_max(values: list) -> dict:
    return {"median": float(np.median(values)), "max": max(values)}
