"""DICOM: a SEG is an organ with its tumour, and a map comes out on the same millimetre of the same slices."""

import json
import shutil

import nibabel
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim.errors import UsageError
from sim.running.run_episode import run_episode
from sim.viewing.export import export_map
from sim.world.anatomy.case_files import CaseFiles
from sim.world.anatomy.loading import load_anatomy
from sim.world.errors import VolumeError
from sim.world.volumes.files import load_volume

highdicom = pytest.importorskip("highdicom")
sitk = pytest.importorskip("SimpleITK")
import pydicom  # noqa: E402, highdicom brings it
from ct_series import write_series  # noqa: E402
from pydicom.sr.codedict import codes  # noqa: E402

SHAPE = (70, 60, 44)
CENTRE_MM, RADIUS_MM = np.array([20.0, -30.0, 90.0]), 45.0
TUMOUR_MM, TUMOUR_RADIUS_MM = CENTRE_MM + np.array([12.0, -15.0, 8.0]), 10.0
SAME_MM = 1e-4
"""DICOM writes coordinates as texts of 10 digits."""


@pytest.fixture(scope="module")
def series(tmp_path_factory):
    """The folder of an oblique series about a ball, and its map from indices to LPS [mm]."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xyz", [6.0, -9.0, 14.0], degrees=True).as_matrix() * [1.6, 1.9, 2.5]
    T[:3, 3] = CENTRE_MM - T[:3, :3] @ (np.array(SHAPE) - 1) / 2
    folder = tmp_path_factory.mktemp("dicom") / "ct"
    write_series(folder, T, SHAPE)
    return folder, T


def places_mm(T, shape):
    """Where the voxels lie, shape (I, J, K, 3)."""
    index = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1)
    return index @ T[:3, :3].T + T[:3, 3]


def write_segmentation(folder, T, file, kind):
    """A SEG of ball and tumour by highdicom; both segments hold the tumour's voxels."""
    slices = sorted((pydicom.dcmread(each) for each in folder.iterdir()), key=lambda ds: ds.InstanceNumber)
    places = places_mm(T, SHAPE)
    masks = [
        np.linalg.norm(places - centre, axis=-1) < radius
        for centre, radius in ((CENTRE_MM, RADIUS_MM), (TUMOUR_MM, TUMOUR_RADIUS_MM))
    ]
    pixels = np.stack([mask.transpose(2, 1, 0) for mask in masks], axis=-1)
    algorithm = highdicom.AlgorithmIdentificationSequence("test", codes.DCM.ArtificialIntelligence, "1")
    described = [
        highdicom.seg.SegmentDescription(
            number, name, codes.SCT.Organ, codes.SCT.Organ, "AUTOMATIC", algorithm_identification=algorithm
        )
        for number, name in ((1, "Liver"), (2, "Liver tumor"))
    ]
    highdicom.seg.Segmentation(
        slices, pixels.astype(np.uint8 if kind == "BINARY" else float), kind, described,
        series_instance_uid=highdicom.UID(), series_number=2, sop_instance_uid=highdicom.UID(), instance_number=1,
        manufacturer="test", manufacturer_model_name="test", software_versions="1", device_serial_number="1",
    ).save_as(file)  # fmt: skip
    return masks


@pytest.mark.parametrize("kind", ["BINARY", "FRACTIONAL"])
def test_a_segmentation_is_read_where_its_series_lies(series, tmp_path, kind):
    folder, T = series
    masks = write_segmentation(folder, T, tmp_path / "seg.dcm", kind)
    volume = load_volume(tmp_path / "seg.dcm")
    assert volume.label_names == {1: "Liver", 2: "Liver tumor"}
    assert volume.counts == {1: masks[0].sum(), 2: masks[1].sum()}
    # SimpleITK says where the series' voxels lie, by its own reading of the slices.
    names = sitk.ImageSeriesReader.GetGDCMSeriesFileNames(str(folder))
    scan = sitk.ReadImage(names)
    for label, mask in enumerate(masks, start=1):
        index = np.argwhere(np.isin(volume.labels, volume.numbers_of([label])))
        read_mm = 1e3 * (index @ volume.T_lps_voxel[:3, :3].T + volume.T_lps_voxel[:3, 3])
        in_scan = [scan.TransformPhysicalPointToContinuousIndex(place) for place in read_mm[::50].tolist()]
        np.testing.assert_allclose(in_scan, np.rint(in_scan), atol=SAME_MM)
        # The pixels of the series hold the index of their slice, which tells the mask's voxel.
        for i, j, k in np.rint(in_scan).astype(int).tolist():
            assert mask[i, j, scan.GetPixel(i, j, k)]


