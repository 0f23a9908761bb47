"""Files are written whole or not at all, and what cannot be written is refused."""

import os
import stat
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from mesh_files import SQUARE, TWO_TRIANGLES
from meshes import random_sphere

from adaptsize import SimplexMesh, SizeFunction, read, write
from adaptsize._formats import vtk, writers
from adaptsize.errors import MeshFileError

posix_only = pytest.mark.skipif(sys.platform == "win32", reason="pipes with a path")


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch):
    file = tmp_path / "mesh.vtu"
    mesh = SimplexMesh(SQUARE, TWO_TRIANGLES)
    write(file, mesh)
    before = file.read_bytes()

    def fill_the_disk(path, *_):
        Path(path).write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(vtk, "write", fill_the_disk)
    with pytest.raises(MeshFileError, match=r"mesh\.vtu: .*No space left"):
        write(file, mesh)
    assert file.read_bytes() == before
    assert os.listdir(tmp_path) == ["mesh.vtu"]


def test_a_file_is_replaced_in_one_step_not_overwritten(tmp_path):
    file, second_name = tmp_path / "mesh.stl", tmp_path / "second"
    write(file, SimplexMesh(SQUARE, TWO_TRIANGLES))
    before = file.read_bytes()
    os.link(file, second_name)  # shows the old content only if that is never written into
    write(file, SimplexMesh(SQUARE, TWO_TRIANGLES[:1]))
    assert read(file).n_cells == 1
    assert second_name.read_bytes() == before


@posix_only
@pytest.mark.parametrize("suffix", [".vtkhdf", ".vtu", ".vtk", ".msh", ".inp"])
def test_a_file_is_kept_where_the_disk_has_no_room_for_the_new_one(tmp_path, capfd, suffix):
    import resource

    file, mesh = tmp_path / f"mesh{suffix}", random_sphere(2000, 7313)
    file.write_bytes(b"old")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, before[1]))
    try:
        with pytest.raises(MeshFileError, match=f"mesh{suffix}: "):
            write(file, mesh)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert file.read_bytes() == b"old"
    assert os.listdir(tmp_path) == [file.name]
    assert capfd.readouterr() == ("", "")


def test_threads_leave_what_vtk_prints_to_as_it_was(tmp_path):
    from vtkmodules.vtkCommonCore import vtkLogger, vtkOutputWindow

    mesh = random_sphere(50, 7314)
    before = vtkOutputWindow.GetInstance(), vtkLogger.GetCurrentVerbosityCutoff()
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda k: write(tmp_path / f"{k}.vtk", mesh), range(40)))
    assert (vtkOutputWindow.GetInstance(), vtkLogger.GetCurrentVerbosityCutoff()) == before


def test_an_interrupted_write_leaves_nothing(tmp_path, monkeypatch):
    def interrupt(path, *arguments, **options):
        path.write_bytes(b"half")
        raise KeyboardInterrupt

    monkeypatch.setattr(writers, "_write_with_meshio", interrupt)
    with pytest.raises(KeyboardInterrupt):
        write(tmp_path / "mesh.stl", SimplexMesh(SQUARE, TWO_TRIANGLES))
    assert os.listdir(tmp_path) == []


def test_two_writers_of_one_file_do_not_mix(tmp_path):
    meshes = [SimplexMesh(SQUARE, TWO_TRIANGLES[: 1 + k % 2]) for k in range(20)]
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda mesh: write(tmp_path / "mesh.vtu", mesh), meshes))
    assert read(tmp_path / "mesh.vtu").n_cells in (1, 2)
    assert os.listdir(tmp_path) == ["mesh.vtu"]


def test_links_and_permissions_outlive_a_rewrite(tmp_path):
    mesh = SimplexMesh(SQUARE, TWO_TRIANGLES)
    file, link = tmp_path / "mesh.vtu", tmp_path / "link.vtu"
    write(file, mesh)
    plain = tmp_path / "plain"
    plain.touch()
    assert file.stat().st_mode == plain.stat().st_mode  # as any new file
    file.chmod(0o640)
    link.symlink_to(file)
    write(link, mesh, fields={"h": np.ones(4)})
    assert link.is_symlink()
    assert file.stat().st_mode & 0o777 == 0o640
    assert "h" in read(file).point_data


@posix_only
@pytest.mark.parametrize("name", ["pipe.stl", "link.stl"])
def test_a_special_file_is_written_to_and_stays_what_it_is(tmp_path, name):
    # A pipe stands for devices such as /dev/null, which a test should not put at risk.
    pipe, link, mesh = tmp_path / "pipe.stl", tmp_path / "link.stl", random_sphere(8, 7314)
    os.mkfifo(pipe)
    link.symlink_to(pipe)
    write(tmp_path / "mesh.stl", mesh)
    with ThreadPoolExecutor(1) as pool:
        keeper = os.open(pipe, os.O_RDWR)  # a pipe replaced by a file would block the reader
        content = pool.submit(lambda: os.read(keeper, 1_000_000))
        write(tmp_path / name, mesh)
        os.write(keeper, b"end")
    written = content.result()
    os.close(keeper)
    assert written.removesuffix(b"end") == (tmp_path / "mesh.stl").read_bytes()
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    assert sorted(os.listdir(tmp_path)) == ["link.stl", "mesh.stl", "pipe.stl"]


@posix_only
def test_a_mesh_goes_to_standard_output(tmp_path):
    code = (
        "import adaptsize as ads\n"
        "mesh = ads.SimplexMesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]])\n"
        "ads.write('/dev/stdout', mesh, file_format='off')"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert done.stdout.startswith(b"OFF")


def test_unknown_suffixes_and_formats_are_answered_with_the_list(tmp_path):
    mesh = SimplexMesh(SQUARE, TWO_TRIANGLES)
    with pytest.raises(ValueError, match=r"suffix .*vtu \.vtu.*got .*mesh\.xyz"):
        write(tmp_path / "mesh.xyz", mesh)
    with pytest.raises(ValueError, match=r"file_format must be one of .*jigsaw.*got 'xyz'"):
        write(tmp_path / "mesh.vtu", mesh, file_format="xyz")


@pytest.mark.parametrize("suffix", [".mesh", ".stl", ".obj", ".off"])
def test_fields_asked_for_are_not_lost_without_a_word(tmp_path, suffix):
    mesh = SimplexMesh(SQUARE, TWO_TRIANGLES)
    with pytest.raises(ValueError, match="cannot hold nodal fields, got h"):
        write(tmp_path / f"mesh{suffix}", SizeFunction(mesh, np.ones(4)))
    with pytest.raises(ValueError, match="cannot hold nodal fields, got a, b"):
        write(tmp_path / f"mesh{suffix}", mesh, fields={"a": np.ones(4), "b": np.ones(4)})


def test_wrong_fields_and_cells_are_refused(tmp_path):
    file = tmp_path / "mesh.vtu"
    mesh = SimplexMesh(SQUARE, TWO_TRIANGLES)
    with pytest.raises(ValueError, match="4 rows"):
        write(file, mesh, fields={"h": np.ones(3)})
    with pytest.raises(ValueError, match="cannot hold segments"):
        write(tmp_path / "line.stl", SimplexMesh(SQUARE, [[0, 1]]))
    assert os.listdir(tmp_path) == []
