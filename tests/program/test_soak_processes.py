"""A little of `soak.processes`: jobs with leads, overlaps, passes, dwells and switches."""

from soak import processes as judge


def test_the_judge_sees_shorter_leads_and_another_contour_and_else_nothing(monkeypatch):
    write = judge.Drawn.text

    def wrong(drawn, other_units):
        kept = drawn.lead_in, drawn.points
        drawn.lead_in, drawn.points = 0.5 * drawn.lead_in, drawn.points + 0.5 * drawn.tolerance
        try:
            return write(drawn, other_units)
        finally:
            drawn.lead_in, drawn.points = kept

    seed = 1  # a small job with a lead-in
    assert judge.Drawn(seed).lead_in and not judge.judge(seed)
    monkeypatch.setattr(judge.Drawn, "text", wrong)
    said = " ".join(judge.judge(seed))
    assert "length of the lead-in" in said and "contour not covered" in said
