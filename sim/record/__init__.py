"""The folder of a run: how it is written as the run goes, so that it is valid at any moment, and read back."""
