"""The shipped stacks of tablecloths: contacts stay closed, every step converges, whatever the nodes do."""

import json
import time

import numpy as np

from engine.scene.load import shipped_scenes
from engine.validate.catalogue import CaseResult, Row, case
from engine.validate.eol_march import March
from engine.yarns.model import PointKind

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
        contacts = int(np.sum(march.model.point_kind == PointKind.CONTACT))
        rows.append(Row("contacts between cloths", contacts, gap, time.perf_counter() - began))
        notes.append(f"{name}: {gap:.1e} radii, {len(attempts) - len(accepted)} of {len(attempts)} steps rejected")
    return CaseResult(rows, max(row.error for row in rows), note=f"over {until} s; " + "; ".join(notes))
