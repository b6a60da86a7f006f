"""Tasks that end with a file."""

import zipfile
from io import BytesIO

import pytest
from tests.studio.tasks.asking import ask

import armcontour as ac


@pytest.mark.parametrize(
    ("options", "ending", "begins"),
    [
        ({"format": "csv"}, ".csv", b"t [s],q"),
        ({"format": "csv", "of": "planned", "period": 0.01}, ".csv", b"t [s],q"),
        ({"format": "npz"}, ".npz", b"PK"),
        ({"format": "parquet"}, ".parquet", b"PAR1"),
        ({"format": "ros-yaml"}, ".yaml", b""),
        ({"format": "mcap"}, ".mcap.zip", b"PK"),
        ({"format": "urscript"}, ".script", b""),
        ({"format": "template", "template": "kuka"}, ".src", b""),
        ({"format": "template", "template": "abb"}, ".mod", b"MODULE"),
    ],
)
def test_every_format_is_exported(line, drawings, options, ending, begins):
    found = ask("export", line, "optimal", drawings, **options)
    content = found.arrays["content"].tobytes()
    # KRL finds a program by the name of its file, which may have no hyphen.
    stem = "square_optimal" if ending == ".src" else "square-optimal"
    assert found.header["name"] == f"{stem}{ending}"
    assert found.header["bytes"] == len(content) > 100
    assert begins in content[:100]


def test_a_kuka_program_of_any_job_has_a_name_that_krl_takes(line, drawings):
    named = line | {"name": "7 Löcher für den langen Deckel"}
    found = ask("export", named, "optimal", drawings, format="template", template="kuka")
    assert found.header["name"] == "p_7_L_cher_f_r_den_lange.src"
    assert b"DEF p_7_L_cher_f_r_den_lange( )" in found.arrays["content"].tobytes()


def test_outputs_that_are_missing_are_named_as_the_command_line_does(line, drawings):
    laser = line | {"process": {"switch": {"name": "laser"}}}
    found = ask("export", laser, "optimal", drawings, format="template", template="kuka")
    assert [x for x in found.header["warnings"] if "switched" in x] == [
        "Template kuka: nothing is switched for laser, as no output is named: the program has "
        "comments in these places. Name an output, such as --output laser=17 of armcontour export."
    ]


def test_a_bag_is_an_archive_of_its_folder(line, drawings):
    found = ask("export", line, "optimal", drawings, format="mcap")
    with zipfile.ZipFile(BytesIO(found.arrays["content"].tobytes())) as archive:
        assert any(x.endswith(".mcap") for x in archive.namelist())


def test_files_of_templates_are_not_read(line, drawings):
    with pytest.raises(ac.InvalidInput, match="There is no template '/etc/passwd'"):
        ask("export", line, "optimal", drawings, format="template", template="/etc/passwd")


def test_a_report_is_a_page(short, drawings):
    found = ask("report", short, "optimal", drawings)
    assert found.header["type"] == "text/html"
    assert b"optimal" in found.arrays["content"].tobytes()


def test_a_certificate_has_a_report(short, drawings):
    found = ask("certify", short, "optimal", drawings, tolerance=5.5e-3)
    assert found.header["sentence"].startswith("Certified: ")
    assert found.header["left"] >= 0
    assert found.header["name"] == "paper-certificate.html"
    # Its answer says for which robots it is true.
    assert found.header["notes"][-1].startswith("Valid for independent joint servos only: ")


def test_a_certificate_can_be_of_rigid_bodies(short, drawings):
    with pytest.raises(ac.InvalidInput, match="plant must be one of"):
        ask("certify", short, "optimal", drawings, tolerance=5.5e-3, plant="robot")
    with pytest.raises(ac.InvalidInput, match="on rigid bodies does not allow"):
        ask("certify", short, "optimal", drawings, tolerance=5.5e-3, saturation="report",
            plant="rigid_body")  # fmt: skip


def test_learning_tells_what_it_would_gain(short, drawings):
    found = ask("learn", short, "optimal", drawings, runs=1, seed=1)
    assert found.header["rms"][1] < found.header["rms"][0]
    # The first run is before learning.
    assert found.header["sentence"].startswith("After 1 simulated run ")


def test_a_certificate_without_a_tolerance_names_the_field_of_the_page(short, drawings):
    with pytest.raises(ac.InvalidInput, match="beside Certify"):
        ask("certify", short, "optimal", drawings)
