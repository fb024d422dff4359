"""Which frame is shown: it follows new ones, plays in simulated time, or stays where it was put."""

from bisect import bisect_right


class Timeline:
    """A position among the frames of a job. Knows neither files nor widgets."""

    def __init__(self) -> None:
        self.times: list[float] = []  # of the frames there are, ascending [s]
        self.index = 0
        self.playing = False
        self.follow = False
        self._clock = 0.0  # simulated time that play has come to [s]

    @property
    def last(self) -> int:
        """Index of the newest frame, 0 where there is none."""
        return max(len(self.times) - 1, 0)

    def extend(self, times: list[float]) -> None:
        """Take note of all frames there are now; where `follow` is on, the newest is shown."""
        self.times = times
        self.index = self.last if self.follow else min(self.index, self.last)

    def seek(self, index: int) -> None:
        """Show frame `index`, or the nearest there is, and stay there."""
        self.playing = self.follow = False
        self.index = min(max(index, 0), self.last)

    def play(self) -> None:
        """Play from the present frame, from the first where this is the last."""
        if not self.times:
            return
        self.follow, self.playing = False, True
        self.index = 0 if self.index == self.last else self.index
        self._clock = self.times[self.index]

    def advance(self, seconds: float) -> None:
        """Let `seconds` of simulated time pass; play ends at the last frame."""
        if not self.playing:
            return
        self._clock += seconds
        self.index = min(max(bisect_right(self.times, self._clock) - 1, 0), self.last)
        self.playing = self.index < self.last
