"""Results that are kept."""

from armcontour.studio.kept import KEPT, LARGE_KEPT, MOST_SAMPLES, Kept


def made(kept, key, **how):
    """Whether the result had to be made."""
    news = []
    kept.get("step", key, lambda: news.append(key) or key, **how)
    return bool(news)


def test_as_many_are_kept_as_are_wanted():
    kept = Kept()
    assert all(made(kept, k) for k in range(KEPT + 1))
    assert not any(made(kept, k) for k in range(1, KEPT + 1))
    assert made(kept, 0)


def test_of_results_with_many_samples_only_the_newest_is_kept():
    kept = Kept()
    how = {"most": LARGE_KEPT, "samples": lambda key: key}
    half, more = MOST_SAMPLES // 2, MOST_SAMPLES + 1
    assert made(kept, half, **how) and made(kept, half - 1, **how)
    assert not made(kept, half, **how)
    assert made(kept, more, **how)
    assert not made(kept, more, **how)
    assert made(kept, half, **how)
    assert made(kept, more, **how)
