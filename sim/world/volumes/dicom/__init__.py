"""Segmentations in DICOM: a SEG object read as a label volume, and the slices of the series that one lies on."""
