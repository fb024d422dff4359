"""The life of a job as a pure function: what each event makes of it, and which events are impossible."""

from dataclasses import dataclass, replace
from enum import StrEnum


class JobState(StrEnum):
    """Where a job is."""

    QUEUED = "queued"
    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELLED = "cancelled"

    @property
    def final(self) -> bool:
        """Whether the job will never run again."""
        return self not in (JobState.QUEUED, JobState.RUNNING)


class JobEvent(StrEnum):
    """What can happen to a job."""

    CLAIM = "claim"  # a supervisor takes it to run it
    SUCCEED = "succeed"  # its worker ended well
    FAIL = "fail"  # its worker gave up, for a reason that another attempt would meet again
    ADVANCE = "advance"  # its worker got further than any before it: the deaths so far were not the job's doing
    LOSE = "lose"  # its worker or supervisor died
    RELEASE = "release"  # its supervisor stopped the worker, as the service closes or the user asked
    CANCEL = "cancel"  # the user asks for its end


@dataclass(frozen=True)
class Life:
    """All that decides what may happen to a job next."""

    state: JobState = JobState.QUEUED
    attempts: int = 0  # times it was claimed since it last got further, and not given back unharmed
    max_attempts: int = 3
    cancel_requested: bool = False


class ImpossibleEvent(ValueError):
    """The event cannot happen to a job in this state."""


def transition(life: Life, event: JobEvent) -> Life:
    """Return what `event` makes of a job.

    Asking for the end of a job that already ended changes nothing. Every other event that does not fit the
    state raises `ImpossibleEvent`, so that a supervisor that lost its job cannot overwrite what became of it.
    """
    match life.state, event:
        case JobState.QUEUED, JobEvent.CLAIM:
            return replace(life, state=JobState.RUNNING, attempts=life.attempts + 1)
        case JobState.QUEUED, JobEvent.CANCEL:
            return replace(life, state=JobState.CANCELLED, cancel_requested=True)
        case JobState.RUNNING, JobEvent.CANCEL:
            return replace(life, cancel_requested=True)  # the supervisor stops the worker, then releases or loses it
        case JobState.RUNNING, JobEvent.ADVANCE:
            return replace(life, attempts=1)
        case JobState.RUNNING, JobEvent.SUCCEED:
            return replace(life, state=JobState.SUCCEEDED)
        case JobState.RUNNING, JobEvent.FAIL:
            return replace(life, state=JobState.FAILED)
        case JobState.RUNNING, (JobEvent.LOSE | JobEvent.RELEASE) if life.cancel_requested:
            return replace(life, state=JobState.CANCELLED)
        case JobState.RUNNING, JobEvent.RELEASE:
            return replace(life, state=JobState.QUEUED, attempts=life.attempts - 1)
        case JobState.RUNNING, JobEvent.LOSE:
            exhausted = life.attempts >= life.max_attempts
            return replace(life, state=JobState.FAILED if exhausted else JobState.QUEUED)
        case state, JobEvent.CANCEL if state.final:
            return life
        case state, _:
            raise ImpossibleEvent(f"a job that is {state} cannot {event}")
