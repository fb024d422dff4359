import os
import subprocess
import sys
from pathlib import Path

import numba
import pytest

from engine.run.compile_cache import prepare_compile_cache, prune, source_hash
from engine.run.threads import FEW_NODES, available_threads, set_threads, threads_for


def test_hash_changes_with_every_source_and_nothing_else(tmp_path):
    (tmp_path / "part").mkdir()
    (tmp_path / "part" / "a.py").write_text("x = 1")
    before = source_hash(tmp_path)
    (tmp_path / "notes.txt").write_text("not a source")
    assert source_hash(tmp_path) == before
    (tmp_path / "part" / "a.py").write_text("x = 2")
    assert source_hash(tmp_path) != before


def test_old_caches_are_pruned_and_other_directories_kept(tmp_path):
    for age in range(6):
        cache = tmp_path / f"{age:016x}"
        cache.mkdir()
        os.utime(cache, (1000 - age, 1000 - age))
    (tmp_path / "something else").mkdir()
    prune(tmp_path, 2)
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"{0:016x}", f"{1:016x}", "something else"]


def test_kernels_of_a_new_process_are_cached_under_the_given_parent(tmp_path):
    program = (
        "import sys; from engine.run.compile_cache import prepare_compile_cache\n"
        "directory = prepare_compile_cache(); assert 'numba' not in sys.modules\n"
        "import numba; print(directory, numba.config.CACHE_DIR)"
    )
    environment = os.environ | {"STRANDLINE_CACHE_DIR": str(tmp_path)}
    environment.pop("NUMBA_CACHE_DIR", None)
    root = Path(__file__).resolve().parents[3]
    said = subprocess.run(
        [sys.executable, "-c", program], env=environment, cwd=root, check=True, capture_output=True, text=True
    ).stdout.split()
    assert said[0] == said[1] and Path(said[0]).parent == tmp_path


def test_a_call_after_numba_is_refused(monkeypatch, tmp_path):
    prepare_compile_cache()  # the same directory again is no harm
    monkeypatch.setenv("STRANDLINE_CACHE_DIR", str(tmp_path))
    with pytest.raises(RuntimeError, match="before numba"):
        prepare_compile_cache()


def test_threads_are_set_for_the_calling_thread():
    try:
        assert set_threads(1) == 1 and numba.get_num_threads() == 1
        assert set_threads() == min(available_threads(), numba.config.NUMBA_NUM_THREADS)
        for wrong in (0, 10_000):
            with pytest.raises(ValueError, match="between 1 and"):
                set_threads(wrong)
    finally:
        set_threads()


def test_small_systems_have_one_thread_and_leave_the_others_theirs():
    most = set_threads()
    with threads_for(FEW_NODES - 1) as count:
        assert count == 1 and numba.get_num_threads() == 1
    with threads_for(FEW_NODES) as count:
        assert count == most and numba.get_num_threads() == most
    with pytest.raises(ValueError, match="in the midst"), threads_for(1):
        raise ValueError("in the midst")
    assert numba.get_num_threads() == most