def test_organ_and_tumour_of_a_segmentation_are_those_of_the_scan(series, tmp_path):
    folder, T = series
    write_segmentation(folder, T, tmp_path / "seg.dcm", "BINARY")
    anatomy = load_anatomy(CaseFiles(organ=str(tmp_path / "seg.dcm")))
    assert len(anatomy.tumours) == 1
    for solid, centre, radius in (
        (anatomy.organ, CENTRE_MM, RADIUS_MM),
        (anatomy.tumours[0], TUMOUR_MM, TUMOUR_RADIUS_MM),
    ):
        # Surfaces of voxels of 2 mm, smoothed: a tenth of a voxel in place, and 5 % in volume.
        np.testing.assert_allclose(1e3 * solid.vertices_m.mean(axis=0), centre, atol=0.6)
        assert solid.volume_m3 * 1e9 == pytest.approx(4.0 / 3.0 * np.pi * radius**3, rel=0.08)


@pytest.fixture(scope="module")
def exported(series, tmp_path_factory):
    """A run on the SEG, and the folder of its map in all formats."""
    folder, T = series
    here = tmp_path_factory.mktemp("run")
    write_segmentation(folder, T, here / "seg.dcm", "BINARY")
    (here / "coarse.toml").write_text(
        f'organ = "{here / "seg.dcm"}"\nn_poses = 200\nscore_spacing_m = 0.006\n'
    )
    run = here / "out"
    run_episode(
        scenario=str(here / "coarse.toml"), arm="none", steps=3, out=run, report=False, show_progress=False
    )
    shutil.copytree(run, here / "copy")
    export_map(
        run, here / "all", formats=("nifti", "seg-nrrd", "dicom"), series=folder, notify=lambda text: None
    )
    return here


def test_a_map_as_segmentation_has_the_labels_of_the_same_millimetres(series, exported):
    folder, _ = series
    ds = pydicom.dcmread(exported / "all" / "map_segmentation.dcm")
    scan = sitk.ReadImage(sitk.ImageSeriesReader.GetGDCMSeriesFileNames(str(folder)))
    labels = nibabel.load(exported / "all" / "map_on_scan_labels.nii.gz")
    values, to_voxel = np.asarray(labels.dataobj), np.linalg.inv(labels.affine)
    names = {each.SegmentNumber: each.SegmentLabel for each in ds.SegmentSequence}
    assert set(names.values()) == {"organ", "mapped tumour", "in no cone"}
    instances = {pydicom.dcmread(each).SOPInstanceUID for each in folder.iterdir()}
    meant = {"organ": (1, 2, 4), "mapped tumour": (2,), "in no cone": (4,)}
    shared = ds.SharedFunctionalGroupsSequence[0]
    row, column = np.array(shared.PlaneOrientationSequence[0].ImageOrientationPatient, float).reshape(2, 3)
    between_rows, between_columns = map(float, shared.PixelMeasuresSequence[0].PixelSpacing)
    n = dict.fromkeys(names.values(), 0)
    for frame, pixels in zip(ds.PerFrameFunctionalGroupsSequence, ds.pixel_array, strict=True):
        name = names[frame.SegmentIdentificationSequence[0].ReferencedSegmentNumber]
        source = frame.DerivationImageSequence[0].SourceImageSequence[0]
        assert source.ReferencedSOPInstanceUID in instances
        corner = np.array(frame.PlanePositionSequence[0].ImagePositionPatient, float)
        j, i = np.nonzero(pixels)
        n[name] += len(i)
        lps_mm = corner + np.outer(i * between_columns, row) + np.outer(j * between_rows, column)
        in_scan = scan.TransformPhysicalPointToContinuousIndex(lps_mm[0].tolist())
        np.testing.assert_allclose(in_scan[:2], [i[0], j[0]], atol=SAME_MM)
        # The same places in the volume of NIfTI, which is RAS.
        ras_mm = np.column_stack([lps_mm * [-1.0, -1.0, 1.0], np.ones(len(lps_mm))])
        index = np.rint((ras_mm @ to_voxel.T)[:, :3]).astype(int)
        assert np.abs((ras_mm @ to_voxel.T)[:, :3] - index).max() < 1e-3
        assert np.isin(values[tuple(index.T)], meant[name]).all()
    assert n == {name: int(np.isin(values, wanted).sum()) for name, wanted in meant.items()}


