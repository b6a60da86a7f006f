"""A little of `soak.processes`: jobs with leads, overlaps, passes, dwells and switches."""

from __future__ import annotations

import pytest
from soak import processes as judge


def test_the_first_jobs_have_nothing_wrong() -> None:
    assert not any(judge.judge(seed) for seed in range(2))


def test_the_judge_sees_shorter_leads_and_another_contour(monkeypatch: pytest.MonkeyPatch) -> None:
    write = judge.Drawn.text

    def wrong(drawn: judge.Drawn, other_units: bool) -> str:
        kept = drawn.lead_in, drawn.points
        drawn.lead_in, drawn.points = 0.5 * drawn.lead_in, drawn.points + 0.5 * drawn.tolerance
        try:
            return write(drawn, other_units)
        finally:
            drawn.lead_in, drawn.points = kept

    seed = next(k for k in range(10) if judge.Drawn(k).lead_in)
    monkeypatch.setattr(judge.Drawn, "text", wrong)
    said = " ".join(judge.judge(seed))
    assert "length of the lead-in" in said and "contour not covered" in said
