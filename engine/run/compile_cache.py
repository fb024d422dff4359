"""Where compiled kernels are kept: one directory per version of the engine's sources.

Numba's cache notices an edit of the file that a kernel is in, but not of the files whose kernels it calls. A
directory named by a hash of all engine sources can never hold a stale kernel. This module imports nothing that
imports numba, since numba reads the directory when it is imported.
"""

import hashlib
import os
import re
import shutil
import sys
from pathlib import Path

ENGINE = Path(__file__).resolve().parents[1]
KEPT = 4  # directories of this and of earlier versions that stay, so that switching back and forth costs nothing
_NAME = re.compile(r"[0-9a-f]{16}")


def prepare_compile_cache() -> Path:
    """Point numba at the directory of these sources, drop directories long unused, and return the directory.

    The parent is `STRANDLINE_CACHE_DIR` where that is set, else `strandline` in the user's cache directory. Further
    calls return the same directory. Raises RuntimeError when numba was imported before the first: kernels would then
    be cached elsewhere, keyed on less.
    """
    if "numba" in sys.modules:
        current = Path(os.environ.get("NUMBA_CACHE_DIR", ""))
        if current.parent != cache_parent():
            raise RuntimeError("prepare_compile_cache() must be called before numba is imported")
        return current
    directory = cache_parent() / source_hash(ENGINE)
    directory.mkdir(parents=True, exist_ok=True)
    os.utime(directory)  # the time of last use, which pruning goes by
    os.environ["NUMBA_CACHE_DIR"] = str(directory)
    # threads that wait for each other in a spin stand still for minutes where several jobs share the processors
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    prune(directory.parent, KEPT)
    return directory


def cache_parent() -> Path:
    """Return the directory that holds the compile caches of all versions."""
    if override := os.environ.get("STRANDLINE_CACHE_DIR"):
        return Path(override).absolute()
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "strandline"


def source_hash(package: Path) -> str:
    """Return 16 hexadecimal digits that change with any Python source below `package`."""
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        source = path.read_bytes()
        digest.update(f"{path.relative_to(package).as_posix()} {len(source)}\n".encode())
        digest.update(source)
    return digest.hexdigest()[:16]


def prune(parent: Path, kept: int) -> None:
    """Delete all but the `kept` caches below `parent` that were used last; other directories are left alone."""
    caches = [path for path in parent.iterdir() if _NAME.fullmatch(path.name) and path.is_dir()]
    for path in sorted(caches, key=_last_use, reverse=True)[kept:]:
        shutil.rmtree(path, ignore_errors=True)  # another process may be pruning the same directory


def _last_use(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except FileNotFoundError:  # pruned by another process meanwhile
        return 0.0
