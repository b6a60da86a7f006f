"""The form of the job on the page, whose file is made from the keys of a job.

    python -m tests.studio.test_fields

writes the file again.
"""

import json

from tools.job_form import form_text

from armcontour.files.file_keys import quantity_of
from armcontour.files.job_model import JobModel
from armcontour.files.job_patch import full_key
from armcontour.studio import server
from armcontour.studio.slider_ranges import SLIDER_RANGES

FILE = server.STATIC / "form.json"


def test_the_stored_file_of_form_fields_is_up_to_date():
    assert FILE.read_text("utf-8") == form_text()


def test_sliders_set_quantities_of_a_job_within_their_ranges():
    for keys, (low, high) in SLIDER_RANGES.items():
        quantity = quantity_of(JobModel, full_key(keys))
        assert quantity is not None, keys
        least, most = quantity.range
        assert least <= low < high <= most, keys


def fields_of(field):
    """A field and all fields in it."""
    inner = [*field.get("fields", ()), *field.get("items", ())]
    return [field, *(y for x in inner for y in fields_of(x))]


def test_fields_of_the_arm_and_the_tool_have_different_names_for_tilts():
    groups = json.loads(FILE.read_text("utf-8"))["groups"]
    fields = [y for group in groups for x in group["fields"] for y in fields_of(x)]
    names = [x.get("called", x["name"]) for x in fields if x["name"] == "tilt"]
    assert len(names) > 1 and len({*names, "tilt"}) == len(names) + 1


def test_texts_of_the_page_contain_no_marks_of_markdown():
    assert "`" not in FILE.read_text("utf-8")


if __name__ == "__main__":
    FILE.write_text(form_text(), "utf-8")
