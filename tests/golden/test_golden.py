"""Short missions come to what they came to; see `tests.golden`."""

import json

from tests.golden import __main__ as golden


def test_as_written_down():
    """Every number within its tolerance, and every bit on a processor and with versions of a digest."""
    kept = json.loads(golden.FILE.read_text(encoding="utf-8"))
    digest, numbers = golden.traced()
    differ = golden.deviations(kept["numbers"], numbers)
    renew = "if results are meant to change: python -m tests.golden --renew"
    assert all(difference <= golden.TOLERANCE for difference in differ.values()), f"{differ}; {renew}"
    if kept["versions"] == golden.versions() and golden.processor() in kept["digests"]:
        assert digest == kept["digests"][golden.processor()], renew
