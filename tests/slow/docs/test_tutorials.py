"""The tutorials, executed step by step."""

import pytest
from tests.test_docs_code import DONE, QUICK, do_page


@pytest.mark.parametrize("page", [x for x in DONE if x not in QUICK])
def test_the_steps_of_a_tutorial_give_the_printed_output(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    do_page(page)
