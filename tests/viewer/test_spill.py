import errno
import os
from pathlib import Path

import pytest

from viewer.spill import Spill


def test_what_is_written_is_in_the_file_once_settled(tmp_path):
    spill = Spill(tmp_path / "file")
    with open(spill.entrance, "wb", buffering=0) as writer:
        spill.seal()
        for count in (1, 1000, 3_000_000):
            writer.write(b"x" * count)
            spill.settle()
            assert (tmp_path / "file").stat().st_size >= count
    spill.close()
    assert (tmp_path / "file").read_bytes() == b"x" * 3_001_001


def test_a_full_disk_is_told_to_the_owner_and_not_to_the_writer(tmp_path, monkeypatch):
    spill = Spill(tmp_path / "file")
    with open(spill.entrance, "wb", buffering=0) as writer:
        spill.seal()
        writer.write(b"kept")
        spill.settle()

        class Full:
            def __init__(self, file):
                self._file = file

            def write(self, content):
                self._file.write(content[:1])  # a full disk takes the first bytes
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

            def __getattr__(self, name):
                return getattr(self._file, name)

        monkeypatch.setattr(spill, "_file", Full(spill._file))
        for _ in range(3):
            writer.write(b"y" * 1_000_000)
        with pytest.raises(OSError, match="No space left"):
            spill.settle()
    with pytest.raises(OSError, match="No space left"):
        spill.close()
    assert (tmp_path / "file").read_bytes() == b"kept"


def test_a_file_that_cannot_be_made_is_an_error(tmp_path):
    with pytest.raises(OSError, match="No such file"):
        Spill(Path(tmp_path / "missing" / "file"))
