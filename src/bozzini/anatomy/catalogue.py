"""Public anatomy that a user can fetch: what, from where, under which licence."""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import InputError

__all__ = ["CATALOGUE", "PublicData", "find_data"]


@dataclass(frozen=True, kw_only=True)
class PublicData:
    """One public data set.

    Attributes
    ----------
    name : str
        The name by which it is fetched.
    what : str
        What it holds, and what to know before using it.
    licence : str
    citation : str
        How to cite it.
    url : str
        Where it is; the name of the file fetched is the last part of its path.
    file_name : str
        Name of the file on disk.
    sha256 : str or None
        Its checksum, or None if it is not known: then a fetch cannot verify the file, and says so.
    size : int or None
        Bytes, or None if not known.
    """

    name: str
    what: str
    licence: str
    citation: str
    url: str
    file_name: str
    sha256: str | None = None
    size: int | None = None

    def __post_init__(self) -> None:
        for field in ("name", "what", "licence", "citation", "url", "file_name"):
            if not getattr(self, field):
                raise InputError(f"a catalogue entry needs a {field}, received an empty one")
        if "/" in self.file_name or "\\" in self.file_name or self.file_name.startswith("."):
            raise InputError(f"file name is '{self.file_name}': it must be a plain name")
        if self.sha256 is not None and (
            len(self.sha256) != 64 or set(self.sha256) - set("0123456789abcdef")
        ):
            raise InputError(f"sha256 is '{self.sha256}': it must be 64 hexadecimal digits")


_GCA_FOLDER = (
    "https://raw.githubusercontent.com/Comparative-Pathology/GCA-Models/"
    "a9f22b62032370a2e469fcecf5157fc55cf35b04/EdinGCA_3D_00090/SegmentedSurfaces/"
)
_GCA_CITATION = (
    "Model EdinGCA_3D_00090 of Comparative-Pathology/GCA-Models, commit a9f22b6; 'Towards a "
    "clinically-based common coordinate framework for the human gut cell atlas: the gut models', "
    "BMC Med Inform Decis Mak 2023, doi:10.1186/s12911-023-02111-9"
)
_GCA_NOTE = (
    "; closed triangles (legacy VTK) in voxel indices of the CT, not mm: the voxel size is not in "
    "the file, so scale it before use"
)


def _gca(name: str, part: str, stem: str) -> PublicData:
    return PublicData(
        name=name,
        what=part + _GCA_NOTE,
        licence="CC BY 4.0",
        citation=_GCA_CITATION,
        url=f"{_GCA_FOLDER}{stem}.vtk",
        file_name=f"{name}.vtk",
    )


CATALOGUE: tuple[PublicData, ...] = (
    _gca("gca-oesophagus", "Lower oesophagus of one human CT", "small_intestine_OGL-POL"),
    _gca("gca-stomach", "Stomach of one human CT, collapsed", "small_intestine_GDJ-OGL"),
    _gca("gca-duodenum", "Duodenum of one human CT, collapsed", "small_intestine_DJJ-GDJ"),
    PublicData(
        name="totalsegmentator-small",
        what="102 CT scans, each with one NIfTI mask per organ (oesophagus, stomach, duodenum, "
        "colon, ...), as one ZIP archive to unpack",
        licence="CC BY 4.0",
        citation="Wasserthal et al., 'TotalSegmentator: Robust Segmentation of 104 Anatomic "
        "Structures in CT Images', Radiology: Artificial Intelligence 2023, "
        "doi:10.1148/ryai.230024; data set v2.0.1, small subset, Zenodo record 10047263",
        url="https://zenodo.org/api/records/10047263/files/"
        "Totalsegmentator_dataset_small_v201.zip/content",
        file_name="Totalsegmentator_dataset_small_v201.zip",
        size=3_244_617_817,
    ),
)
"""What `bozzini data list` shows. No checksum is given where none was seen at its source."""


def find_data(name: str) -> PublicData:
    """Return the catalogue entry of a name.

    Raises
    ------
    InputError
        If there is none.
    """
    for entry in CATALOGUE:
        if entry.name == name:
            return entry
    known = ", ".join(entry.name for entry in CATALOGUE)
    raise InputError(f"there is no data set '{name}': the catalogue has {known}")
