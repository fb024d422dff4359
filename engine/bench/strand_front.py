"""Speed against error of strands: what steps, segments and the tolerance of contact cost, and what they buy."""

from collections.abc import Iterator, Sequence
from functools import partial
from math import exp

from engine.bench import hair_flip, peer_rod, rod_problems
from engine.bench.choices import Choice, rows, tried
from engine.bench.rod_problems import RodProblem
from engine.bench.suite import Measurement, Note, benchmark
from engine.strands.settings import StrandSettings
from engine.validate import contact_capstan

SEGMENTS = (16, 32, 64)
CANTILEVER_STEPS, CANTILEVER_SHARES = (25, 100, 400), (0.9,)  # shares of the peer's largest step, which at rest does not show
VIBRATION_STEPS, VIBRATION_SHARES = (250, 1000, 4000), (0.9, 0.45)
CAPSTAN_STEPS = (10, 20, 40, 80)
HAIRS, FLIPPED = 12, 0.35  # of them and of the scene's time [s]
HAIR_SEGMENTS, HAIR_STEPS, HAIR_TOLERANCES = (15, 30), (2.0, 1.0, 0.5), (1e-2, 1e-3)  # steps over the scene's
FINEST = (30, 0.125, 1e-4)  # segments, step and tolerance of what all flips are compared with


@benchmark("strand-front", summary="error against wall time of cantilever, vibration, capstan and a flip of hair, by knobs")
def strand_front() -> Iterator[Measurement | Note]:
    """Every pair of knobs for each problem, and the peer PyElastica with steps of its own on the rods."""
    if not peer_rod.installed():
        yield Note(f"without {peer_rod.NAME}, which is not installed")
    yield from of_rod(rod_problems.let_go(), SEGMENTS, CANTILEVER_STEPS, CANTILEVER_SHARES)
    yield from of_rod(rod_problems.first_mode(), SEGMENTS, VIBRATION_STEPS, VIBRATION_SHARES)
    yield from of_capstan(SEGMENTS, CAPSTAN_STEPS)
    yield from of_hair(hair_flip.thinned(HAIRS), FLIPPED, HAIR_SEGMENTS, HAIR_STEPS, HAIR_TOLERANCES, FINEST)


def of_rod(
    problem: RodProblem, segments: Sequence[int], steps: Sequence[int], shares: Sequence[float]
) -> Iterator[Measurement]:
    """Yield a row for every pair of segments and steps; where there is the peer, of segments and `shares` of its largest step."""
    rod_problems.swing(problem, segments[0], 2)  # compiles the kernels, untimed
    own = [
        tried(f"{problem.name}, {n} segments", count, partial(rod_problems.swing, problem, n, count),
              lambda tips: problem.error(tips, False), segments=n)
        for n in segments for count in steps
    ]
    if not peer_rod.installed():
        yield from rows(own)
        return
    peer_rod.swing(problem, segments[0], 2)
    pairs = [(n, peer_rod.stable_steps(problem, n, share)) for n in segments for share in shares]
    yield from rows(own, peer_rod.NAME, [
        tried(f"{problem.name}, {peer_rod.NAME} {n} segments", count,
              partial(peer_rod.swing, problem, n, count), lambda tips: problem.error(tips, True), segments=n)
        for n, count in pairs
    ])


def of_capstan(segments: Sequence[int], steps: Sequence[int]) -> Iterator[Measurement]:
    """Yield a row for every pair of segments on the cylinder and steps; the error is that of T2/T1 against exp(mu phi)."""
    wanted = exp(contact_capstan.FRICTION * contact_capstan.TURN)

    def ratio(n: int, count: int) -> float:
        return contact_capstan.ratio(n, contact_capstan.PULLED / count)

    ratio(segments[0], steps[-1])  # compiles the kernels, untimed
    yield from rows([
        tried(f"capstan, {n} segments", count, partial(ratio, n, count),
              lambda reached: abs(reached / wanted - 1.0), segments=n)
        for n in segments for count in steps
    ])


def of_hair(
    document: dict, duration: float, segments: Sequence[int], steps: Sequence[float], tolerances: Sequence[float],
    finest: tuple[int, float, float],
) -> Iterator[Measurement]:
    """Yield a row for each choice of the knobs; its size is how many steps cover the `duration` [s].

    The error is the root mean square distance to what the `finest` choice ends with, over the length of the hair.
    """
    default = document["step"]["default"]
    hair_flip.flip(document, segments[0], 1.0, StrandSettings.contact_tolerance, 2 * default)  # compiles the kernels, untimed
    wanted = hair_flip.flip(document, *finest, duration)

    def choice(n: int, step: float, tolerance: float) -> Choice:
        shipped = (n + 1, step, tolerance) == (document["strands"][0]["vertices"], 1.0, StrandSettings.contact_tolerance)
        return tried(f"hair flip, {n} segments, {tolerance:g}", duration / (step * default),
                     partial(hair_flip.flip, document, n, step, tolerance, duration),
                     partial(hair_flip.distance, wanted), default=shipped, segments=n, tolerance=tolerance)

    yield from rows([choice(n, step, tolerance) for n in segments for tolerance in tolerances for step in steps])
