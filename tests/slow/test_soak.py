"""The first problem of every soak."""

import pytest
from soak.__main__ import TOPICS, judge


# The problem of the topic "studio" takes minutes.
@pytest.mark.parametrize("topic", sorted(TOPICS.keys() - {"studio"}))
def test_the_first_random_problem_of_a_topic_has_no_fault(topic):
    _, outcome, _ = judge((TOPICS[topic][0], 0))
    assert outcome.notes == []
