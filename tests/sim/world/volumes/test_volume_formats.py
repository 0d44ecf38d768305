"""Files of labels as other programs write them: read where their content can be, and refused with what to do."""

import gzip
import shutil
from pathlib import Path

import nibabel
import numpy as np
import pytest
import SimpleITK
from scanned_ball import assert_is_the_ball, ball_labels, default_file, grid, load, save_nifti

from sim.world.errors import MeshError, VolumeError
from sim.world.meshes.meshes import load_mesh
from sim.world.volumes.files import files_of, load_volume

RAS_FROM_LPS = np.diag([-1.0, -1.0, 1.0, 1.0])


def test_whether_a_file_is_packed_is_told_by_its_bytes(tmp_path):
    plain = default_file(tmp_path, "plain.nii")
    shutil.copy(plain, tmp_path / "named.nii.gz")
    (tmp_path / "packed.nii").write_bytes(gzip.compress(plain.read_bytes()))
    for name in ("named.nii.gz", "packed.nii"):
        assert_is_the_ball(load(tmp_path / name))


def test_a_cut_file_is_cut_whatever_its_name(tmp_path):
    plain = default_file(tmp_path, "plain.nii").read_bytes()
    (tmp_path / "named.nii.gz").write_bytes(plain[: len(plain) // 2])
    packed = gzip.compress(np.random.default_rng(0).bytes(100) + plain)
    (tmp_path / "packed.nii").write_bytes(gzip.compress(plain)[: len(packed) // 2])
    for name in ("named.nii.gz", "packed.nii"):
        with pytest.raises(VolumeError, match="cut short"):
            load_volume(tmp_path / name)


def test_an_nrrd_file_is_told_by_its_first_bytes(tmp_path):
    T, shape = grid()
    image = SimpleITK.GetImageFromArray(ball_labels(T, shape).T)
    image.SetSpacing([3.0] * 3)
    image.SetOrigin(T[:3, 3])
    SimpleITK.WriteImage(image, str(tmp_path / "seg.nrrd"))
    shutil.move(tmp_path / "seg.nrrd", tmp_path / "seg.nii")
    assert_is_the_ball(load(tmp_path / "seg.nii"))


@pytest.mark.parametrize("named", ["seg.hdr", "seg.img"])
def test_a_pair_of_header_and_voxels_is_read_by_either_name(tmp_path, named):
    T, shape = grid()
    labels = ball_labels(T, shape)
    nibabel.save(nibabel.Nifti1Pair(labels, RAS_FROM_LPS @ T), tmp_path / "seg.img")
    assert_is_the_ball(load(tmp_path / named))
    itk = SimpleITK.ReadImage(str(tmp_path / "seg.hdr"))
    place_mm = np.array(itk.TransformIndexToPhysicalPoint([n - 1 for n in shape]))
    volume = load_volume(tmp_path / named)
    corner = [n - 1 - each.start for n, each in zip(shape, volume.box, strict=True)]
    assert (volume.T_lps_voxel @ [*corner, 1.0])[:3] * 1e3 == pytest.approx(place_mm, abs=1e-3)
    (tmp_path / ("seg.img" if named == "seg.hdr" else "seg.hdr")).unlink()
    with pytest.raises(VolumeError, match="is one of a pair, and the other"):
        load(tmp_path / named)


def test_analyze_which_does_not_know_left_from_right_is_refused(tmp_path):
    nibabel.save(nibabel.AnalyzeImage(np.ones((9, 9, 9), np.uint8), np.eye(4)), tmp_path / "seg.img")
    with pytest.raises(VolumeError, match=r"does not tell left from right; save it as \.nii\.gz or \.nrrd"):
        load(tmp_path / "seg.hdr")


@pytest.mark.parametrize("name", ["seg.mgz", "seg.mgh"])
@pytest.mark.parametrize("dtype", [np.uint8, np.int32, np.float32])
def test_freesurfers_files_are_read(tmp_path, name, dtype):
    T, shape = grid(flip=(-1, 1, 1))
    nibabel.save(nibabel.MGHImage(ball_labels(T, shape).astype(dtype), RAS_FROM_LPS @ T), tmp_path / name)
    assert_is_the_ball(load(tmp_path / name))


@pytest.mark.parametrize(
    "name", ["seg.mha", "seg.mhd", "SEG.MHA", "seg.gipl", "seg.mnc", "seg.nii.bz2", "seg.tif"]
)
def test_other_formats_of_volumes_are_refused_with_how_to_convert(tmp_path, name):
    (tmp_path / name).write_bytes(b"ObjectType = Image\n")
    with pytest.raises(VolumeError, match=r"is not read; save it as \.nii\.gz or \.nrrd, in 3D Slicer by"):
        load(tmp_path / name)


def test_dicom_is_told_by_name_or_content_file_or_folder(tmp_path):
    folder = tmp_path / "series"
    folder.mkdir()
    (folder / "IM0001").write_bytes(bytes(128) + b"DICM" + bytes(200))
    (tmp_path / "seg.dcm").write_bytes(b"old")
    for path in (folder, folder / "IM0001"):
        with pytest.raises(VolumeError, match="only a SEG object is read, .* with 3D Slicer's DICOM module"):
            load(path)
    with pytest.raises(VolumeError, match="cannot be read as DICOM"):
        load(tmp_path / "seg.dcm")


def test_a_folder_is_a_folder(tmp_path):
    (tmp_path / "seg.nii.gz").mkdir()
    with pytest.raises(VolumeError, match="is a folder; name the file in it"):
        load(tmp_path / "seg.nii.gz")
    (tmp_path / "empty").mkdir()
    with pytest.raises(MeshError, match="is a folder; name the file in it"):
        load(tmp_path / "empty")


def test_meshes_of_other_formats_and_packed_ones_are_refused_with_what_to_do(tmp_path):
    (tmp_path / "liver.vtk").write_text("# vtk DataFile")
    with pytest.raises(MeshError, match="3D Slicer, MeshLab and Blender save them"):
        load_mesh(tmp_path / "liver.vtk")
    (tmp_path / "liver.stl").write_bytes(gzip.compress(b"solid"))
    with pytest.raises(MeshError, match="is packed by gzip; unpack it first"):
        load_mesh(tmp_path / "liver.stl")


def test_an_absent_file_is_absent(tmp_path):
    save_nifti(tmp_path / "seg.nii", np.ones((4, 4, 4), np.uint8), np.eye(4))
    for name in ("other.nii", "other.mha", "other.dcm", "other"):
        with pytest.raises((VolumeError, MeshError), match="no such file"):
            load(tmp_path / name)


def test_a_body_is_read_from_the_file_that_is_named_and_from_its_voxels_beside_it(tmp_path):
    head, data = tmp_path / "seg.nhdr", tmp_path / "voxels.raw"
    head.write_bytes(
        b"NRRD0004\ntype: uchar\ndimension: 3\nsizes: 2 2 2\nencoding: raw\ndata file: voxels.raw\n\n"
    )
    data.write_bytes(bytes(8))
    assert files_of(head) == (head, data)
    pair = tmp_path / "old.hdr", tmp_path / "old.img"
    for file in pair:
        file.touch()
    assert [files_of(file) for file in pair] == [pair, pair]
    assert files_of(Path("default")) == (Path("default"),)
    head.write_bytes(b"no header")
    with pytest.raises(VolumeError, match=r"seg\.nhdr: cannot be read as NRRD"):
        files_of(head)
