"""The first broken files of the readers' soak; `make soak` reads many more."""

import numpy as np
import pytest
from soak.readers import KINDS, mutated, read
from soak.samples import samples

FILES = 50


@pytest.mark.parametrize("kind", KINDS)
def test_a_broken_file_is_read_or_refused_by_name(kind):
    outcomes = {seed: read(kind, seed) for seed in range(FILES)}
    assert {seed: x.notes for seed, x in outcomes.items() if x.notes} == {}
    # Broken so that both happens.
    assert {x.result for x in outcomes.values()} == {"read", "refused"}
    (first, *_) = samples(kind)
    changed = [mutated(first, np.random.default_rng(seed)) for seed in range(20)]
    assert sum(x != first for x in changed) >= 12  # a digit may become itself
