"""The form of the job on the page, whose file is made from the keys of a job.

    python -m tests.studio.test_fields

writes the file again.
"""

from tools.job_form import form_text

from armcontour.studio import server

FILE = server.STATIC / "form.json"


def test_the_stored_file_of_form_fields_is_up_to_date():
    assert FILE.read_text("utf-8") == form_text()


if __name__ == "__main__":
    FILE.write_text(form_text(), "utf-8")
