"""Memory of steps: equal results, only what changed is computed again, and a bounded size."""

import threading

import numpy as np
import pytest

from armcontour.core.memory import Memory, content_key, recall, remembered, remembering


def test_results_are_known_until_two_computations_do_not_use_them():
    memory = Memory()
    made = []

    def use(*keys):
        with remembering(memory):
            return [remembered(("double", x), lambda x=x: made.append(x) or 2 * x) for x in keys]

    assert use(1, 2) == [2, 4]
    assert use(2, 3) == [4, 6]
    assert made == [1, 2, 3]
    assert len(memory) == 3
    # The computation before used 2 and 3 only, and this one uses 3.
    assert use(3) == [6]
    assert len(memory) == 2
    assert use(1) == [2] and made == [1, 2, 3, 1]


def test_nothing_is_remembered_without_a_memory_in_other_threads_or_after_it():
    memory = Memory()
    others = []
    with remembering(memory):
        assert remembered("key", lambda: 1) == 1
        thread = threading.Thread(target=lambda: others.append(recall("key")))
        thread.start()
        thread.join()
        assert recall("key") == 1
    assert others == [None] and recall("key") is None
    assert remembered("key", lambda: 2) == 2


def test_an_interrupted_computation_forgets_nothing():
    memory = Memory()
    with remembering(memory):
        remembered("key", lambda: 1)
    for _ in range(3):
        with pytest.raises(KeyError), remembering(memory):
            raise KeyError
    with remembering(memory):
        assert recall("key") == 1


def test_keys_are_equal_for_equal_contents_only():
    values = np.arange(3.0)
    assert content_key((values, {"a": 1})) == content_key((values.copy(), {"a": 1}))
    assert content_key(values) != content_key(values.astype(int))
    assert content_key(values) != content_key(values[:, None])
    assert content_key((1.0, "x")) != content_key((1.0, "y"))
