"""Label volumes: NIfTI and NRRD files, what their labels mean, and the surfaces of what is labelled."""
