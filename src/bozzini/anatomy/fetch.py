"""Fetching a public data set: whole or not at all, its checksum compared, its licence beside it."""

from __future__ import annotations

import hashlib
import os
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from http.client import HTTPException
from pathlib import Path

from ..errors import FileFormatError, InputError, OutputError
from ..io.files import write_atomically, write_text
from ..progress import Progress, no_progress
from ..results import Shown

# Public anatomy that a user can fetch: what, from where, under which licence.


@dataclass(frozen=True, kw_only=True)
class PublicData(Shown):
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
        Its checksum, or None if it is not known: then a fetch cannot verify the file, and reports
        that.
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


TIMEOUT_S = 30.0
"""Longest silence of a server."""

_BLOCK = 1 << 20
_SCHEMES = ("https://", "http://", "file://")


@dataclass(frozen=True, kw_only=True)
class FetchResult(Shown):
    """What a fetch did.

    Attributes
    ----------
    path, citation_path : Path
        The file, and the licence and citation beside it.
    sha256 : str
        Checksum of the file as it came.
    verified : bool
        Whether the catalogue had a checksum to compare with (one that differs is an error).
    size : int
        Bytes.
    """

    path: Path
    citation_path: Path
    sha256: str
    verified: bool
    size: int


def fetch_data(
    data: str | PublicData,
    directory: str | os.PathLike[str],
    *,
    force: bool = False,
    progress: Progress = no_progress,
) -> FetchResult:
    """Fetch a data set into a directory.

    Parameters
    ----------
    data : str or PublicData
        A name of the catalogue, or an entry of one's own.
    directory : path-like
        Where to; made if its parent exists.
    force : bool
        Replace a file that exists.
    progress : Progress
        Called with the fraction fetched, where the size is known.

    Raises
    ------
    InputError
        If the name is not in the catalogue, or the address is not http, https or file.
    OutputError
        If the file exists or cannot be written.
    FileFormatError
        If the address cannot be reached, or what came is empty, cut short, or has another
        checksum; nothing is kept then.
    """
    entry = find_data(data) if isinstance(data, str) else data
    if not entry.url.startswith(_SCHEMES):
        raise InputError(f"the address of {entry.name} is '{entry.url}': it must be http or file")
    folder = Path(directory)
    fresh = not os.path.exists(folder)
    try:
        place = Path(os.path.realpath(folder))  # a link may lead to what is not there yet
        place.mkdir(exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot write to {folder}: {error.strerror or error}") from None
    target = folder / entry.file_name
    beside = folder / f"{entry.file_name}.citation.txt"
    if os.path.isdir(target):
        raise OutputError(f"{target} is a directory: remove it or choose another place")
    if os.path.exists(target) and not force:
        raise OutputError(f"{target} exists already: choose another directory or give --force")
    done: list[tuple[str, int]] = []
    try:
        write_atomically(target, lambda path: done.append(_transfer(entry, path, progress)))
    except BaseException:
        if fresh:
            with suppress(OSError):
                place.rmdir()  # made for a file that did not come
        raise
    checksum, size = done[0]
    write_text(
        beside,
        f"{entry.file_name}\n{entry.what}\nLicence: {entry.licence}\nCite as: {entry.citation}\n"
        f"From: {entry.url}\nSHA-256: {checksum}"
        f"{'' if entry.sha256 else ' (computed on arrival, not verified)'}\n",
    )
    return FetchResult(
        path=target,
        citation_path=beside,
        sha256=checksum,
        verified=entry.sha256 is not None,
        size=size,
    )


def _transfer(entry: PublicData, path: Path, progress: Progress) -> tuple[str, int]:
    """Copy a data set into a file; return its checksum and its size."""
    digest, size = hashlib.sha256(), 0
    request = urllib.request.Request(entry.url, headers={"User-Agent": "bozzini"})
    with _one_error(entry):
        source = urllib.request.urlopen(request, timeout=TIMEOUT_S)
    with source, path.open("wb") as target:
        stated = source.headers.get("Content-Length", "")
        announced = int(stated) if stated.isdigit() else None
        total = announced or entry.size
        while True:
            with _one_error(entry):  # the line broke, not the disk
                block = source.read(_BLOCK)
            if not block:
                break
            target.write(block)
            digest.update(block)
            size += len(block)
            if total:
                progress(f"fetching {entry.name}", min(size / total, 1.0))
    if announced not in (None, size):
        raise FileFormatError(
            f"{entry.name}: {entry.url} was cut short at {size} of {announced} bytes: nothing was "
            f"kept"
        )
    if size == 0:
        raise FileFormatError(f"{entry.name}: {entry.url} gave an empty file")
    checksum = digest.hexdigest()
    if entry.sha256 not in (None, checksum):
        raise FileFormatError(
            f"{entry.name}: the checksum of {entry.url} is {checksum}, expected {entry.sha256}: "
            f"nothing was kept"
        )
    return checksum, size


@contextmanager
def _one_error(entry: PublicData) -> Iterator[None]:
    """Turn whatever goes wrong on the line into one line of text."""
    try:
        yield
    except (OSError, HTTPException, ValueError) as error:
        reason = getattr(error, "reason", error)
        if isinstance(error, urllib.error.HTTPError):
            reason = f"the server answers {error.code} {error.reason}"
        text = " ".join(str(getattr(reason, "strerror", None) or reason).split())
        raise FileFormatError(
            f"cannot fetch {entry.name} from {entry.url}: {text or type(error).__name__}"
        ) from None