def test_a_parametric_map_holds_the_probabilities(exported):
    ds = pydicom.dcmread(exported / "all" / "map_probability.dcm")
    mapping = ds.SharedFunctionalGroupsSequence[0].RealWorldValueMappingSequence[0]
    read = ds.pixel_array * float(mapping.RealWorldValueSlope) + float(mapping.RealWorldValueIntercept)
    expected = nibabel.load(exported / "all" / "map_on_scan_probability.nii.gz").get_fdata()
    # Both keep steps of 0.004, of the same voxels; those of DICOM are a part of the series.
    assert np.sort(read[read > 0]) == pytest.approx(np.sort(expected[expected > 1e-9]), abs=1e-6)
    assert ds.Modality != "SEG"
    assert ds.SOPClassUID == "1.2.840.10008.5.1.4.1.1.30"


def test_slicers_segmentation_has_names_colours_and_the_labels_of_the_same_millimetres(exported):
    shown = sitk.ReadImage(str(exported / "all" / "map.seg.nrrd"))
    plain = sitk.ReadImage(str(exported / "all" / "map_labels.nii.gz"))
    np.testing.assert_array_equal(sitk.GetArrayFromImage(shown), sitk.GetArrayFromImage(plain))
    for index in ((0, 0, 0), (3, 5, 7)):
        there, here = (each.TransformIndexToPhysicalPoint(index) for each in (shown, plain))
        np.testing.assert_allclose(there, here, atol=1e-3)  # NIfTI's header is in single precision
    names = {
        shown.GetMetaData(f"Segment{i}_LabelValue"): shown.GetMetaData(f"Segment{i}_Name") for i in range(3)
    }
    assert names == {"1": "organ", "2": "mapped tumour", "4": "in no cone"}
    colour = [float(part) for part in shown.GetMetaData("Segment1_Color").split()]
    assert colour == pytest.approx([0x00 / 255, 0x72 / 255, 0xB2 / 255], abs=1e-6)
    assert load_volume(exported / "all" / "map.seg.nrrd").label_names[2] == "mapped tumour"


def test_the_same_map_gives_the_same_identifiers_and_the_run_is_left_as_it_was(series, exported):
    export_map(exported / "out", exported / "again", formats=("seg-nrrd", "dicom"), series=series[0])
    assert (exported / "again" / "map.seg.nrrd").read_bytes() == (
        exported / "all" / "map.seg.nrrd"
    ).read_bytes()
    first, second = (pydicom.dcmread(exported / name / "map_segmentation.dcm") for name in ("all", "again"))
    assert first.SOPInstanceUID == second.SOPInstanceUID
    assert first.PixelData == second.PixelData
    kept = sorted(each.name for each in (exported / "out").iterdir())
    assert kept == sorted(each.name for each in (exported / "copy").iterdir())
    assert json.loads((exported / "out" / "summary.json").read_text())["scenario"]


