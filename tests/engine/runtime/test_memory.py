"""The available memory: from the system's figures, and from every limit that applies."""

import subprocess
import sys

import pytest

from lensfield.engine.runtime import memory

GB = 2**30


@pytest.fixture
def machine(tmp_path, monkeypatch):
    """A function that creates the system's files, given by name."""
    monkeypatch.setattr(memory, "PROC", tmp_path / "proc")
    monkeypatch.setattr(memory, "CONTROL_GROUPS", tmp_path / "cgroup")
    monkeypatch.setattr(memory, "_free_in_address_space", lambda: iter(()))

    def lay_out(files):
        for name, text in ({"proc/meminfo": f"MemTotal: 99 kB\nMemAvailable: {8 * GB // 1024} kB\n"} | files).items():
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / name).write_text(text)
        return memory.available_bytes()

    return lay_out


def group(folder, limit, used, inactive, version=2, active=0):
    """The files of a control group."""
    names = ("memory.max", "memory.current", "") if version == 2 else (
        "memory.limit_in_bytes", "memory.usage_in_bytes", "total_")
    return {f"{folder}/{names[0]}": f"{limit}\n", f"{folder}/{names[1]}": f"{used}\n",
            f"{folder}/memory.stat": f"anon 7\n{names[2]}inactive_file {inactive}\n{names[2]}active_file {active}\n"}


def test_without_limits_the_machines_memory_is_available(machine):
    assert machine({}) == 8 * GB
    assert machine({"proc/self/cgroup": "0::/user\n"} | group("cgroup/user", "max", 1, 0)) == 8 * GB
    assert machine({"proc/self/cgroup": "0::/\n"}) == 8 * GB  # a container may lack these files


def test_a_group_leaves_its_limit_less_its_unreclaimable_memory(machine):
    assert machine({"proc/self/cgroup": "0::/job/1\n"} | group("cgroup/job/1", 4 * GB, 3 * GB, GB // 2)) == 1.5 * GB


def test_active_pages_of_files_are_reclaimable_too(machine):
    files = group("cgroup/job", 4 * GB, 3 * GB, GB, active=GB)
    assert machine({"proc/self/cgroup": "0::/job\n"} | files) == 3 * GB


def test_a_parent_group_counts_too(machine):
    files = group("cgroup/job", 2 * GB, GB, 0) | group("cgroup/job/1", 4 * GB, 0, 0)
    assert machine({"proc/self/cgroup": "0::/job/1\n"} | files) == GB


def test_groups_of_version_1_count(machine):
    cgroup = "9:name=systemd:/\n4:cpu,memory:/job\n0::/\n"
    assert machine({"proc/self/cgroup": cgroup} | group("cgroup/memory/job", 3 * GB, GB, 0, version=1)) == 2 * GB
    assert machine({"proc/self/cgroup": cgroup} | group("cgroup/memory/job", 2**63 - 4096, GB, 0, version=1)) == 8 * GB


def test_a_group_that_is_over_its_limit_leaves_nothing(machine):
    assert machine({"proc/self/cgroup": "0::/job\n"} | group("cgroup/job", GB, 2 * GB, 0)) == 0


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems do not limit address space so")
def test_a_limited_address_space_counts():
    code = """if True:
        import resource
        from lensfield.engine.runtime import memory
        taken = int((memory.PROC / "self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (taken + 2**28, resource.RLIM_INFINITY))
        print(memory.available_bytes())"""
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert 2**27 < int(process.stdout) <= 2**28


def test_this_machine_has_memory_available():
    assert memory.available_bytes() > 0
