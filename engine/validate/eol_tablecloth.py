"""The shipped stacks of tablecloths: contacts stay closed, every step converges, whatever the nodes do."""

import json
import time

from engine.scene.load import shipped_scenes
from engine.validate.catalogue import CaseResult, Row, case
from engine.validate.eol_march import March

BAR = 1e-3
SCENES = ("tablecloth-small-friction", "tablecloth-small-aligned", "tablecloth-small-angled")


@case("eol-tablecloth", bar=BAR, summary="three stacked tablecloths: widest gap of an EIL contact, in yarn radii")
def tablecloth(quick: bool) -> CaseResult:
    """Step the small tablecloths (in part where `quick`) and take the widest gap that any accepted step left."""
    until = 0.03 if quick else 2.0
    rows, notes = [], []
    for name in SCENES:
        march = March(json.loads(shipped_scenes()[name].read_text()))
        began = time.perf_counter()
        attempts = list(march.attempts(until))
        accepted = [attempt.report for attempt in attempts if attempt.report.accepted]
        gap = max(report.contact_gap for report in accepted)
        rows.append(Row("transition time [s]", march.built.settings.transition_time, gap, time.perf_counter() - began))
        notes.append(f"{name}: {gap:.1e} radii, {len(attempts) - len(accepted)} of {len(attempts)} steps rejected")
    return CaseResult(
        rows, max(row.error for row in rows),
        note=f"over {until} s; " + "; ".join(notes) + ". A node of a bent yarn that becomes EIL leaves its partner; "
        "without friction that gap fades over the transition time, closing it at once fails the job")
