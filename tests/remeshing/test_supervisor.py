"""The supervisor of a generator starts quickly, and its end is noticed."""

import subprocess
import sys

import pytest

from adaptsize import _supervisor
from adaptsize._children import ends_within, supervised
from adaptsize._supervisor import job_line

#: Modules that take several milliseconds each.
SLOW = ("contextlib", "json", "pathlib", "shutil", "signal", "subprocess", "threading", "typing")


def test_it_imports_no_large_modules():
    code = "import sys; exec(open(sys.argv[1]).read(), {'__name__': 'it'}); print(*sys.modules)"
    line = [sys.executable, "-I", "-S", "-c", code, _supervisor.__file__]
    done = subprocess.run(line, check=True, capture_output=True, text=True)
    assert not set(SLOW) & set(done.stdout.split())


@pytest.mark.parametrize("word", ["plain", "with space", "line\nbreak", 'quote"', "Größe"])
def test_jobs_keep_their_words(word):
    code = "import sys; from adaptsize._supervisor import _read_job; print(ascii(_read_job()))"
    done = subprocess.run(
        [sys.executable, "-c", code], input=job_line(["program", word], 1.5), check=True,
        capture_output=True,
    )  # fmt: skip
    assert done.stdout.decode().strip() == ascii((["program", word], 1.5))


def test_the_end_of_a_child_is_noticed():
    child = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    assert not ends_within(child, 0.05)
    child.communicate(b"\n")
    assert ends_within(child, 10.0)


@pytest.mark.skipif(sys.platform != "linux", reason="orphans are adopted on Linux")
def test_a_supervised_job_imports_from_no_folder_of_the_package(tmp_path):
    """Modules of the package have the names of standard ones, such as `io` and `typing`."""
    child = subprocess.Popen(supervised(tmp_path), stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    child.stdin.write(job_line([sys.executable, "-c", "print(6 * 7)"], 60.0))
    child.stdin.flush()
    assert child.stdout.read() == b"42\n"
    child.stdin.close()
    assert child.wait(10.0) == 0
