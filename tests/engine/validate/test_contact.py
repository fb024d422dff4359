"""The cases of strands in contact, as `strandline validate --quick` runs them."""

import pytest

from engine.validate.catalogue import run


@pytest.mark.parametrize("case", [
    "contact-incline", "contact-capstan", "contact-cone", "contact-impacts", "contact-adhesion", "contact-bundles",
])
def test_a_contact_is_at_its_bar(case):
    entry = run([case], quick=True)["cases"][0]
    assert entry["status"] == "pass", entry["note"]
