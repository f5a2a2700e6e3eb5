"""Writing files so that no half-written one is ever seen, and a place for compiled code."""

from __future__ import annotations

import atexit
import hashlib
import json
import os
import platform
import re
import shutil
import stat
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from ..checks import check_path
from ..errors import MissingExtraError, OutputError
from .inputs import check_no_input, find_input

if TYPE_CHECKING:
    import pandas


def write_atomically(path: str | os.PathLike[str], write: Callable[[Path], None]) -> Path:
    """Let `write` fill a temporary file beside `path`, then rename it to `path`.

    A symbolic link is followed, also one to a file that is not there yet.

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    OutputError
        If the place cannot be written, or is an input of the command; nothing is left behind.
    """
    given = check_path("path", path)
    check_no_input(given)
    try:
        target = _follow_to_file(given)
        handle, name = tempfile.mkstemp(
            dir=target.parent, prefix=f".{target.stem[:16]}.", suffix=target.suffix
        )
        os.close(handle)
    except OSError as error:
        raise OutputError(f"cannot write {given}: {error.strerror or error}") from None
    except ValueError as error:  # a null byte in the name
        raise OutputError(f"cannot write {given}: {error}") from None
    temporary = Path(name)
    try:
        write(temporary)
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        temporary.replace(target)
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(f"cannot write {given}: {error.strerror or error}") from None
    finally:
        temporary.unlink(missing_ok=True)
    return given


def _follow(path: Path) -> Path:
    """Return where the symbolic links of a path lead, whether or not there is something."""
    target = Path(os.path.realpath(path))
    if target.is_symlink():
        raise OutputError(f"cannot write {path}: its symbolic links go round in a circle")
    return target


def _follow_to_file(path: Path) -> Path:
    """Return the same, and refuse a device or pipe: a file would take its place."""
    target = _follow(path)
    if target.exists() and not (target.is_file() or target.is_dir()):
        raise OutputError(f"{path} is a device or a pipe: choose a file")
    return target


_FOR_PARQUET = ("pyarrow", "pandas")


def has_parquet() -> bool:
    """Return whether Parquet can be read and written."""
    return all(map(find_spec, _FOR_PARQUET))


def check_parquet(extra: str = "tables") -> None:
    """Raise `MissingExtraError` unless Parquet can be read and written."""
    for package in _FOR_PARQUET:
        if find_spec(package) is None:
            raise MissingExtraError(package, extra)


def write_parquet(path: str | os.PathLike[str], table: pandas.DataFrame) -> Path:
    """Write a table as Parquet, without its index.

    Raises
    ------
    MissingExtraError
        If ``pyarrow`` is not installed.
    OutputError
        If the place cannot be written; nothing is left behind.
    """
    check_parquet()
    return write_atomically(path, lambda place: table.to_parquet(place, index=False))


def check_new_file(
    path: str | os.PathLike[str], suffixes: tuple[str, ...], *, force: bool = False
) -> None:
    """Raise `OutputError` at once if a file could not be written later, before any work is done.

    Parameters
    ----------
    path : path-like
        The file to write.
    suffixes : tuple of str
        What it may end in, in small letters.
    force : bool
        Whether a file that exists may be replaced.

    Raises
    ------
    OutputError
        If it ends otherwise, is a directory, is an input of the command, exists and may not be
        replaced, or its place takes no new file.
    """
    given = check_path("path", path)
    endings = (given.suffix.lower(), "".join(given.suffixes[-2:]).lower())
    if not set(endings) & set(suffixes):
        raise OutputError(f"{given} ends in '{given.suffix}': it must end in {', '.join(suffixes)}")
    try:
        target = _follow_to_file(given)
        if not target.parent.is_dir():
            raise OutputError(f"cannot write {given}: {target.parent} is not a directory")
        if target.is_dir():
            raise OutputError(f"{given} is a directory: choose a file")
        check_no_input(given)
        if target.exists() and not force:
            raise OutputError(f"{given} exists already: choose another file or give --force")
        # Whether a place takes a file is only known by trying: permissions are not all.
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.stem[:16]}.")
        os.close(handle)
        Path(name).unlink(missing_ok=True)
    except OutputError:
        raise
    except (OSError, ValueError) as error:  # a name that is too long, a null byte
        problem = getattr(error, "strerror", None) or error
        raise OutputError(f"cannot write {given}: {problem}") from None


def write_text(path: str | os.PathLike[str], text: str) -> Path:
    """Write UTF-8 text atomically; bytes of a file name that are not UTF-8 are escaped."""
    return write_atomically(path, lambda temporary: _put_text(temporary, text))


