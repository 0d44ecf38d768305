"""A CT series as DICOM files, made of nothing: slices of a grid that lies obliquely in a patient."""

from pathlib import Path

import numpy as np
import pydicom
from pydicom.dataset import FileDataset, FileMetaDataset
from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian, generate_uid


def write_series(folder: Path, T_lps_voxel_mm: np.ndarray, shape: tuple[int, int, int]) -> list[Path]:
    """Write a slice for each index along the last axis; the files' names are not in their order.

    Args:
        folder: Made here.
        T_lps_voxel_mm: Maps indices (column, row, slice) to LPS [mm], orthogonal axes.
        shape: Columns, rows, slices.
    """
    folder.mkdir(parents=True)
    columns, rows, n = shape
    spacing = np.linalg.norm(T_lps_voxel_mm[:3, :3], axis=0)
    study, series, frame = (generate_uid(entropy_srcs=[name]) for name in ("study", "series", "frame"))
    files = []
    for k in range(n):
        meta = FileMetaDataset()
        meta.MediaStorageSOPClassUID, meta.TransferSyntaxUID = CTImageStorage, ExplicitVRLittleEndian
        meta.MediaStorageSOPInstanceUID = generate_uid(entropy_srcs=["slice", str(k)])
        file = folder / f"{(k * 7) % n:03d}.dcm"
        ds = FileDataset(str(file), {}, file_meta=meta, preamble=b"\0" * 128)
        ds.SOPClassUID, ds.SOPInstanceUID = CTImageStorage, meta.MediaStorageSOPInstanceUID
        ds.StudyInstanceUID, ds.SeriesInstanceUID, ds.FrameOfReferenceUID = study, series, frame
        ds.PatientName, ds.PatientID, ds.PatientBirthDate, ds.PatientSex = "Phantom^Ball", "P1", "", ""
        ds.StudyDate = ds.SeriesDate = ds.ContentDate = ds.AcquisitionDate = "20260101"
        ds.StudyTime = ds.SeriesTime = ds.ContentTime = "120000"
        ds.AccessionNumber, ds.StudyID, ds.ReferringPhysicianName = "", "1", ""
        ds.Modality, ds.SeriesNumber, ds.InstanceNumber = "CT", 1, k + 1
        ds.Manufacturer, ds.PositionReferenceIndicator = "none", ""
        ds.ImageType = ["ORIGINAL", "PRIMARY", "AXIAL"]
        ds.ImagePositionPatient = [f"{each:.10g}" for each in (T_lps_voxel_mm @ [0, 0, k, 1])[:3]]
        ds.ImageOrientationPatient = [
            f"{each:.10g}" for axis in (0, 1) for each in T_lps_voxel_mm[:3, axis] / spacing[axis]
        ]
        ds.PixelSpacing, ds.SliceThickness = (
            [f"{spacing[1]:.10g}", f"{spacing[0]:.10g}"],
            f"{spacing[2]:.10g}",
        )
        ds.Rows, ds.Columns, ds.SamplesPerPixel = rows, columns, 1
        ds.PhotometricInterpretation, ds.PixelRepresentation = "MONOCHROME2", 1
        ds.BitsAllocated, ds.BitsStored, ds.HighBit = 16, 16, 15
        ds.RescaleIntercept, ds.RescaleSlope, ds.KVP = "0", "1", "120"
        ds.PixelData = np.full((rows, columns), k, dtype=np.int16).tobytes()
        ds.save_as(file, enforce_file_format=True)
        files.append(file)
    return files


def read_back(file: Path) -> pydicom.Dataset:
    return pydicom.dcmread(file)
