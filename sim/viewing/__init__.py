"""Ways to look at runs and patients: replay, video, MuJoCo's viewer, Rerun, export to NIfTI, inspection of files."""