def test_a_series_that_is_none_or_lies_elsewhere_is_told(series, exported, tmp_path):
    (tmp_path / "empty").mkdir()
    with pytest.raises(UsageError, match="holds 0 series"):
        export_map(exported / "out", tmp_path / "out", formats=("dicom",), series=tmp_path / "empty")
    T = series[1].copy()
    T[:3, 3] += 1000.0
    write_series(tmp_path / "away", T, (20, 20, 10))
    with pytest.raises(UsageError, match="in no slice of the series"):
        export_map(exported / "out", tmp_path / "out", formats=("dicom",), series=tmp_path / "away")
    next((tmp_path / "away").iterdir()).unlink()
    files = sorted((tmp_path / "away").iterdir())
    files[4].unlink()
    with pytest.raises(UsageError, match="slices are missing"):
        export_map(exported / "out", tmp_path / "out", formats=("dicom",), series=tmp_path / "away")
    assert not (tmp_path / "out").exists()


def edited_series(folder, to, edit):
    """A series whose slices were edited."""
    to.mkdir()
    for file in folder.iterdir():
        ds = pydicom.dcmread(file)
        edit(ds)
        ds.save_as(to / file.name)
    return to


def test_a_series_without_names_is_enough_and_its_map_is_an_object_of_its_own(series, exported, tmp_path):
    others = {name: pydicom.uid.generate_uid() for name in ("StudyInstanceUID", "SeriesInstanceUID")}

    def without_names(ds):
        for name in ("PatientBirthDate", "AccessionNumber", "StudyID", "PatientSex", "StudyTime"):
            if name in ds:
                delattr(ds, name)
        ds.update({pydicom.datadict.tag_for_keyword(name): pydicom.DataElement(
            pydicom.datadict.tag_for_keyword(name), "UI", uid) for name, uid in others.items()})  # fmt: skip

    folder = edited_series(series[0], tmp_path / "nameless", without_names)
    export_map(exported / "out", tmp_path / "out", formats=("dicom",), series=folder)
    for name in ("segmentation", "probability"):
        here, there = (
            pydicom.dcmread(where / f"map_{name}.dcm") for where in (tmp_path / "out", exported / "all")
        )
        assert here.StudyInstanceUID == others["StudyInstanceUID"]
        assert here.PixelData == there.PixelData
        # One archive may hold both.
        assert here.SOPInstanceUID != there.SOPInstanceUID
        assert here.SeriesInstanceUID != there.SeriesInstanceUID


def test_a_series_without_a_frame_of_reference_is_told(series, exported, tmp_path):
    folder = edited_series(series[0], tmp_path / "lost", lambda ds: delattr(ds, "FrameOfReferenceUID"))
    with pytest.raises(UsageError, match="lacks FrameOfReferenceUID"):
        export_map(exported / "out", tmp_path / "out", formats=("dicom",), series=folder)


def test_a_segmentation_that_is_damaged_is_told_in_one_sentence(series, tmp_path):
    folder, T = series
    write_segmentation(folder, T, tmp_path / "seg.dcm", "BINARY")
    ds = pydicom.dcmread(tmp_path / "seg.dcm")
    ds.PerFrameFunctionalGroupsSequence[0].PlanePositionSequence[0].ImagePositionPatient = [0.0, 0.0, 1.0]
    ds.save_as(tmp_path / "moved.dcm")
    with pytest.raises(VolumeError, match="not evenly spaced"):
        load_volume(tmp_path / "moved.dcm")
    del ds.PixelData
    ds.PerFrameFunctionalGroupsSequence[0].PlanePositionSequence[0].ImagePositionPatient = (
        ds.PerFrameFunctionalGroupsSequence[1].PlanePositionSequence[0].ImagePositionPatient
    )
    ds.save_as(tmp_path / "empty.dcm")
    with pytest.raises(VolumeError, match="cannot be read as DICOM"):
        load_volume(tmp_path / "empty.dcm")
    (tmp_path / "cut.dcm").write_bytes((tmp_path / "seg.dcm").read_bytes()[:-20_000])
    with pytest.raises(VolumeError, match=r"cut\.dcm"):
        load_volume(tmp_path / "cut.dcm")
