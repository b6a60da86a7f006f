"""Tasks of the other process."""

from armcontour.studio.exact import TASKS as OF_A_PERSON
from armcontour.studio.tasks.working import TASKS, work
from armcontour.studio.wire import Frame


def test_an_unknown_task_is_refused():
    frame = Frame.unpack(work(("a", "bake", {"text": ""}), lambda data: None))
    assert frame.kind == "failed" and frame.header["id"] == "a"
    assert frame.header["sentence"].startswith("There is no task 'bake': there are figures, ")


def test_what_a_person_can_ask_for_is_a_task():
    assert set(TASKS) > {*OF_A_PERSON, "figures"}