def write_bytes(path: str | os.PathLike[str], data: bytes) -> Path:
    """Write bytes atomically."""
    return write_atomically(path, lambda temporary: _put_bytes(temporary, data))


def _put_bytes(path: Path, data: bytes) -> None:
    path.write_bytes(data)


def _put_text(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8", errors="backslashreplace")


@contextmanager
def new_directory(path: str | os.PathLike[str], *, force: bool = False) -> Iterator[Path]:
    """Give a temporary directory that becomes `path` only if the block ends well.

    Parameters
    ----------
    path : path-like
        The directory to make. A symbolic link is followed.
    force : bool
        Replace a result that exists, as a whole; without it that is an error. The old one is
        removed only when the new one is in its place.

    Raises
    ------
    OutputError
        If `path` exists (and `force` is not given, or it holds an input of the command, or files
        that are no result of Bozzini), is a file, or cannot be made, or if another process writes
        there.
    """
    with reserve_directory(path, force=force) as target:
        try:
            temporary = Path(tempfile.mkdtemp(dir=target.parent, prefix=_name_temporary(target)))
        except OSError as error:
            raise OutputError(f"cannot write {path}: {error.strerror or error}") from None
        try:
            yield temporary
            _put_in_place(temporary, target, Path(path))
        except OutputError:
            raise
        except OSError as error:
            raise OutputError(f"cannot write {path}: {error.strerror or error}") from None
        finally:
            shutil.rmtree(temporary, ignore_errors=True)


@contextmanager
def reserve_directory(path: str | os.PathLike[str], *, force: bool = False) -> Iterator[Path]:
    """Keep the name of a directory from other processes while the block runs.

    `new_directory` does the same for its own block; this is for the work before it. The lock is
    one of the operating system on a file beside `path`, so that it ends with its process. What
    killed processes left beside `path` is removed. On Windows, and on file systems without locks,
    nothing is kept and nothing removed.

    Parameters
    ----------
    path, force
        As in `new_directory`.

    Yields
    ------
    Path
        `path` as an absolute path without symbolic links.

    Raises
    ------
    OutputError
        As in `new_directory`, at once.
    """
    check_new_directory(path, force=force)
    target = Path(os.path.realpath(path))
    if target in _reserved:
        yield target
        return
    made = _make_parents(target, Path(path))
    try:
        with _lock(target.parent, _digest(target.name), Path(path)) as is_locked:
            if is_locked:
                _remove_stale(target)
            check_new_directory(path, force=force)
            _reserved.add(target)
            try:
                yield target
            finally:
                _reserved.discard(target)
    finally:
        for folder in made:
            with suppress(OSError):
                folder.rmdir()


_reserved: set[Path] = set()
"""What this process has reserved."""


def check_new_directory(path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Raise `OutputError` at once if `new_directory` would refuse this path later."""
    try:
        _check_place(Path(path), force=force)
    except OutputError:
        raise
    except (OSError, ValueError) as error:  # a name that is too long, a null byte
        problem = getattr(error, "strerror", None) or error
        raise OutputError(f"cannot write {path}: {problem}") from None


def _check_place(given: Path, *, force: bool) -> None:
    if "\0" in str(given):
        raise ValueError("the name holds a null byte")
    target = _follow(given)
    if target.is_dir():
        if not force:
            raise OutputError(f"{given} exists already: choose another directory or give --force")
        _check_replaceable(target, given)
    elif target.exists():
        raise OutputError(f"{given} is a file: choose a directory")
    ancestor = target.parent
    while not ancestor.exists() and ancestor != ancestor.parent:
        ancestor = ancestor.parent
    if not ancestor.is_dir():
        raise OutputError(f"cannot write {given}: {ancestor} is not a directory")
    for folder in (ancestor, target):
        if folder.exists() and not os.access(folder, os.W_OK | os.X_OK):
            raise OutputError(f"cannot write {given}: no permission in {folder}")


def _check_replaceable(target: Path, given: Path) -> None:
    """Refuse a directory that is more than a result of Bozzini: it is replaced as a whole."""
    with suppress(FileNotFoundError):  # a working directory that is no more
        here = Path.cwd()
        if here.is_relative_to(target):
            raise OutputError(
                f"{given} is the working directory or holds it: choose a directory inside it"
            )
    if os.path.ismount(target):
        raise OutputError(f"{given} is a mount point: choose a directory inside it")
    own = _list_own(target)
    if find_input(target) is not None:
        raise OutputError(f"{given} is an input of this command: choose another directory")

    def fail(error: OSError) -> None:
        raise error

    for folder, folders, files in os.walk(target, onerror=fail):
        folders.sort()
        for name in sorted(folders + files):
            if find_input(os.path.join(folder, name)) is not None:
                place = Path(folder, name).relative_to(target).as_posix()
                raise OutputError(
                    f"{given} holds '{place}', an input of this command, which --force would "
                    "remove: choose another directory"
                )
        links = [name for name in folders if os.path.islink(os.path.join(folder, name))]
        for name in sorted(files + links):
            place = Path(folder, name).relative_to(target).as_posix()
            if place not in own and name not in _OF_DESKTOPS:
                raise OutputError(
                    f"{given} holds '{place}', which is no file of a result: --force would remove "
                    "it, choose another directory"
                )


_OF_DESKTOPS = frozenset({".DS_Store", "Thumbs.db", "desktop.ini"})
_UNLISTED = frozenset(
    {
        *("plan.npz", "plan-tube.npz", "plan-follow.npz", "plan-thesis.npz", "scene.glb"),
        *("report.html", "picture.png", "summary.json"),
        *("tendons.csv", "tendons.parquet", "robot.npz", "robot.png"),
    }
)
"""Files of a result whose summary does not list them, as version 0.1 wrote it."""


def _list_own(target: Path) -> frozenset[str]:
    """Return the files of a result that the summary in its directory lists."""
    try:
        summary = json.loads((target / "summary.json").read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return frozenset()
    if not isinstance(summary, dict):
        return frozenset()
    listed = summary.get("files")
    if isinstance(listed, list):
        return frozenset(str(name) for name in listed)
    return _UNLISTED if "clearance_min_mm" in summary else frozenset()


def _make_parents(target: Path, given: Path) -> list[Path]:
    """Make the directories above `target`; return those that are new, the lowest first."""
    missing = []
    folder = target.parent
    while not folder.exists():
        missing.append(folder)
        folder = folder.parent
    made: list[Path] = []
    try:
        for folder in reversed(missing):
            folder.mkdir(exist_ok=True)
            made.insert(0, folder)
    except OSError as error:
        for folder in made:
            with suppress(OSError):
                folder.rmdir()
        raise OutputError(f"cannot write {given}: {error.strerror or error}") from None
    return made


def _digest(name: str) -> str:
    return hashlib.sha256(os.fsencode(name)).hexdigest()[:16]


_OLD = ".old"


def _name_temporary(target: Path) -> str:
    """Return how names of directories begin that become `target`: with its lock, and this machine.

    Locks of some file systems hold on one machine alone.
    """
    return f".bozzini-{_digest(target.name)}-{_digest(platform.node())[:8]}-"


def _remove_stale(target: Path) -> None:
    """Remove what killed processes left in the directory of `target`, whose lock is held.

    A process that is killed between its two renames leaves the old result in a temporary
    directory: it gets its name again.
    """
    known = re.compile(rf"\.bozzini-([0-9a-f]{{16}})-{_digest(platform.node())[:8]}-")
    folders: dict[str, list[Path]] = {}
    with suppress(OSError):
        for name in os.listdir(target.parent):
            found = known.match(name)
            if found is not None:
                folders.setdefault(found[1], []).append(target.parent / name)
    for digest, stale in folders.items():
        own = digest == _digest(target.name)
        lock = nullcontext(True) if own else _lock(target.parent, digest, target)
        with suppress(OutputError), lock as is_locked:
            for folder in stale if is_locked else []:
                with suppress(OSError):
                    for old in folder.glob(f"{_OLD}/*"):
                        if not (target.parent / old.name).exists():
                            old.rename(target.parent / old.name)
                    shutil.rmtree(folder)


@contextmanager
def _lock(place: Path, digest: str, given: Path) -> Iterator[bool]:
    """Hold a lock on a file in `place`, which is there only meanwhile; give whether it holds.

    `digest` is that of the name of the directory that is written there.
    """
    if sys.platform == "win32":
        yield False
        return
    import fcntl

    file = place / f".bozzini-{digest}.lock"
    descriptor, is_locked = -1, True
    try:
        while descriptor < 0:
            descriptor = os.open(file, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                os.close(descriptor)
                raise OutputError(
                    f"another run is writing {given}: choose another directory or wait for its end"
                ) from None
            except OSError:
                is_locked = False  # this file system has no locks
            # Who held it before may have removed its file between the two calls above.
            if not _is_open_file(descriptor, file):
                os.close(descriptor)
                descriptor = -1
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(f"cannot write {given}: {error.strerror or error}") from None
    try:
        yield is_locked
    finally:
        with suppress(OSError):
            file.unlink()
        os.close(descriptor)


def _is_open_file(descriptor: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), os.stat(path))
    except FileNotFoundError:
        return False


def _put_in_place(temporary: Path, target: Path, given: Path) -> None:
    if not target.exists():
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o777 & ~umask)
        temporary.rename(target)
        return
    _check_replaceable(target, given)  # files may have come since
    shutil.copymode(target, temporary)
    aside = Path(tempfile.mkdtemp(dir=target.parent, prefix=_name_temporary(target)))
    old = aside / _OLD / target.name
    old.parent.mkdir()
    try:
        target.rename(old)
        temporary.rename(target)
    except BaseException:
        if old.exists() and not target.exists():
            old.rename(target)
        raise
    finally:
        if target.exists():
            shutil.rmtree(aside, ignore_errors=True)


def provide_caches() -> None:
    """Give Numba and matplotlib a temporary directory each, if they have no place of their own.

    Numba keeps compiled code in ``NUMBA_CACHE_DIR``, beside the modules, or in the user's cache
    directory, and stops with an error if it can write none of them, as in a read-only installation
    without a home. Then ``NUMBA_CACHE_DIR`` is set to a directory below the temporary one: the
    same for every run of one user, and only if nobody else can have written there, for code is
    loaded from it. Likewise matplotlib and ``MPLCONFIGDIR``.
    """
    wanted = {"NUMBA_CACHE_DIR": find_compiled_code() is None}
    config = os.environ.get("MPLCONFIGDIR") or _find_matplotlib_config()
    wanted["MPLCONFIGDIR"] = not _takes_files(config)
    if not any(wanted.values()):
        return
    with suppress(OSError):  # no temporary directory either
        base = _find_private_directory()
        for name in (name for name, missing in wanted.items() if missing):
            os.environ[name] = _provided[name] = os.path.join(base, name.split("_")[0].lower())
    if "NUMBA_CACHE_DIR" in _provided and "numba" in sys.modules:  # it has read the variable
        sys.modules["numba"].config.CACHE_DIR = _provided["NUMBA_CACHE_DIR"]


_provided: dict[str, str] = {}


def find_compiled_code() -> str | None:
    """Return where Numba keeps compiled code: the first of its places that takes files, or None."""
    places = [os.environ.get("NUMBA_CACHE_DIR", ""), *_list_packages(), _find_numba_cache()]
    return next(filter(_takes_files, places), None)


def find_provided_cache() -> str | None:
    """Return where compiled code goes if that is a temporary directory of `provide_caches`."""
    return _provided.get("NUMBA_CACHE_DIR")


def find_cache(name: str) -> Path:
    """Return a directory for files that can be made anew, in the user's cache directory.

    Where that cannot be written it lies in a temporary directory that nobody else can write.

    Parameters
    ----------
    name : str
        What the files are for.
    """
    base = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    place = Path(base, "bozzini", name)
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError:
        pass
    if not _takes_files(str(place)):
        place = Path(_find_private_directory(), name)
        place.mkdir(exist_ok=True)
    return place


def _list_packages() -> list[str]:
    """Return the directory of this package if it and all below it can be written, else nothing."""
    here = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    return [here] if all(os.access(folder, os.W_OK) for folder, _, _ in os.walk(here)) else []


def _find_private_directory() -> str:
    base = tempfile.gettempdir()
    if sys.platform == "win32":  # it is the user's own there
        place = os.path.join(base, "bozzini")
        os.makedirs(place, exist_ok=True)
        return place
    place = os.path.join(base, f"bozzini-{os.getuid()}")
    with suppress(FileExistsError):
        os.mkdir(place, 0o700)
    found = os.lstat(place)
    private = stat.S_ISDIR(found.st_mode) and not found.st_mode & 0o077
    if private and found.st_uid == os.getuid() and _takes_files(place):
        return place
    place = tempfile.mkdtemp(prefix="bozzini-")
    atexit.register(shutil.rmtree, place, ignore_errors=True)
    return place


def _find_numba_cache() -> str:
    """Return where Numba keeps compiled code of a package that cannot be written."""
    if sys.platform == "win32":
        return os.path.join(os.environ.get("LOCALAPPDATA", ""), "numba", "Cache")
    if sys.platform == "darwin":
        return os.path.expanduser("~/Library/Caches/numba")
    base = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    return os.path.join(base, "numba")


def _find_matplotlib_config() -> str:
    if sys.platform in ("win32", "darwin"):
        return os.path.expanduser("~/.matplotlib")
    base = os.environ.get("XDG_CONFIG_HOME") or os.path.expanduser("~/.config")
    return os.path.join(base, "matplotlib")


def _takes_files(folder: str) -> bool:
    """Return whether a directory can be made, if need be, and written: permissions are not all."""
    if not folder:
        return False
    try:
        os.makedirs(folder, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except (OSError, ValueError):
        return False
    return True
