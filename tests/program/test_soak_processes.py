"""A little of `soak.outputs`: jobs with leads, overlaps, passes, dwells and switches."""

from soak import outputs as judge


def test_the_judge_sees_shorter_leads_and_another_contour_and_else_nothing(monkeypatch):
    write = judge.DrawnJob.text

    def wrong(drawn, other_units):
        kept = drawn.lead_in, drawn.points
        drawn.lead_in, drawn.points = 0.5 * drawn.lead_in, drawn.points + 0.5 * drawn.tolerance
        try:
            return write(drawn, other_units)
        finally:
            drawn.lead_in, drawn.points = kept

    seed = 1  # a small job with a lead-in
    assert judge.DrawnJob(seed).lead_in and not judge.judge_job(seed)
    monkeypatch.setattr(judge.DrawnJob, "text", wrong)
    said = " ".join(judge.judge_job(seed))
    assert "length of the lead-in" in said and "contour not covered" in said
