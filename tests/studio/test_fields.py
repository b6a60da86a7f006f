"""The form of the job on the page, whose file is made from the keys of a job.

    python -m tests.studio.test_fields

writes the file again.
"""

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


if __name__ == "__main__":
    FILE.write_text(form_text(), "utf-8")
