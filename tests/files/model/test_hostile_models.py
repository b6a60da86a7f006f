"""STEP files that name other files, are damaged, or have too many parts: refused in a sentence."""

import re

import pytest

pytest.importorskip("OCP")

from OCP.STEPCAFControl import STEPCAFControl_Writer
from OCP.TCollection import TCollection_ExtendedString
from OCP.TDocStd import TDocStd_Document
from OCP.XCAFDoc import XCAFDoc_DocumentTool
from tests.files.model.step_parts import Named, box, placed, write

import armcontour as ac
from armcontour.core.errors import FileError


@pytest.fixture(scope="module")
def text(tmp_path_factory):
    """A file with two parts; the coordinate 7 is only in the first one."""
    parts = (Named("a", box((0, 0, 0), (10, 20, 7))), Named("b", box((20, 0, 0), (30, 10, 11))))
    file = write(tmp_path_factory.mktemp("whole") / "two.step", *parts)
    assert len(ac.read_model(file).parts) == 2
    return file.read_text(encoding="latin-1")


def refusal(file, content):
    file.write_text(content, encoding="latin-1")
    with pytest.raises(FileError) as error:
        ac.read_model(file)
    sentence = str(error.value)
    assert "\n" not in sentence and sentence.endswith(".")
    return sentence


@pytest.mark.parametrize("word", ["DOCUMENT_FILE", "document_file", "DCMFL"])
def test_names_of_other_files_are_refused_before_the_kernel_starts(
    word, text, tmp_path, monkeypatch
):
    from armcontour.files.model import kernel_process

    monkeypatch.setattr(kernel_process, "read_in_process", None)
    head, end, tail = text.rpartition("ENDSEC;")
    other = f"#90001=DOCUMENT_TYPE('');\n#90002={word}('/etc/other.stp','','',#90001,'',$);\n"
    assert "other files" in refusal(tmp_path / "part.step", head + other + end + tail)


@pytest.mark.parametrize(
    ("pattern", "damaged"),
    [
        (r"(CARTESIAN_POINT\('',\([^()]*),7\.\)", r"\1,nan)"),
        (r"(CARTESIAN_POINT\('',\([^()]*),7\.\)", r"\1,1.E308)"),
        (r"(#\d+)( = ADVANCED_FACE\('',\()#\d+", r"\1\2\1"),
        (r"(ORIENTED_EDGE\('',\*,\*,)#\d+", r"\1#99999999"),
        (r"(CLOSED_SHELL\('',\()#\d+,", r"\1#99999999,"),
        (r"(MANIFOLD_SOLID_BREP\('',)#\d+", r"\1$"),
    ],
)
def test_damaged_parts_are_not_left_out(pattern, damaged, text, tmp_path):
    content, count = re.subn(pattern, damaged, text, count=1)
    assert count == 1
    refusal(tmp_path / "part.step", content)


def write_nested(file, levels, copies):
    """Write an assembly of assemblies, with `copies` of the lower one in each."""
    document = TDocStd_Document(TCollection_ExtendedString("XCAF"))
    tool = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    label = tool.AddShape(box((0, 0, 0), (1, 1, 1)), False)
    for level in range(levels):
        assembly = tool.NewShape()
        for k in range(copies):
            place = [0.0, 0.0, 0.0]
            place[level % 3] = 2.0 * k * copies ** (level // 3)
            tool.AddComponent(assembly, label, placed(*place))
        label = assembly
    tool.UpdateAssemblies()
    writer = STEPCAFControl_Writer()
    writer.Transfer(document)
    writer.Write(str(file))
    return file


def test_parts_in_all_places_have_a_limit(tmp_path):
    assert len(ac.read_model(write_nested(tmp_path / "few.step", 2, 4)).parts) == 16
    file = write_nested(tmp_path / "many.step", 4, 7)
    with pytest.raises(FileError, match="2401 parts, but at most 2000"):
        ac.read_model(file)
