"""The pages of the benchmarks. No time is measured here."""

from benchmarks import baseline, page
from benchmarks.__main__ import all_lines


def test_the_pages_show_the_baseline_and_every_missed_bar():
    lines = all_lines()
    sessions = baseline.read(baseline.FILE)
    texts = [x.read_text(encoding="utf-8") for x in page.FILES]
    for text in texts:
        assert page.filled(text, lines, sessions) == text, "Run `python -m benchmarks --page`."
    shown = tuple(x for text in texts for x in page.named(text))
    missed = [name for name, x in baseline.baselines_by_name(sessions).items() if x.missed]
    assert [x for x in missed if not x.startswith(shown)] == []
