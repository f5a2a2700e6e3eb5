"""Tables of Excel and MATLAB: the same numbers as those of the text that they were made from."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from bozzini.errors import FileFormatError
from bozzini.io.sheets import read_sheet, take_numbers

MAIN = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
LINKS = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
CELLS = """\
<row r="1"><c r="A1" t="s"><v>0</v></c><c r="C1" t="inlineStr"><is><t>force [N]</t></is></c></row>
<row r="3"><c r="A3"><v>1.5</v></c><c r="C3"><f>A3*2</f><v>3</v></c></row>
<row r="4"><c r="A4"><v>2.5e-1</v></c><c r="C4" t="str"><v>0.5</v></c></row>
"""


def write_book(path: Path, cells: str = CELLS) -> Path:
    """Write a workbook whose only sheet is not called as Excel would."""
    parts = {
        "xl/workbook.xml": f'<workbook xmlns="{MAIN}" xmlns:r="{LINKS}"><sheets>'
        '<sheet name="a" sheetId="7" r:id="rId3"/></sheets></workbook>',
        "xl/_rels/workbook.xml.rels": '<Relationships><Relationship Id="rId3" '
        'Target="worksheets/loops.xml"/></Relationships>',
        "xl/sharedStrings.xml": f'<sst xmlns="{MAIN}"><si><r><t>pressure </t></r><r><t>[kPa]</t>'
        "</r></si></sst>",
        "xl/worksheets/loops.xml": f'<worksheet xmlns="{MAIN}"><sheetData>{cells}</sheetData>'
        "</worksheet>",
    }
    with zipfile.ZipFile(path, "w") as book:
        for name, text in parts.items():
            book.writestr(name, text)
    return path


def test_a_workbook_is_a_table(tmp_path: Path) -> None:
    sheet = read_sheet(write_book(tmp_path / "loops.xlsx"))
    assert list(sheet.titles) == ["pressure [kPa]", "force [N]"]  # the empty column is left out
    assert list(sheet.numbers) == [3, 4]
    assert take_numbers(sheet, 0).tolist() == [1.5, 0.25]
    assert take_numbers(sheet, 1).tolist() == [3.0, 0.5]


def test_vectors_and_matrices_of_matlab_are_columns(tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    counts, both = random.integers(0, 99, size=20), random.normal(size=(2, 20))
    savemat(tmp_path / "a.mat", {"counts": counts, "data": both, "rate": 50.0, "name": "probe"})
    sheet = read_sheet(tmp_path / "a.mat")
    assert list(sheet.titles) == ["counts", "data 1", "data 2"]
    for place, values in enumerate([counts, *both]):
        assert take_numbers(sheet, place).tolist() == values.tolist()


@pytest.mark.parametrize("name", ["a.xlsx", "a.mat"])
@pytest.mark.parametrize("data", [b"", b"PK\x03\x04", b"pressure,force\n1,2\n"])
def test_what_is_no_such_file_is_one_line(tmp_path: Path, name: str, data: bytes) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(FileFormatError, match=name) as caught:
        read_sheet(tmp_path / name)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("cells", ["", "<row>", '<row><c t="s"><v>9</v></c></row>'])
def test_damaged_workbooks_are_refused(tmp_path: Path, cells: str) -> None:
    with pytest.raises(FileFormatError, match=r"a\.xlsx"):
        read_sheet(write_book(tmp_path / "a.xlsx", cells))
    with pytest.raises(FileFormatError, match="1000 columns are read"):
        read_sheet(write_book(tmp_path / "b.xlsx", '<row><c r="XFD1"><v>1</v></c></row>'))
